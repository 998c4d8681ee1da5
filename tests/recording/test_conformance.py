"""The format's conformance suite, written anew: every variant is read for what it holds, and broken ones recovered or refused."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader

from geomphys.errors import DamagedLogError
from geomphys.recording.inspect import inspect_log
from geomphys.recording.mcap_scan import scan_file
from geomphys.recording.mcap_summary import scan_summary
from geomphys.recording.reader import open_log
from tests.recording import conformance as suite

VARIANTS = list(suite.variants())
WITH_MESSAGES = [found for found in VARIANTS if found[1].messages]


def read(path: Path, *, recover: bool = False) -> list[suite.Message]:
    with open_log(path, recover=recover) as log:
        return [suite.Message(m.sequence, m.log_time, m.publish_time, m.data) for m in log.read()]


def test_the_variants_are_as_many_as_were_published() -> None:
    count = {kind: sum(name.split("-")[0] == kind for name, *_ in VARIANTS) for kind in suite.CONTENTS}
    assert count["TenMessages"] == count["OneMessage"] == 154
    assert len({name for name, *_ in VARIANTS}) == len(VARIANTS) == 416


def test_the_library_reads_what_is_written_here() -> None:
    """An oracle for the writer: the official reader, which goes from record to record; it knows no unknown fields in chunks."""
    for name, content, features in (found for found in VARIANTS[::3] if "pad" not in found[2]):
        reader = NonSeekingReader(io.BytesIO(bytes(suite.write(content, features).data)), validate_crcs=True)
        found = [suite.Message(m.sequence, m.log_time, m.publish_time, m.data) for _, _, m in reader.iter_messages()]
        assert found == list(content.messages), name


@pytest.mark.parametrize("kind", suite.CONTENTS)
def test_every_variant_is_read_for_what_it_holds(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "log.mcap"
    for name, content, features in VARIANTS:
        if name.split("-")[0] != kind:
            continue
        path.write_bytes(suite.write(content, features).data)
        with open_log(path) as log:
            assert log.damage is None, name
            assert [suite.Message(m.sequence, m.log_time, m.publish_time, m.data) for m in log.read()] == list(
                content.messages
            ), name
            channels = [
                (c.topic, c.encoding, dict(c.metadata), c.schema_name, c.schema_encoding, c.schema_data, c.messages)
                for c in log.channels.values()
            ]
            schema = content.schema or ("", "", b"")
            expected = [(*content.channel, *schema, len(content.messages))] if content.channel else []
            assert channels == expected, name
            assert log.metadata == ((content.metadata,) if content.metadata else ()), name
        if not features:
            assert inspect_log(path).messages == len(content.messages)


def test_a_summary_gives_what_a_scan_gives_wherever_it_says_enough() -> None:
    """As a log behind a URL is opened: from statistics and indexes, with unknown fields too; else it is scanned."""
    for name, content, features in VARIANTS:
        data = bytes(suite.write(content, features).data)
        quick = scan_summary(io.BytesIO(data), len(data), lambda parts, data=data: [data[a:b] for a, b in parts])
        enough = {"st"} | ({"ch", "chx", "mx", "rch"} if content.messages else set())
        enough |= ({"rsh"} if content.schema else set()) | ({"mdx"} if content.metadata else set())
        assert (quick is not None) == (enough <= features), name
        if quick is None:
            continue
        scanned = scan_file(io.BytesIO(data), len(data))
        assert quick.schemas == scanned.schemas, name
        assert quick.channels == scanned.channels, name
        assert quick.metadata == scanned.metadata, name
        assert [s._replace(verified=True, usable=0) for s in quick.spans] == [
            s._replace(usable=0) for s in scanned.spans
        ], name


def test_what_is_cut_off_is_refused_in_one_line_and_recovered_up_to_the_cut(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    for name, content, features in WITH_MESSAGES[::23]:
        data = bytes(suite.write(content, features).data)
        ends = [data.index(m.data, data.index(b"example")) + 3 for m in content.messages]
        for cut in range(len(suite.MAGIC), len(data), 13):
            path.write_bytes(data[:cut])
            with pytest.raises(DamagedLogError) as caught:
                open_log(path)
            assert "\n" not in str(caught.value)
            expected = [m for m, end in zip(content.messages, ends, strict=True) if end <= cut]
            assert read(path, recover=True) == expected, (name, cut)


@pytest.mark.parametrize("what", ["opcode", "length"])
def test_a_record_that_is_none_costs_no_other_one(tmp_path: Path, what: str) -> None:
    path = tmp_path / "log.mcap"
    for name, content, features in WITH_MESSAGES[::7]:
        book = suite.write(content, features)
        own = [at for opcode, at in book.records if opcode == suite.MESSAGE]
        for opcode, at in book.records:
            data = bytearray(book.data)
            if what == "opcode":
                data[at] = 0
            else:
                data[at + 1 : at + 9] = b"\xff" * 8
            path.write_bytes(data)
            with pytest.raises(DamagedLogError) as caught:
                open_log(path)
            assert "\n" not in str(caught.value)
            got = read(path, recover=True)
            lost = own.index(at) if opcode == suite.MESSAGE else None
            if opcode == suite.CHANNEL and "rch" not in features:
                assert got == []
            else:
                assert got == [m for k, m in enumerate(content.messages) if k != lost], (name, opcode, what)


def with_records(book: suite.Book, opcode: int, step: int = 1) -> bytes:
    """A log with a record of another opcode before every `step`-th of its own."""
    data = bytearray(book.data)
    for _, at in reversed(book.records[1::step]):
        data[at:at] = suite.record(opcode, b"\x05" * 40, pad=False)
    return bytes(data)


@pytest.mark.parametrize("opcode", [0x10, 0x30, 0x7F, 0x80, 0xFF])
def test_records_of_unknown_opcodes_are_passed_over(tmp_path: Path, opcode: int) -> None:
    """The format may grow by records (up to 0x7f) and applications may add theirs; only the former are told."""
    path = tmp_path / "log.mcap"
    for name, content, features in WITH_MESSAGES[::5]:
        if features & {"mx", "chx", "sum"}:
            continue  # their offsets would no longer fit
        path.write_bytes(with_records(suite.write(content, features), opcode))
        assert read(path) == list(content.messages), name
        with open_log(path) as log:
            assert log.damage is None
            assert [c.schema_name for c in log.channels.values()] == [(content.schema or ("",))[0]]
            assert any(f"0x{opcode:02x}" in note for note in log.notes) == (opcode < 0x80), log.notes
            assert all("\n" not in note for note in log.notes)


@pytest.mark.parametrize("opcode", [0x10, 0x80])
def test_what_is_cut_off_or_damaged_among_unknown_opcodes_is_recovered(tmp_path: Path, opcode: int) -> None:
    path = tmp_path / "log.mcap"
    content = suite.CONTENTS["TenMessages"]
    data = with_records(suite.write(content, frozenset()), opcode)
    ends = [data.index(m.data, data.index(b"example")) + 3 for m in content.messages]
    for cut in range(len(suite.MAGIC), len(data), 13):
        path.write_bytes(data[:cut])
        with pytest.raises(DamagedLogError):
            open_log(path)
        assert read(path, recover=True) == [m for m, end in zip(content.messages, ends, strict=True) if end <= cut], cut
    for lost, end in enumerate(ends):
        broken = bytearray(data)
        broken[end - 3 - 22 - 9] = 0
        path.write_bytes(broken)
        assert read(path, recover=True) == [m for k, m in enumerate(content.messages) if k != lost], lost


@pytest.mark.parametrize("opcode", [0x10, 0x80])
def test_unknown_opcodes_in_a_chunk_are_passed_over_where_it_is_whole_and_where_it_is_cut_off(
    tmp_path: Path, opcode: int
) -> None:
    path = tmp_path / "log.mcap"
    content = suite.CONTENTS["TenMessages"]
    inner, ends = bytearray(), []
    body = suite.record(suite.MESSAGE, struct.pack("<HIQQ", 1, 0, 5, 5), pad=False) * 5  # looks like messages, is none
    book = suite.write(content, frozenset())
    for kind, at in book.records:
        if kind in (suite.SCHEMA, suite.CHANNEL, suite.MESSAGE):
            length = 9 + int.from_bytes(book.data[at + 1 : at + 9], "little")
            inner += suite.record(opcode, body, pad=False) + book.data[at : at + length]
            ends += [len(inner)] if kind == suite.MESSAGE else []
    chunked = suite.Book(pad=False)
    chunked.add(suite.HEADER, suite.text("") + suite.text(""))
    head = struct.pack("<QQQI", 0, 9, len(inner), 0) + suite.text("") + struct.pack("<Q", len(inner))
    chunked.add(suite.CHUNK, head + inner)
    start = len(chunked.data) - len(inner)
    chunked.add(suite.DATA_END, bytes(4))
    chunked.add(suite.FOOTER, bytes(20))
    path.write_bytes(chunked.data + suite.MAGIC)
    assert read(path) == list(content.messages)
    for cut in range(start, start + len(inner), 7):
        path.write_bytes(chunked.data[:cut])
        expected = [m for m, end in zip(content.messages, ends, strict=True) if start + end <= cut]
        assert read(path, recover=True) == expected, cut


def test_a_schema_of_number_zero_is_none(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    book = suite.write(suite.CONTENTS["OneSchemalessMessage"], frozenset())
    at = book.records[1][1]
    zero = [
        suite.record(suite.SCHEMA, b"\0\0" + suite.text(n) + suite.text("c") + suite.text(n), pad=False) for n in "ab"
    ]
    path.write_bytes(book.data[:at] + b"".join(zero) + book.data[at:])
    with open_log(path) as log:
        assert log.damage is None
        assert [c.schema_name for c in log.channels.values()] == [""]
