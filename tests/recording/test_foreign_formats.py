"""Files that are no MCAP are told by their first bytes, made by the libraries that write them."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import sqlite3
import zipfile

import lz4.frame
import pytest
import zstandard
from mcap.writer import Writer

from geomphys.recording.foreign_formats import MAGIC_BYTES, describe_foreign_format


def archive() -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        file.writestr("log.mcap", b"content")
    return buffer.getvalue()


PACKED = {
    "gzip": gzip.compress(b"content"), "bzip2": bz2.compress(b"content"), "xz": lzma.compress(b"content"),
    "lz4": lz4.frame.compress(b"content"), "zstd": zstandard.compress(b"content"), "zip": archive(),
}  # fmt: skip


@pytest.mark.parametrize("name", PACKED)
def test_packed_files_are_named_with_what_unpacks_them(name: str) -> None:
    text = describe_foreign_format(PACKED[name][:MAGIC_BYTES])
    assert f"({name})" in text
    assert "unpack it first" in text


def test_an_sqlite_bag_is_told() -> None:
    database = sqlite3.connect(":memory:")
    database.execute("CREATE TABLE topics (id INTEGER)")
    assert "SQLite" in describe_foreign_format(database.serialize()[:MAGIC_BYTES])
    assert "ros2 bag convert" in describe_foreign_format(database.serialize()[:MAGIC_BYTES])


@pytest.mark.parametrize(
    ("start", "said"),
    [
        (b"#ROSBAG V2.0\n", "ROS 1 bag"),
        (b"\xef\xbb\xbf\n <!DOCTYPE HTML><html>", "web page"),
        (b"<html><head>", "web page"),
        (b'{"a": 1}', "a text"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12\n", "Git LFS"),
        (b"", "expected a recording"),
        (b"\x89PNG\r\n", "expected a recording"),
    ],
)
def test_others_are_told_too(start: bytes, said: str) -> None:
    assert said in describe_foreign_format(start)


def test_nothing_else_is_said_of_an_mcap() -> None:
    buffer = io.BytesIO()
    writer = Writer(buffer)
    writer.start()
    writer.finish()
    assert describe_foreign_format(buffer.getvalue()[:MAGIC_BYTES]).startswith("; expected")
