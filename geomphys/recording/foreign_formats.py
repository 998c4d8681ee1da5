"""Recognises files that are not MCAP by their first bytes and says how to convert them."""

from __future__ import annotations

from geomphys.scene.git_lfs import IS_POINTER, is_lfs_pointer

MAGIC_BYTES = 512
"""Bytes read from the beginning of a file."""
CONVERT_SQLITE = "convert it to mcap with `ros2 bag convert`, or without ROS by `mcap convert FILE.db3 OUT.mcap`"
"""What to do with a bag of the storage sqlite3."""

_COMPRESSED_FORMATS = (
    (b"\x28\xb5\x2f\xfd", "zstd", "zstd -d FILE"),
    (b"\x1f\x8b", "gzip", "gunzip FILE"),
    (b"\x04\x22\x4d\x18", "lz4", "lz4 -d FILE"),
    (b"BZh", "bzip2", "bunzip2 FILE"),
    (b"\xfd7zXZ\x00", "xz", "unxz FILE"),
    (b"PK\x03\x04", "zip", "unzip FILE"),
    (b"7z\xbc\xaf\x27\x1c", "7z", "7z x FILE"),
)
_EXPECTED = "expected a recording: an .mcap file or a ROS 2 bag folder"


def describe_foreign_format(start: bytes) -> str:
    """Describe a file that is not an MCAP by its first bytes; completes a sentence "FILE is not an MCAP file"."""
    if is_lfs_pointer(start):
        return f": it {IS_POINTER}"
    if start.startswith(b"#ROSBAG"):
        return " but a ROS 1 bag; convert it with `mcap convert IN.bag OUT.mcap`"
    if start.startswith(b"SQLite format 3"):
        return f" but an SQLite file, perhaps a ROS 2 bag of that storage; {CONVERT_SQLITE}"
    for magic, name, command in _COMPRESSED_FORMATS:
        if start.startswith(magic):
            return f" but a packed file ({name}); unpack it first: `{command}`"
    text = start.removeprefix(b"\xef\xbb\xbf").lstrip()
    if text[:15].lower().startswith((b"<!doctype html", b"<html", b"<head", b"<body")):
        return " but a web page, saved in place of the recording; fetch the file itself (its raw or download link)"
    if text[:1] in (b"<", b"[", b"#", b"{"):
        return f" but a text; {_EXPECTED}"
    return f"; {_EXPECTED}"
