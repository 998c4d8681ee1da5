"""Cut-off, corrupt and hostile logs: a clear error, everything readable recovered, memory and time bounded."""

from __future__ import annotations

import re
import struct
import time
import tracemalloc
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType

from geomphys.config import Config
from geomphys.errors import DamagedLogError, LogError
from geomphys.recording import mcap_scan
from geomphys.recording.frames import FrameSource
from geomphys.recording.mcap_records import CHUNK_LIMIT, MAGIC, ChunkHeader, unpack_chunk
from geomphys.recording.reader import open_log
from tests.recording.log_files import Item, Tree, joints, make_world, pose, write_log

LAYOUTS = {
    "zstd": {"compression": CompressionType.ZSTD, "chunk_size": 3000},
    "lz4": {"compression": CompressionType.LZ4, "chunk_size": 3000},
    "none": {"compression": CompressionType.NONE, "chunk_size": 3000},
    "one chunk": {"compression": CompressionType.NONE},
    "no chunks": {"use_chunking": False},
}
WORLD = make_world(Tree(root="/wrist", topic="/glove", joints=("a",)))


def some_items(count: int = 100) -> list[Item]:
    items = []
    for k in range(count):
        items += [pose("/wrist", k / 100, (k, 0, 0, 0, 0, 0, 1)), joints("/glove", k / 100, {"a": 0.01 * k})]
    return items


def messages(path: Path, *, recover: bool = False) -> list[tuple]:
    reader = open_log(path, recover=recover)
    return [(reader.channels[m.key].topic, *m[1:4]) for m in reader.read()]


def record_ends(content: bytes, whole: list[bytes]) -> dict[bytes, int]:
    """Where each message's data ends in a log that is not compressed."""
    return {data: content.index(data) + len(data) for data in whole}


@pytest.mark.parametrize("layout", ["none", "one chunk", "no chunks"])
def test_every_message_before_the_cut_is_recovered(tmp_path, layout):
    path = write_log(tmp_path / "log.mcap", some_items(), **LAYOUTS[layout])
    content, whole = path.read_bytes(), messages(path)
    ends = record_ends(content, [m[3] for m in whole])
    for cut in range(len(MAGIC), len(content), 97):
        path.write_bytes(content[:cut])
        with pytest.raises(DamagedLogError) as caught:
            open_log(path)
        got = messages(path, recover=True)
        assert got == [m for m in whole if ends[m[3]] <= cut]
        said = re.search(r"(\d+) messages over ([\d.]+) s are intact; --recover", str(caught.value))
        assert int(said[1]) == len(got)
        assert float(said[2]) == pytest.approx((got[-1][1] - got[0][1]) / 1e9 if got else 0)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("layout", ["zstd", "lz4"])
def test_of_a_cut_compressed_log_whole_chunks_are_recovered_and_what_can_be_unpacked(tmp_path, layout):
    path = write_log(tmp_path / "log.mcap", some_items(), **LAYOUTS[layout])
    content, whole = path.read_bytes(), messages(path)
    counts = []
    for cut in range(len(MAGIC), len(content), 61):
        path.write_bytes(content[:cut])
        got = messages(path, recover=True)
        assert got == whole[: len(got)]
        counts.append(len(got))
    assert counts == sorted(counts)
    assert len(set(counts)) > 5
    assert counts[-1] == len(whole)


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_the_beginning_of_a_large_cut_chunk_is_unpacked(tmp_path, compression):
    """zstd and lz4 pack blocks of some 100 kB, each of which can be unpacked when it is whole."""
    import random

    noise = random.Random(1)
    items = [Item("/t", "raw", noise.randbytes(500), k) for k in range(4000)]
    path = write_log(tmp_path / "log.mcap", items, compression=compression, chunk_size=10**8)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    got = messages(path, recover=True)
    assert 1500 < len(got) < 2100
    assert [m[3] for m in got] == [m.value for m in items[: len(got)]]


@pytest.mark.parametrize("layout", sorted(LAYOUTS))
def test_damage_in_the_middle_costs_what_it_hits_and_not_what_is_behind(tmp_path, layout):
    path = write_log(tmp_path / "log.mcap", some_items(400), **LAYOUTS[layout])
    content, whole = path.read_bytes(), messages(path)
    spans = open_log(path)._scans[0].spans
    at = spans[len(spans) // 2].offset + spans[len(spans) // 2].length // 2
    path.write_bytes(content[:at] + b"\xa5" * 40 + content[at + 40 :])
    if layout != "no chunks":  # where there is no checksum, damage to a message's data cannot be seen
        with pytest.raises(DamagedLogError, match="--recover"):
            open_log(path)
    got = messages(path, recover=True)
    known = set(whole)
    assert sum(m in known for m in got) >= 0.9 * len(whole) or layout == "one chunk"
    assert len(got) - sum(m in known for m in got) <= 3
    if layout != "one chunk":
        assert got[-1] == whole[-1]


@pytest.mark.parametrize("layout", sorted(LAYOUTS))
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_flipped_bytes_never_give_more_than_an_error_of_one_line(tmp_path, layout, data):
    path = tmp_path / f"{layout}.mcap"
    if not path.exists():
        write_log(path, some_items(), **LAYOUTS[layout])
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(st.integers(1, 255))
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(bytes(content))
    for recover in (False, True):
        try:
            with FrameSource(broken, WORLD, Config(recover=recover)) as source:
                frames = list(source)
                assert source.report.frames == len(frames)
        except LogError as problem:
            lines = str(problem).splitlines()
        else:
            lines = [""]
        assert len(lines) == 1


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=300), st.integers(0, 15))
def test_any_bytes_behind_the_magic_are_damage_and_no_more(tmp_path, content, opcode):
    path = tmp_path / "noise.mcap"
    for body in (content, bytes([opcode]) + struct.pack("<Q", len(content)) + content):
        path.write_bytes(MAGIC + body)
        with pytest.raises(DamagedLogError):
            open_log(path)
        assert open_log(path, recover=True).damage is not None


def record(opcode: int, body: bytes, length: int | None = None) -> bytes:
    return bytes([opcode]) + struct.pack("<Q", len(body) if length is None else length) + body


def chunk(compression: bytes, data: bytes, size: int, length: int | None = None) -> bytes:
    head = struct.pack("<QQQI", 0, 10**9, size, 0) + struct.pack("<I", len(compression)) + compression
    return record(6, head + struct.pack("<Q", len(data) if length is None else length) + data)


BOMB = bytes(64 * 2**20)


def wide_window() -> bytes:
    """A thousand bytes that claim to need half a gigabyte to be unpacked."""
    window = zstandard.ZstdCompressionParameters(window_log=29, enable_ldm=True)
    packer = zstandard.ZstdCompressor(compression_params=window).compressobj()
    return packer.compress(bytes(1000)) + packer.flush()


def hostile() -> dict[str, bytes]:
    zstd = zstandard.ZstdCompressor(level=1).compress(BOMB)
    packed = lz4.frame.compress(BOMB)
    return {
        "absurd length": record(5, b"x" * 30, 2**63),
        "length past the end": record(6, b"x" * 30, 10**12),
        "zero bytes": bytes(10_000_000),
        "chunk of chunks": chunk(b"", chunk(b"", b"", 0) * 1000, 1000 * 49),
        "claims terabytes": chunk(b"zstd", zstd, 2**42),
        "claims just the limit": chunk(b"zstd", b"", CHUNK_LIMIT),
        "bomb zstd": chunk(b"zstd", zstd, 1000) * 20,
        "bomb lz4": chunk(b"lz4", packed, 1000) * 20,
        "wide window": chunk(b"zstd", wide_window(), 1000),
        "unknown packing": chunk(b"brotli", b"abc", 1000),
        "long name of packing": chunk(b"z" * 100_000, b"abc", 1000),
        "chunk shorter than its data": chunk(b"", b"abc", 3, 10**15),
        "schema of strings too long": record(3, b"\1\0" + b"\xff" * 20),
        "channel of strings too long": record(4, b"\1\0\0\0" + b"\xff" * 20),
        "metadata that goes on": record(12, b"\1\0\0\0a" + b"\xff" * 20),
        "message without a channel": record(5, bytes(22)) * 1000,
        "message too short": record(5, b"abc"),
        "time beyond the limit": record(5, b"\0" * 6 + b"\xff" * 16),
        "unknown opcodes": record(0x30, b"abc") * 100,
        "false starts": record(5, bytes(22))[:9] * 20_000,
        "small records, then nonsense": (record(15, bytes(4)) * 5 + b"\xff") * 20_000,
    }


def test_what_is_kept_of_definitions_is_bounded(tmp_path, monkeypatch):
    """Schemas and metadata of more than the limit together; the same once more, as in a summary, costs nothing."""
    monkeypatch.setattr(mcap_scan, "DEFINITIONS_LIMIT", 10_000)
    path = write_log(tmp_path / "log.mcap", some_items(), **LAYOUTS["zstd"])
    whole = messages(path)
    content = path.read_bytes()
    after = open_log(path)._scans[0].spans[0].offset
    notes = record(12, struct.pack("<I", 4) + b"note" + struct.pack("<I", 0) + bytes(1000))
    for count, fine in ((5, True), (100, False)):
        path.write_bytes(content[:after] + notes * count + content[after:])
        recovered = open_log(path, recover=True)
        assert len(recovered.metadata) <= 10
        assert ("more than the limit of 10000" in recovered.damage.text if recovered.damage else "") == (not fine)
        assert messages(path, recover=True) == whole


@pytest.mark.parametrize("name", sorted(hostile()))
def test_hostile_logs_cost_little_time_and_memory(tmp_path, name):
    path = tmp_path / "log.mcap"
    path.write_bytes(MAGIC + record(1, bytes(8)) + hostile()[name])
    tracemalloc.start()
    start = time.process_time()
    with pytest.raises(DamagedLogError) as caught:
        open_log(path)
    reader = open_log(path, recover=True)
    assert list(reader.read()) == []
    spent = time.process_time() - start
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(str(caught.value)) < 1500
    assert "\n" not in str(caught.value)
    assert spent < 20
    assert peak < 64 * 2**20 or name == "claims just the limit"


def test_names_from_a_log_are_told_in_one_line_without_control_characters(tmp_path):
    wild = "/a\n\x1b[31m\u202e" + "x" * 100_000
    items = [joints(wild, k / 10, {wild: 1.0, "b" * 10**6: 2.0}) for k in range(3)] + [pose("/wrist", 0.0, (0,) * 7)]
    path = write_log(tmp_path / "log.mcap", items)
    said = []
    for world in (WORLD, make_world(Tree(root=wild)), make_world(Tree(topic=wild, joints=("a",)))):
        with pytest.raises(LogError) as caught:
            FrameSource(path, world, Config())
        said.append(str(caught.value).replace(repr(wild), ""))
    with FrameSource(path, make_world(Tree(topic=wild, joints=(wild,))), Config()) as source:
        assert len(list(source)) == 3
        said += [w.replace(wild, "") for w in source.report.warnings]
    assert all(s.isprintable() and len(s) < 1000 for s in said)


@pytest.mark.parametrize("encoding", ["ros2", "json", "protobuf"])
def test_absurdly_long_messages_are_not_decoded(tmp_path, encoding):
    long = {"a": 1.0, "long" * (10**6 + 10**5): 0.0}
    items = [joints("/glove", k / 10, long if k == 2 else {"a": 1.0}) for k in range(5)]
    path = write_log(tmp_path / "log.mcap", items, encoding=encoding)
    with FrameSource(path, make_world(Tree(topic="/glove", joints=("a",))), Config()) as source:
        assert len(list(source)) == 4
        assert source.report.bad_messages == 1


def test_a_window_that_takes_much_memory_is_refused():
    data = wide_window()
    head = ChunkHeader(0, 1, 1000, 0, "zstd", len(data), 0)
    assert unpack_chunk(head, data) == (b"", "cannot be unpacked to its end")


@pytest.mark.parametrize("layout", ["none", "one chunk"])
def test_a_wrong_byte_in_a_message_is_seen_by_the_chunks_checksum_and_told(tmp_path, layout):
    path = write_log(tmp_path / "log.mcap", some_items(), **LAYOUTS[layout])
    content, whole = bytearray(path.read_bytes()), messages(path)
    at = content.index(struct.pack("<d", 41.0))
    content[at + 6] ^= 0x10
    path.write_bytes(bytes(content))
    with pytest.raises(DamagedLogError, match=r"chunk at byte \d+ does not fit its checksum"):
        open_log(path)
    got = messages(path, recover=True)
    assert len(got) == len(whole)
    assert sum(a != b for a, b in zip(got, whole, strict=True)) == 1


def test_of_a_corrupt_chunk_messages_outside_of_its_times_are_not_used(tmp_path):
    path = write_log(tmp_path / "log.mcap", some_items(), **LAYOUTS["one chunk"])
    content, whole = bytearray(path.read_bytes()), messages(path)
    at = content.index(struct.pack("<QQ", 410_000_000, 410_000_000))
    content[at + 6] ^= 0x10
    path.write_bytes(bytes(content))
    assert messages(path, recover=True) == [m for k, m in enumerate(whole) if k != 82]
    assert open_log(path, recover=True).messages == len(whole) - 1


def test_a_channel_that_is_defined_twice_and_differently_is_damage(tmp_path):
    path = write_log(tmp_path / "log.mcap", some_items(3), use_chunking=False, enable_crcs=False)
    content = path.read_bytes()
    last = content.rindex(b"/wrist")
    path.write_bytes(content[:last] + b"/wrong" + content[last + 6 :])
    with pytest.raises(DamagedLogError, match="channel 1 is defined twice"):
        open_log(path)
    assert {m[0] for m in messages(path, recover=True)} == {"/wrist", "/glove"}


def test_the_checksums_of_summary_and_data_are_checked(tmp_path):
    path = write_log(tmp_path / "log.mcap", some_items(), use_chunking=False, enable_data_crcs=True)
    content, whole = bytearray(path.read_bytes()), messages(path)
    for at, said in (
        (content.index(struct.pack("<d", 41.0)) + 6, "the data does not fit its checksum"),
        (content.rindex(b"/wrist") - 12, "the summary does not fit its checksum"),
    ):
        broken = content.copy()
        broken[at] ^= 0x10
        path.write_bytes(bytes(broken))
        with pytest.raises(DamagedLogError, match=said):
            open_log(path)
        assert len(messages(path, recover=True)) == len(whole)


def test_private_records_are_passed_over(tmp_path):
    path = write_log(tmp_path / "log.mcap", some_items(3), enable_crcs=False)
    content = path.read_bytes()
    (tmp_path / "private.mcap").write_bytes(MAGIC + record(0x80, b"mine") + content[len(MAGIC) :])
    assert messages(tmp_path / "private.mcap") == messages(path)


def test_an_unfinished_log_says_so_and_loses_nothing(tmp_path):
    path = write_log(tmp_path / "log.mcap", some_items(), use_chunking=False)
    content, whole = path.read_bytes(), messages(path)
    end = content.rindex(record(15, bytes(4)))
    path.write_bytes(content[:end])
    with pytest.raises(DamagedLogError, match="was not finished"):
        open_log(path)
    reader = open_log(path, recover=True)
    assert messages(path, recover=True) == whole
    assert reader.damage.bytes_lost == 0


def test_bytes_behind_the_end_are_damage(tmp_path):
    path = write_log(tmp_path / "log.mcap", some_items(3))
    path.write_bytes(path.read_bytes() + b"tail")
    with pytest.raises(DamagedLogError, match="4 bytes stand behind the end"):
        open_log(path)


def test_a_chunk_that_is_not_there_is_noticed_by_the_files_own_count(tmp_path):
    path = write_log(tmp_path / "log.mcap", some_items(), **LAYOUTS["none"], enable_crcs=False)
    content = bytearray(path.read_bytes())
    span = open_log(path)._scans[0].spans[2]
    content[span.offset] = 0x80  # a record of a kind that is passed over
    path.write_bytes(bytes(content))
    with pytest.raises(DamagedLogError, match=r"of 200 messages.*, 30 are not there"):
        open_log(path)


def test_recovered_frames_are_those_of_the_whole_log_and_the_loss_is_reported(tmp_path):
    path = write_log(tmp_path / "log.mcap", some_items(300), **LAYOUTS["zstd"])
    with FrameSource(path, WORLD, Config()) as source:
        whole = [(f.time_ns, f.roots.tobytes(), f.angles.tobytes()) for f in source]
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 2 // 3])
    with pytest.raises(DamagedLogError):
        FrameSource(path, WORLD, Config())
    with FrameSource(path, WORLD, Config(recover=True)) as source:
        got = [(f.time_ns, f.roots.tobytes(), f.angles.tobytes()) for f in source]
        report = source.report
    assert got[:-1] == whole[: len(got) - 1]
    assert got[-1][:2] == whole[len(got) - 1][:2]  # of the last frame the joints may be lost
    assert 50 < len(got) < 300
    assert report.bytes_lost > 0
    assert report.recovered
    assert any("damaged" in w for w in report.warnings)


def test_a_log_that_changes_while_it_is_read_is_an_error(tmp_path):
    path = write_log(tmp_path / "log.mcap", some_items(), **LAYOUTS["zstd"])
    reader = open_log(path)
    content = path.read_bytes()
    for changed in (content[: len(content) // 2], b"", bytes(len(content)), content[:8] + b"\xff" * (len(content) - 8)):
        path.write_bytes(changed)
        with pytest.raises(LogError, match=r"changed|cannot be read"):
            list(reader.read())
    path.unlink()
    with pytest.raises(LogError, match="cannot be read"):
        list(reader.read())
