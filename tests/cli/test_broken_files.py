"""Broken and hostile files, by the command line: the documented exit code, one line, nothing written, little memory."""

from __future__ import annotations

import json
import os
import random
import struct
import subprocess
import sys
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from geomphys_cli.main import run
from mcap.reader import make_reader

import geomphys
from tests.cli.press import SCENE, Case, write_log
from tests.scene.models import ball, cube, joint, link, stl, urdf

MAGIC = b"\x89MCAP0\r\n"
LIMIT_MB = 1024


def record(opcode: int, body: bytes) -> bytes:
    return bytes([opcode]) + struct.pack("<Q", len(body)) + body


def text(content: bytes) -> bytes:
    return struct.pack("<I", len(content)) + content


def chunk(compression: bytes, packed: bytes, size: int) -> bytes:
    head = struct.pack("<QQQI", 0, 10, size, 0) + text(compression) + struct.pack("<Q", len(packed))
    return record(6, head + packed)


def channel(topic: bytes, encoding: bytes = b"json") -> bytes:
    return record(4, struct.pack("<HH", 1, 0) + text(topic) + text(encoding) + text(b""))


HEADER = MAGIC + record(1, text(b"") + text(b""))
END = record(15, bytes(4)) + record(2, bytes(20)) + MAGIC
LOGS = {
    "empty": b"",
    "a picture": b"\x89PNG\r\n\x1a\n" + bytes(100),
    "magic alone": MAGIC,
    "absurd length": MAGIC + b"\x06" + struct.pack("<Q", 2**63) + bytes(100),
    "absurd header": MAGIC + b"\x01" + struct.pack("<Q", 2**64 - 1),
    "absurd text": MAGIC + record(1, struct.pack("<I", 2**32 - 1) + b"abc") + END,
    "zstd lies": HEADER + chunk(b"zstd", zstandard.compress(bytes(2**24)), 1000) + END,
    "lz4 lies": HEADER + chunk(b"lz4", lz4.frame.compress(bytes(2**24)), 2**60) + END,
    "other packing": HEADER + chunk(b"xz\n\x1b[2J", b"abc", 10) + END,
    "window": HEADER + chunk(b"zstd", b"\x28\xb5\x2f\xfd\x00\xf8" + b"\xff" * 100, 2**20) + END,
    "no text": HEADER + channel(b"/a\xff\xfe") + END,
    "time": HEADER + channel(b"/tracker/finger") + record(5, struct.pack("<HIQQ", 1, 0, 2**63, 0) + b"{}") + END,
    "no message": HEADER + END,
    "steering topic": HEADER + channel(b"/a\n\x1b[31mred") + record(5, struct.pack("<HIQQ", 1, 0, 0, 0) + b"{}") + END,
}


def said(capsys: pytest.CaptureFixture[str]) -> str:
    """The one line of error; nothing that steers a terminal."""
    output = capsys.readouterr()
    assert all(c.isprintable() or c == "\n" for c in output.out + output.err)
    lines = output.err.splitlines()
    assert len(lines) == 1, lines
    assert lines[0].startswith("geomphys: error: ")
    assert output.out == ""
    return lines[0]


def refused(words: list[object], folder: Path, capsys: pytest.CaptureFixture[str], code: int = 1) -> str:
    """What is said of a command that must fail and leave nothing in a folder."""
    before = sorted(folder.iterdir())
    assert run([str(word) for word in words]) == code
    assert sorted(folder.iterdir()) == before
    return said(capsys)


@pytest.mark.parametrize("name", LOGS)
def test_broken_logs(case: Case, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "log.mcap"
    log.write_bytes(LOGS[name])
    for more in ([], ["--recover", "--copy-input"]):
        line = refused(["replay", log, "-s", case.scene, "-o", tmp_path / "out.mcap", *more], tmp_path, capsys)
        assert str(log) in line
    for words in (["stats", log], ["audit", log], ["plot", log, "-o", tmp_path / "out.png"]):
        assert str(log) in refused(words, tmp_path, capsys)
    assert str(log) in refused(["diff", log, log], tmp_path, capsys, code=2)


def test_a_log_cut_anywhere(case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole, log = case.log.read_bytes(), tmp_path / "log.mcap"
    for size in range(1, len(whole), 131):
        log.write_bytes(whole[:size])
        assert "--recover" in refused(["info", log], tmp_path, capsys) or size < 8
    log.write_bytes(whole[:-9])
    assert run(["replay", str(log), "-s", str(case.scene), "--recover", "--json"]) == 0
    output = capsys.readouterr()
    assert json.loads(output.out)["frames"] == 60
    assert "damaged" in output.err
    assert "Traceback" not in output.err


def test_results_with_wrong_bytes(case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good, bad = tmp_path / "good.mcap", tmp_path / "bad.mcap"
    geomphys.run(case.log, case.scene, out=good, options=geomphys.OutputOptions(timing=False))
    whole, chance = good.read_bytes(), random.Random(4)
    with good.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    first = summary.chunk_indexes[0]
    for number in range(24):
        data = bytearray(whole)
        place = first.chunk_start_offset + 80 + number * 40 if number < 12 else chance.randrange(len(data))
        data[place] ^= 1 << chance.randrange(8)
        bad.write_bytes(data)
        for words in (
            ["stats", bad, "--json"],
            ["diff", bad, good],
            ["plot", bad, "-o", tmp_path / "p.svg", "--force"],
        ):
            code = run([str(word) for word in words])
            output = capsys.readouterr()
            assert "Traceback" not in output.err
            assert code in (0, 1, 2)
            if number < 12:  # in a chunk, whose checksum tells
                assert code == (2 if words[0] == "diff" else 1), (number, words)
    for size in (0, 8, len(whole) // 2, len(whole) - 8):
        bad.write_bytes(whole[:size])
        assert str(bad) in refused(["stats", bad], tmp_path, capsys)


SCENES = {
    "nested": "a=" + "[" * 100_000 + "]" * 100_000,
    "nested tables": "[" + ".".join(["a"] * 5_000) + "]\n",
    "key of many parts": ".".join(["a"] * 20_000) + " = 1",
    "keys of many parts": "\n".join("[" + "a. " * 40 + f"b{k}]" for k in range(10)),
    "huge": "#" * (5 * 2**20),
    "not a number": SCENE.replace("0.05", "nan", 1),
    "infinite": SCENE.replace("[1.0, 1.0, 0.1]", "[inf, 1.0, 0.1]"),
    "large": SCENE.replace("[1.0, 1.0, 0.1]", "[1e308, 1.0, 0.1]"),
    "denormal": SCENE.replace("sphere = 0.05", "sphere = 5e-324"),
    "minus nothing": SCENE.replace("sphere = 0.05", "sphere = -0.0"),
    "far": SCENE.replace("[0.0, 0.0, -0.05]", "[1e308, 0.0, -0.05]"),
    "heavy": SCENE.replace("mass = 0.4", "mass = 1e308"),
    "digits": SCENE.replace("mass = 0.4", "mass = " + "9" * 5000),
    "steering name": SCENE.replace('"table"', '"ta\\n\\u001b[31mble"'),
    "twice": SCENE.replace('"finger"', '"table"'),
    "date": SCENE.replace('"press"', "1979-05-27"),
    "picture": "\udc89PNG\r\n",
}
MESHES = [
    "../x.stl", "/etc/passwd", "http://127.0.0.1:1/a.stl", "s3://b/a.stl", "file:///etc/passwd", "/dev/zero", ".",
    "a\\u0000.stl", "x" * 5000 + ".stl", "/proc/self/mem.stl", "fifo.stl",
]  # fmt: skip
SCENES |= {
    f"mesh {name[:24]}": f'{SCENE}[[object]]\nname = "m"\nclass = "fixed"\nmesh = "{name}"\nmaterial = "wood"\n'
    for name in MESHES
}


@pytest.mark.parametrize("name", SCENES)
def test_broken_scenes(case: Case, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_bytes(SCENES[name].encode("utf-8", "surrogateescape"))
    os.mkfifo(tmp_path / "fifo.stl")
    line = refused(["replay", case.log, "-s", scene, "-o", tmp_path / "out.mcap"], tmp_path, capsys)
    assert str(scene) in line
    assert len(line) < 6000
    assert "root:" not in line, "what is in other files is never shown"


CORNERS, FACES = cube(0.1)
ENTITIES = '<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;">]>'
ACCESSOR = {"componentType": 5126, "count": 2_000_000_000, "type": "VEC3"}
PLACED = {"scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]}
GLTF = {"asset": {"version": "2.0"}, "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], **PLACED}
TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
FILES: dict[str, bytes] = {
    "empty.stl": b"", "empty.obj": b"", "empty.glb": b"", "empty.gltf": b"{}", "empty.ply": b"", "empty.off": b"OFF\n",
    "claim.stl": bytes(80) + struct.pack("<I", 2**32 - 1) + bytes(50),
    "index.obj": TRIANGLE + b"f 1 2 99999999\n",
    "other.obj": b"mtllib /etc/passwd\n" + TRIANGLE + b"f 1 2 3\n",
    "claim.ply": b"ply\nformat binary_little_endian 1.0\nelement vertex 4294967295\nproperty float x\nproperty float y\n"
    b"property float z\nelement face 4294967295\nproperty list uchar int vertex_indices\nend_header\n",
    "claim.off": b"OFF\n999999999 999999999 0\n",
    "claim.glb": b"glTF" + struct.pack("<IIII", 2, 2**32 - 1, 2**31, 0x4E4F534A) + b"{}",
    "accessor.gltf": json.dumps({**GLTF, "accessors": [ACCESSOR]}).encode(),
    "reach.gltf": json.dumps({
        **GLTF, "accessors": [{**ACCESSOR, "bufferView": 0}], "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"uri": "data:application/octet-stream;base64,AAAA", "byteLength": 36}],
    }).encode(),
    "other.gltf": json.dumps({
        **GLTF, "accessors": [{**ACCESSOR, "count": 3, "bufferView": 0}], "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"uri": "/etc/passwd", "byteLength": 36}],
    }).encode(),
    "round.gltf": json.dumps({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
                              "nodes": [{"children": [1]}, {"children": [0]}]}).encode(),
    "bomb.dae": ENTITIES.encode() + b"<COLLADA>&b;</COLLADA>",
}  # fmt: skip
TABLES: dict[str, tuple[np.ndarray, np.ndarray]] = {
    "nan.stl": (np.where(CORNERS.max() == CORNERS, np.nan, CORNERS), FACES),
    "infinite.stl": (np.where(CORNERS.max() == CORNERS, np.inf, CORNERS), FACES),
    "large.stl": (CORNERS * 1e30, FACES),
    "point.stl": (CORNERS * 0.0, FACES),
    "flat.stl": (CORNERS * [1.0, 1.0, 0.0], FACES),
    "fin.stl": (np.vstack([CORNERS, [[0.3, 0.0, 0.2]], CORNERS * 0.5]), np.vstack([FACES, [[0, 1, 8]], FACES + 9])),
}


@pytest.mark.parametrize("name", [*FILES, *TABLES])
def test_broken_meshes(case: Case, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    if name in FILES:
        (tmp_path / name).write_bytes(FILES[name])
    else:
        with np.errstate(over="ignore"):
            stl(tmp_path / name, *TABLES[name])
    scene = tmp_path / "scene.toml"
    scene.write_text(f'{SCENE}[[object]]\nname = "m"\nclass = "fixed"\nmesh = "{name}"\nmaterial = "wood"\n')
    line = refused(["replay", case.log, "-s", scene, "-o", tmp_path / "out.mcap"], tmp_path, capsys)
    assert name in line
    assert "root:" not in line


MESH = '<geometry><mesh filename="{}"/></geometry>'
MODELS: dict[str, tuple[str, ...]] = {
    "circle": (ball("a"), ball("b"), joint("j", "a", "b"), joint("k", "b", "a")),
    "circle beside": (ball("r"), ball("a"), ball("b"), joint("j", "a", "b"), joint("k", "b", "a")),
    "own child": (ball("a"), joint("j", "a", "a")),
    "link twice": (ball("a"), ball("a")),
    "joint twice": (ball("a"), ball("b"), ball("c"), joint("j", "a", "b"), joint("j", "a", "c")),
    "steering link": (ball("a&#10;b"), ball("b")),
    "long name": (ball("a" * 10_000_000),),
    "no such link": (ball("a"), joint("j", "a", "z")),
    "mimics itself": (ball("a"), ball("b"), joint("j", "a", "b", inside='<mimic joint="j"/>')),
    "no limit": (
        ball("a"), ball("b"), joint("j", "a", "b", inside='<limit lower="nan" upper="1" effort="1" velocity="1"/>')
    ),
    "no axis": (ball("a"), ball("b"), joint("j", "a", "b", inside='<axis xyz="0 0 0"/>')),
    "far joint": (ball("a"), ball("b"), joint("j", "a", "b", xyz="1e308 0 0")),
    "tiny ball": (ball("a", 5e-324),),
    "deep": ("<a>" * 100_000 + "</a>" * 100_000,),
    **{
        f"mesh {name}": (link("a", MESH.format(name)),)
        for name in (
            "http://127.0.0.1:1/y.stl", "file:///etc/passwd", "file://host/x.stl", "package://../../etc/passwd",
            "package://x/../../../etc/passwd.stl", "data:;base64,AAAA", "/dev/zero",
        )
    },
}  # fmt: skip


@pytest.mark.parametrize("name", [*MODELS, "bomb", "entity", "not a model"])
def test_broken_models(case: Case, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    model, scene = tmp_path / "model.urdf", tmp_path / "scene.toml"
    if name in MODELS:
        urdf(model, *MODELS[name])
    else:
        entity = (
            '<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot name="x">&a;</robot>'
        )
        model.write_text({"bomb": f'{ENTITIES}<robot name="&b;"/>', "entity": entity}.get(name, "hello"))
    scene.write_text(
        '[[avatar]]\nname = "hand"\nurdf = "model.urdf"\nmode = "rigid"\nmaterial = "human"\n'
        'root = { topic = "/tracker/finger" }\n'
    )
    line = refused(["replay", case.log, "-s", scene, "-o", tmp_path / "out.mcap"], tmp_path, capsys)
    assert "model.urdf" in line, line
    assert "root:" not in line


def test_what_is_no_file(case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "folder.mcap").mkdir()
    for name, code in ((tmp_path / "fifo", 1), (tmp_path / "folder.mcap", 1), ("/dev/zero", 1), ("/dev/null", 1)):
        refused(["info", name], tmp_path, capsys, code)
    assert run(["replay", str(case.log), "-s", str(tmp_path / "fifo")]) in (1, 2)
    said(capsys)


def test_a_name_that_is_no_text(case: Case, tmp_path: Path) -> None:
    log = os.fsencode(tmp_path) + b"/a\xff\x1b[31m.mcap"
    Path(os.fsdecode(log)).write_bytes(case.log.read_bytes())
    words = ["replay", os.fsdecode(log), "-s", str(case.scene), "-o", os.fsdecode(log) + ".out.mcap"]
    for arguments, code in ((words, 0), (["info", os.fsdecode(log) + "x"], 2)):
        outcome = subprocess.run(
            [sys.executable, "-c", "from geomphys_cli.main import main; main()", *arguments], capture_output=True
        )
        assert outcome.returncode == code, outcome.stderr
        assert b"\x1b" not in outcome.stdout + outcome.stderr
        assert b"Traceback" not in outcome.stderr


def test_bombs_cost_less_than_a_gigabyte(tmp_path: Path) -> None:
    bomb = zstandard.ZstdCompressor().compressobj()
    packed = b"".join(bomb.compress(bytes(2**24)) for _ in range(128)) + bomb.flush()
    (tmp_path / "bomb.mcap").write_bytes(HEADER + chunk(b"zstd", packed, 2**31) + END)
    (tmp_path / "lie.mcap").write_bytes(HEADER + chunk(b"zstd", packed, 255 * 2**20) + END)
    write_log(tmp_path / "ok.mcap")
    geomphys.run(tmp_path / "ok.mcap", Path(tmp_path, "scene.toml").write_text(SCENE) and tmp_path / "scene.toml",
                 out=tmp_path / "out.mcap", options=geomphys.OutputOptions(timing=False))  # fmt: skip
    whole = (tmp_path / "out.mcap").read_bytes()
    with (tmp_path / "out.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    at = summary.chunk_indexes[0].chunk_start_offset
    (tmp_path / "result.mcap").write_bytes(
        whole[:at] + chunk(b"zstd", packed, 255 * 2**20)[: len(whole) - at] + whole[at:]
    )
    (tmp_path / "a.gltf").write_bytes(FILES["accessor.gltf"])
    with (tmp_path / "millions.stl").open("wb") as stream:
        stream.write(bytes(80) + struct.pack("<I", 2_400_000))
        stream.truncate(84 + 50 * 2_400_000)
    commands = [
        ["info", "bomb.mcap"], ["info", "lie.mcap", "--recover"], ["stats", "bomb.mcap"], ["stats", "result.mcap"],
        ["decompose", "a.gltf"], ["decompose", "millions.stl"],
    ]  # fmt: skip
    script = rf"""
import re, sys
from geomphys_cli.main import run
def peak():  # of this program alone; a process begins with the peak of the one that forked it
    return int(re.search(r"VmHWM:\s+(\d+)", open("/proc/self/status").read())[1])
for words in {commands!r}:
    code = run(words)
    print(words[:2], code, peak() // 1024)
"""
    outcome = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=tmp_path, timeout=120)
    assert "Traceback" not in outcome.stderr, outcome.stderr
    lines = [line for line in outcome.stdout.splitlines() if line.startswith("[")]
    assert len(lines) == len(commands)
    for line in lines:
        code, peak = map(int, line.split("]")[1].split())
        assert peak < LIMIT_MB, line
        assert code == 1 or "--recover" in line or "lie" in line, line
