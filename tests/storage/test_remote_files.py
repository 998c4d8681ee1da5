"""Logs, scenes and results behind URLs: the same results as from local files, read by range, and nothing else reached."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from geomphys_cli.main import run
from mcap.writer import CompressionType, Writer

import geomphys
from geomphys.recording.inspect import inspect_log
from geomphys.recording.reader import open_log
from geomphys.storage.remote_files import RemotePath, as_path, is_remote
from tests.cli.press import SCENE, write_log
from tests.scene.models import cube, ell, joint, link, stl, urdf
from tests.servers import Web, s3_server, web_server

pytestmark = pytest.mark.filterwarnings("ignore:datetime.datetime.utc:DeprecationWarning")

DOOR = """
[[object]]
name = "door"
class = "fixed"
urdf = "models/door/door.urdf"
position = [3.0, 0.0, 0.0]
material = "wood"

[[object]]
name = "block"
class = "fixed"
mesh = "meshes/cube.stl"
position = [-3.0, 0.0, 0.0]
material = "wood"
"""


def write_files(folder: Path) -> None:
    """A log, and a scene with a mesh and with a URDF that has meshes of its own, one of them by way of ``../``."""
    write_log(folder / "press.mcap")
    for name in ("meshes", "models/door"):
        (folder / name).mkdir(parents=True)
    stl(folder / "meshes" / "cube.stl", *cube(0.1))
    shutil.copy(folder / "meshes" / "cube.stl", folder / "models" / "door" / "leaf.stl")
    mesh = '<geometry><mesh filename="{}"/></geometry>'
    urdf(
        folder / "models" / "door" / "door.urdf",
        link("frame", mesh.format("package://door/leaf.stl")),
        link("leaf", mesh.format("../../meshes/cube.stl")),
        joint("hinge", "frame", "leaf", xyz="0 0 1"),
    )
    (folder / "press.toml").write_text(SCENE + DOOR)


@pytest.fixture
def files(tmp_path: Path) -> Path:
    (tmp_path / "files").mkdir()
    write_files(tmp_path / "files")
    return tmp_path / "files"


@pytest.fixture
def web(files: Path) -> Iterator[Web]:
    with web_server(files) as server:
        yield server


def write_camera_log(path: Path, pictures: int = 30) -> None:
    """The poses of `write_log`, and in chunks of their own pictures that nobody asks for, which cannot be packed."""
    source = open_log(path.parent / "press.mcap")
    (channel,) = source.channels.values()
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE, chunk_size=2**18)
        writer.start()
        image = writer.register_channel("/camera", "raw", 0)
        for k in range(pictures):
            writer.add_message(image, 10**9 + k * 33_000_000, os.urandom(2**20), 10**9 + k * 33_000_000)
        schema = writer.register_schema(channel.schema_name, channel.schema_encoding, channel.schema_data)
        poses = writer.register_channel(channel.topic, channel.encoding, schema)
        for message in source.read():
            writer.add_message(poses, message.log_time, message.data, message.publish_time)
        writer.finish()


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    """What was said on stderr, which must be one line of error."""
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1, lines
    assert lines[0].startswith("geomphys: error: ")
    return lines[0]


def test_a_replay_over_http_gives_the_bytes_of_a_local_one(files: Path, web: Web, tmp_path: Path) -> None:
    outs = tmp_path / "local.mcap", tmp_path / "far.mcap"
    geomphys.run(
        files / "press.mcap",
        files / "press.toml",
        out=outs[0],
        options=geomphys.OutputOptions(timing=False, copy_input=True),
    )
    geomphys.run(
        f"{web.url}/press.mcap",
        f"{web.url}/press.toml",
        out=outs[1],
        options=geomphys.OutputOptions(timing=False, copy_input=True),
    )
    logs = [geomphys.open_output(out) for out in outs]
    assert logs[0].metadata == logs[1].metadata
    difference = geomphys.compare_outputs(*outs)
    assert difference.equal
    assert logs[0].descriptions() == logs[1].descriptions()  # they name no file
    assert "door/leaf" in "".join(logs[0].descriptions().values())
    for topic in ("/input/tracker/finger", "/tf", "/contacts", "/metrics"):
        assert logs[0].counts[topic] == logs[1].counts[topic]
    (files / "plain.toml").write_text(SCENE)  # nothing in it says where it was read
    geomphys.run(
        files / "press.mcap",
        files / "plain.toml",
        out=outs[0],
        options=geomphys.OutputOptions(timing=False),
        force=True,
    )
    geomphys.run(
        f"{web.url}/press.mcap",
        f"{web.url}/plain.toml",
        out=outs[1],
        options=geomphys.OutputOptions(timing=False),
        force=True,
    )
    assert outs[0].read_bytes() == outs[1].read_bytes()


def test_only_what_is_asked_for_is_read(files: Path, web: Web) -> None:
    write_camera_log(files / "camera.mcap")
    size = (files / "camera.mcap").stat().st_size
    assert size > 30 * 2**20
    far, near = inspect_log(as_path(f"{web.url}/camera.mcap")), inspect_log(files / "camera.mcap")
    assert far.topics == near.topics
    assert far.messages == near.messages == 90
    assert web.sent["/camera.mcap"] < 4 * 2**20
    web.sent.clear()
    summary = geomphys.run(f"{web.url}/camera.mcap", f"{web.url}/press.toml")
    assert summary.frames == 60
    assert web.sent["/camera.mcap"] < 4 * 2**20
    assert web.longest < 3 * 2**20


def test_a_written_result_costs_one_more_pass_for_the_hash(files: Path, web: Web, tmp_path: Path) -> None:
    write_camera_log(files / "camera.mcap")
    size = (files / "camera.mcap").stat().st_size
    geomphys.run(f"{web.url}/camera.mcap", f"{web.url}/press.toml", out=tmp_path / "out.mcap")
    assert size <= web.sent["/camera.mcap"] < size + 4 * 2**20
    assert web.longest < 20 * 2**20, "in parts"


def test_an_open_mesh_is_named_with_its_address_and_a_way_out(
    files: Path, web: Web, capsys: pytest.CaptureFixture[str]
) -> None:
    vertices, faces = ell()
    for path in (files / "meshes" / "cube.stl", files / "models" / "door" / "leaf.stl"):
        closed = path.read_bytes()
        stl(path, vertices, faces[1:])
        for folder in (str(files), web.url):
            assert run(["check", f"{folder}/press.mcap", "-s", f"{folder}/press.toml"]) == 1
            line = one_line(capsys)
            assert f"{folder}/" in line
            assert f"/{path.name}: is neither watertight nor convex" in line
            assert 'decomposition = "hull"' in line
        path.write_bytes(closed)


def test_results_are_read_over_http(files: Path, web: Web, capsys: pytest.CaptureFixture[str]) -> None:
    geomphys.run(files / "press.mcap", files / "press.toml", out=files / "out.mcap")
    out = f"{web.url}/out.mcap"
    assert run(["diff", out, str(files / "out.mcap")]) == 0
    assert run(["stats", out, "--json"]) == 0
    assert run(["audit", out, "--scene", f"{web.url}/press.toml"]) == 0
    assert run(["plot", out, "-o", str(files / "out.png")]) == 0
    assert run(["check", f"{web.url}/press.mcap", "-s", f"{web.url}/press.toml", "--json"]) == 0
    assert run(["decompose", f"{web.url}/meshes/cube.stl", "--json"]) == 0


def test_a_chunk_that_was_damaged_is_found_where_it_is_read(
    files: Path, web: Web, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = files / "press.mcap"
    data = bytearray(log.read_bytes())
    (span,) = open_log(log)._scans[0].spans
    data[span.offset + span.length // 2] ^= 0xFF
    (files / "bad.mcap").write_bytes(data)
    words = ["replay", f"{web.url}/bad.mcap", "-s", str(files / "press.toml"), "-o", str(tmp_path / "out.mcap")]
    assert run(words) == 1
    assert f"the chunk at byte {span.offset}" in one_line(capsys)
    assert not (tmp_path / "out.mcap").exists()
    (files / "cut.mcap").write_bytes(log.read_bytes()[:-20])
    words[1] = f"{web.url}/cut.mcap"
    assert run(words) == 1
    assert "--recover" in one_line(capsys)
    assert run([*words, "--recover"]) == 0
    assert (
        geomphys.open_output(tmp_path / "out.mcap").frame_count == open_log(files / "cut.mcap", recover=True).messages
    )


@pytest.mark.parametrize(
    ("name", "code", "says"),
    [
        ("{url}/nothing.mcap", 2, "no such file"),
        ("http://127.0.0.1:9/press.mcap", 2, "cannot be reached"),
        ("zork://somewhere/press.mcap", 2, "zork"),
        ("{url}/press.toml", 1, "not an MCAP"),
    ],
)
def test_what_is_wrong_with_a_url_is_one_line(
    web: Web, name: str, code: int, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["info", name.format(url=web.url)]) == code
    line = one_line(capsys)
    assert says in line
    assert name.format(url=web.url) in line


def test_a_url_that_is_missing_stops_no_batch(files: Path, web: Web, capsys: pytest.CaptureFixture[str]) -> None:
    urls = [f"{web.url}/press.mcap", f"{web.url}/missing.mcap"]
    words = ["batch", *urls, "-s", str(files / "press.toml"), "-O", str(files / "out"), "-j", "1", "--json"]
    for more in ([], ["--resume"]):
        assert run([*words, *more]) == 3
        entries = json.loads(capsys.readouterr().out)["entries"]
        assert [entry["status"] for entry in entries] == ["failed", "done"]
        assert urls[1] in entries[0]["error"]
    words[1:3] = [f"{web.url}/folder"]
    assert run(words) == 2


def test_a_server_without_ranges_is_said(files: Path, web: Web, capsys: pytest.CaptureFixture[str]) -> None:
    web.ranges = False
    write_camera_log(files / "camera.mcap")
    assert run(["info", f"{web.url}/camera.mcap"]) == 1
    assert f"{web.url}/camera.mcap" in one_line(capsys)


def test_nothing_is_written_to_a_web_server(files: Path, web: Web, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["replay", str(files / "press.mcap"), "-s", str(files / "press.toml"), "-o", f"{web.url}/out.mcap"]
    assert run(words) == 2
    assert "takes no files" in one_line(capsys)


HOSTILE = [
    "../secret.stl", "models/../../secret.stl", "/etc/passwd.stl", "file:///etc/passwd.stl", "http://127.0.0.1:1/a.stl",
    "s3://bucket/a.stl", "%2e%2e/secret.stl", "..\\secret.stl", "a.stl?x=1", "a.stl#x", "//127.0.0.1:1/a.stl", "a\nb.stl",
]  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_a_scene_behind_a_url_reaches_only_what_lies_below_it(tmp_path: Path, name: str) -> None:
    inner = tmp_path / "files" / "scenes"
    inner.mkdir(parents=True)
    write_files(inner)
    stl(tmp_path / "files" / "secret.stl", *cube(0.1))
    with web_server(tmp_path / "files") as web:
        (inner / "mesh.toml").write_text(SCENE + DOOR.replace('"meshes/cube.stl"', json.dumps(name)))
        with pytest.raises(geomphys.InputError, match=r"."):
            geomphys.load_world(f"{web.url}/scenes/mesh.toml")
        door = inner / "models" / "door" / "door.urdf"
        text = door.read_text().replace(
            "../../meshes/cube.stl", name.replace("../", "../../../").replace("\n", "&#10;")
        )
        door.write_text(text)
        with pytest.raises(geomphys.InputError, match=r"."):
            geomphys.load_world(f"{web.url}/scenes/press.toml")
        assert not [path for path in web.asked if "secret" in path or "passwd" in path or "a.stl" in path]


def test_a_scene_on_disk_opens_no_url(tmp_path: Path, files: Path, web: Web, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RemotePath, "_system", lambda self: pytest.fail(f"{self} was opened"))
    for change in (
        ('"meshes/cube.stl"', f'"{web.url}/meshes/cube.stl"'),
        ('"models/door/door.urdf"', f'"{web.url}/models/door/door.urdf"'),
    ):
        (files / "far.toml").write_text((SCENE + DOOR).replace(*change))
        with pytest.raises(geomphys.InputError):
            geomphys.load_world(files / "far.toml")
    door = files / "models" / "door" / "door.urdf"
    door.write_text(door.read_text().replace("../../meshes/cube.stl", f"{web.url}/meshes/cube.stl"))
    with pytest.raises(geomphys.MeshError, match=r"only file://"):
        geomphys.load_world(files / "press.toml")
    assert web.asked == []


def test_a_result_opens_no_url_of_the_scene_attached_to_it(files: Path, web: Web, tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    geomphys.run(files / "press.mcap", f"{web.url}/press.toml", out=out)
    web.asked.clear()
    assert geomphys.audit_output(out).same_world
    assert web.asked == []
    assert geomphys.audit_output(out, scene=f"{web.url}/press.toml").pairs >= 0


def test_places() -> None:
    assert as_path("a/b.mcap") == Path("a/b.mcap")
    assert as_path("file:///a/b%20c.mcap") == Path("/a/b c.mcap")
    far = as_path("s3://bucket/a/b.mcap")
    assert is_remote(far)
    assert (str(far), far.name, far.stem, far.suffix, str(far.parent)) == (
        "s3://bucket/a/b.mcap", "b.mcap", "b", ".mcap", "s3://bucket/a"
    )  # fmt: skip
    assert [str(up) for up in far.parents] == ["s3://bucket/a"]
    assert str(far.parent / "c/../d.stl") == "s3://bucket/a/d.stl"
    with pytest.raises(geomphys.InputError, match="below s3://bucket/a"):
        far.parent / "../d.stl"


def test_a_batch_on_a_store_gives_the_bytes_of_a_local_one(
    files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    geomphys.run(
        files / "press.mcap",
        files / "press.toml",
        out=tmp_path / "local.mcap",
        options=geomphys.OutputOptions(timing=False),
    )
    with s3_server(monkeypatch) as bucket:
        import s3fs

        name, store = bucket.removeprefix("s3://"), s3fs.S3FileSystem(use_listings_cache=False)
        store.put(str(files), f"{name}/in", recursive=True)
        store.put(str(files / "press.mcap"), f"{name}/logs/sub/short.mcap")
        store.put(str(files / "press.mcap"), f"{name}/logs/press.mcap")
        store.put(str(files / "press.mcap"), f"{name}/logs/.hidden/press.mcap")
        store.pipe_file(f"{name}/logs/broken.mcap", b"no log")
        folder, scene = f"{bucket}/out", f"{bucket}/in/press.toml"
        words = ["batch", f"{bucket}/logs", "-s", scene, "-O", folder, "--no-timing", "-j", "1", "--json"]
        assert run(words) == 3
        report = json.loads(capsys.readouterr().out)
        assert [(entry["out"], entry["status"]) for entry in report["entries"]] == [
            ("broken.mcap", "failed"), ("press.mcap", "done"), ("sub/short.mcap", "done")
        ]  # fmt: skip
        assert store.find(f"{name}/out") == [
            f"{name}/out/manifest.json", f"{name}/out/press.mcap", f"{name}/out/sub/short.mcap"
        ]  # fmt: skip
        store.rm_file(f"{name}/out/sub/short.mcap")
        assert run([*words, "--resume"]) == 3
        assert json.loads(capsys.readouterr().out)["up_to_date"] == ["press.mcap"]
        assert run(["diff", f"{folder}/press.mcap", f"{folder}/sub/short.mcap", "--html", f"{bucket}/report.html"]) == 0
        assert b"</html>" in store.cat_file(f"{name}/report.html")
        geomphys.run(
            f"{bucket}/in/press.mcap", scene, out=f"{bucket}/one.mcap", options=geomphys.OutputOptions(timing=False)
        )
        assert store.cat_file(f"{name}/one.mcap") == store.cat_file(f"{name}/out/press.mcap")
        assert run(["replay", f"{bucket}/in/press.mcap", "-s", scene, "-o", f"{bucket}/one.mcap"]) == 2
        assert "--force" in capsys.readouterr().err
        one = geomphys.open_output(f"{bucket}/one.mcap")
        assert geomphys.compare_outputs(tmp_path / "local.mcap", f"{bucket}/one.mcap").equal
        assert one.metadata == geomphys.open_output(tmp_path / "local.mcap").metadata
