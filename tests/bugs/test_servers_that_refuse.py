"""A server that gives no parts of files, or refuses, was told in the words of a library, or taken for a missing file."""

from __future__ import annotations

import random
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from geomphys_cli.main import run
from mcap.writer import CompressionType

from geomphys.recording.reader import open_log
from geomphys.storage.remote_stream import without_credentials
from tests.recording.log_files import Item, pose, write_log
from tests.servers import Web, web_server

pytest.importorskip("aiohttp")
COUNT = 40


@pytest.fixture
def web(tmp_path: Path) -> Iterator[Web]:
    """A server of a short log and of one of three megabytes."""
    poses = [pose("/wrist", k / 10, (k, 0, 0, 0, 0, 0, 1)) for k in range(COUNT)]
    write_log(tmp_path / "short.mcap", poses)
    noise = random.Random(1)
    camera = [Item("/camera", "raw", noise.randbytes(100_000), k * 10**8) for k in range(30)]
    items = sorted(poses + camera, key=lambda m: m.log_time)
    write_log(tmp_path / "long.mcap", items, compression=CompressionType.NONE, chunk_size=300_000)
    with web_server(tmp_path) as server:
        yield server


def line(capsys: pytest.CaptureFixture[str]) -> str:
    said = capsys.readouterr().err
    assert said.count("\n") == 1, said
    return said


@pytest.mark.parametrize("says", [True, False])
@pytest.mark.parametrize("name", ["short.mcap", "long.mcap"])
def test_a_server_that_ignores_ranges_works_or_is_told_in_a_line(
    web: Web, name: str, says: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    web.ranges, web.says_ranges = False, says
    code = run(["info", f"{web.url}/{name}"])
    said = capsys.readouterr()
    if code == 0:
        web.ranges = True
        with open_log(f"{web.url}/{name}") as reader:
            assert sum(reader.channels[m.key].topic == "/wrist" for m in reader.read()) == COUNT
    else:
        assert said.err.count("\n") == 1
        assert "gives no parts of files; fetch the file first" in said.err


@pytest.mark.parametrize(
    ("status", "says"),
    [
        (401, "access is refused (HTTP 401)"),
        (403, "access is refused (HTTP 403)"),
        (404, "no such file"),
        (410, "no such file"),
        (429, "HTTP 429"),
        (500, "the server has trouble (HTTP 500); try again"),
        (503, "the server has trouble (HTTP 503); try again"),
        (418, "the server refuses (HTTP 418)"),
    ],
)
def test_refusals_are_told_apart(web: Web, status: int, says: str, capsys: pytest.CaptureFixture[str]) -> None:
    web.status = status
    assert run(["info", f"{web.url}/short.mcap"]) != 0
    assert says in line(capsys)


@pytest.mark.parametrize("status", [200, 401, 404, 500])
def test_credentials_are_not_said(web: Web, status: int, capsys: pytest.CaptureFixture[str]) -> None:
    web.status = status
    secret = web.url.replace("://", "://somebody:pass-word@") + "/short.mcap"
    for words in (["info", secret], ["check", secret, "-s", f"{secret}.toml"], ["info", f"{secret}?key=pass-word"]):
        run(words)
        said = capsys.readouterr()
        assert "pass-word" not in said.out + said.err, words
        assert "somebody" not in said.out + said.err, words


def test_credentials_are_in_no_manifest_and_no_output(
    web: Web, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scene.toml").write_text(
        '[[object]]\nname = "ball"\nclass = "driven"\nsphere = 0.1\ntopic = "/wrist"\nmaterial = "wood"\nmass = 1.0\n'
    )
    secret = web.url.replace("://", "://somebody:pass-word@") + "/short.mcap"
    folder = tmp_path / "out"
    words = ["batch", secret, "-s", str(tmp_path / "scene.toml"), "-O", str(folder), "--json"]
    assert run(words) == 0, capsys.readouterr().err
    assert "pass-word" not in capsys.readouterr().out
    assert (folder / "short.mcap").is_file()
    for file in folder.iterdir():
        assert b"pass-word" not in file.read_bytes(), file
    assert run([*words, "--resume"]) == 0


def test_a_server_that_says_nothing_is_given_up(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("geomphys.storage.remote_files.SILENCE_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"http://127.0.0.1:{silent.getsockname()[1]}/take.mcap"
        assert run(["info", url]) != 0
    assert "the server does not answer in time" in line(capsys)


def test_texts_of_libraries_are_cleared_of_credentials() -> None:
    text = "401, message='no', url='https://me:key@host.org/a/b.mcap?sig=key&x=1' and s3://bucket/a@b.mcap (x@y?)"
    cleared = "401, message='no', url='https://…@host.org/a/b.mcap?…' and s3://bucket/a@b.mcap (x@y?)"
    assert without_credentials(text) == cleared
