"""A log cut at any byte: what is recovered against a scan of its own, with nothing but struct, zstandard and lz4."""

from __future__ import annotations

import json
import random
import struct
from pathlib import Path
from typing import NamedTuple

import lz4.frame
import pytest
import zstandard
from geomphys_cli.main import run
from mcap.writer import CompressionType

import geomphys
from geomphys.config import Config
from geomphys.recording.frames import FrameSource
from geomphys.recording.reader import open_log
from tests.cli.press import SCENE
from tests.recording.log_files import Item, Tree, make_world, pose, turned, write_log

LAYOUTS = {
    "zstd": {"compression": CompressionType.ZSTD, "chunk_size": 700},
    "lz4": {"compression": CompressionType.LZ4, "chunk_size": 700},
    "none": {"compression": CompressionType.NONE, "chunk_size": 700},
    "one chunk": {"compression": CompressionType.NONE},
    "one packed": {"compression": CompressionType.ZSTD},
    "no chunks": {"use_chunking": False},
    "no checksums": {"compression": CompressionType.LZ4, "chunk_size": 700, "enable_crcs": False},
}
EVERY_BYTE = ("zstd", "lz4", "none", "no chunks")
TOPIC = "/tracker/finger"
WORLD = make_world(Tree(root=TOPIC))
HEAD = struct.Struct("<BQ")
CHANNEL, MESSAGE, CHUNK = 4, 5, 6


class Found(NamedTuple):
    topic: str
    log_time: int
    data: bytes


def text_at(data: bytes, at: int) -> tuple[str, int]:
    """A text with its length before it, and where it ends."""
    (length,) = struct.unpack_from("<I", data, at)
    return data[at + 4 : at + 4 + length].decode(), at + 4 + length


def unpacked(name: str, data: bytes) -> bytes:
    """What of a packed beginning can be unpacked: whole blocks."""
    if name == "zstd":
        return zstandard.ZstdDecompressor().decompressobj().decompress(data) if data else b""
    if name == "lz4":
        return lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=2**24)  # without it some is held back
    return data


def readable(data: bytes, topics: dict[int, str]) -> list[Found]:
    """Messages of all complete records, and of the beginning of a chunk that is cut."""
    found, at = [], 0
    while at + HEAD.size <= len(data):
        opcode, length = HEAD.unpack_from(data, at)
        body = data[at + HEAD.size : at + HEAD.size + length]
        at += HEAD.size + length
        if opcode == CHUNK:
            if len(body) >= 32 and len(body) >= 40 + struct.unpack_from("<I", body, 28)[0]:
                name, end = text_at(body, 28)
                (packed,) = struct.unpack_from("<Q", body, end)
                found += readable(unpacked(name, body[end + 8 : end + 8 + packed]), topics)
        elif len(body) < length:
            break
        elif opcode == CHANNEL:
            topics[struct.unpack_from("<H", body)[0]] = text_at(body, 4)[0]
        elif opcode == MESSAGE:
            channel, _, log_time, _ = struct.unpack_from("<HIQQ", body)
            found.append(Found(topics[channel], log_time, body[22:]))
    return found


def recovered(path: Path) -> list[Found]:
    reader = open_log(path, recover=True)
    return [Found(reader.channels[m.key].topic, m.log_time, m.data) for m in reader.read()]


def poses(count: int) -> list[Item]:
    return [
        item
        for k in range(count)
        for item in (
            pose(TOPIC, 1 + k / 60, (0.001 * k, 0.0, 0.05 - 0.001 * k, *turned(0.01 * k))),
            Item("/camera", "raw", bytes([k]) * 40, 10**9 + k * 16_000_000),
        )
    ]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_short_log_cut_at_any_byte(tmp_path: Path, layout: str) -> None:
    path = write_log(tmp_path / "log.mcap", poses(6), encoding="json", **LAYOUTS[layout])
    content = path.read_bytes()
    whole = readable(content[8:-8], {})
    assert len(whole) == 12
    seen = set()
    for cut in range(8, len(content) + 1, 1 if layout in EVERY_BYTE else 5):
        path.write_bytes(content[:cut])
        expected = readable(content[8:cut], {})
        assert recovered(path) == sorted(expected, key=lambda m: m.log_time), cut
        seen.add(len(expected))
    assert seen == {0, 12} if layout == "one packed" else len(seen) >= 3


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_the_blocks_of_a_large_cut_chunk(tmp_path: Path, compression: CompressionType) -> None:
    """Blocks of some 100 kB are unpacked as far as they are there, to the last message that is in them."""
    noise = random.Random(3)
    items = [Item("/camera", "raw", noise.randbytes(noise.randrange(3000)), k) for k in range(500)]
    path = write_log(tmp_path / "log.mcap", items, compression=compression, chunk_size=10**8)
    content = path.read_bytes()
    counts = []
    for _ in range(30):
        cut = noise.randrange(len(content))
        path.write_bytes(content[: max(cut, 8)])
        expected = readable(content[8:cut], {})
        assert recovered(path) == expected, cut
        counts.append(len(expected))
    assert len(set(counts)) > 4


@pytest.mark.parametrize("layout", ["zstd", "lz4", "none", "no chunks"])
def test_the_frames_are_those_of_the_readable_messages(tmp_path: Path, layout: str) -> None:
    path = write_log(tmp_path / "log.mcap", poses(30), encoding="json", **LAYOUTS[layout])
    content, chance = path.read_bytes(), random.Random(5)
    for cut in sorted(chance.sample(range(8, len(content)), 25)):
        expected = [m for m in readable(content[8:cut], {}) if m.topic == TOPIC]
        path.write_bytes(content[:cut])
        if not expected:
            continue
        with FrameSource(path, WORLD, Config(recover=True)) as source:
            frames = [(f.time_ns, tuple(f.roots[0, :3])) for f in source]
        assert [time for time, _ in frames] == [m.log_time for m in expected]
        for (_, place), message in zip(frames, expected, strict=True):
            told = json.loads(message.data)["pose"]["position"]
            assert place == (told["x"], told["y"], told["z"])


@pytest.mark.parametrize("layout", ["zstd", "lz4", "none", "no chunks"])
def test_the_command_line_replays_them(tmp_path: Path, layout: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_log(tmp_path / "log.mcap", poses(30), encoding="json", **LAYOUTS[layout])
    scene, out = tmp_path / "scene.toml", tmp_path / "out.mcap"
    scene.write_text(SCENE)
    content, chance = path.read_bytes(), random.Random(7)
    for cut in sorted(chance.sample(range(8, len(content)), 4)):
        expected = [m.log_time for m in readable(content[8:cut], {}) if m.topic == TOPIC]
        path.write_bytes(content[:cut])
        words = ["replay", str(path), "-s", str(scene), "-o", str(out), "--force", "--json"]
        assert run(words) == 1
        refusal = capsys.readouterr().err
        assert f"{len(readable(content[8:cut], {}))} messages over" in refusal
        assert "--recover" in refusal
        code = run([*words, "--recover"])
        said = capsys.readouterr()
        assert code == (0 if expected else 1), said.err
        if expected:
            assert json.loads(said.out)["frames"] == len(expected)
            assert [frame.time_ns for frame in geomphys.open_output(out).frames()] == expected
            assert "damaged" in said.err
            out.unlink()
        assert not out.exists()
