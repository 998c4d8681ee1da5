"""What people have in place of an MCAP was only said to be none: now each is named with what to do about it."""

from __future__ import annotations

import bz2
import gzip
import lzma
import zipfile
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from geomphys_cli.main import run

from geomphys.errors import LogError
from geomphys.recording.reader import open_log
from tests.recording.log_files import pose, write_log

POINTER = (
    b"version https://git-lfs.github.com/spec/v1\n"
    b"oid sha256:4d7a214614ab2935c943f9e0ff69d22eadbb8f32b1258daaa5e2ca24d17e2393\nsize 12345\n"
)


def whole(folder: Path) -> bytes:
    return write_log(
        folder / "whole.mcap", [pose("/wrist", k / 10, (k, 0, 0, 0, 0, 0, 1)) for k in range(10)]
    ).read_bytes()


def zipped(folder: Path) -> bytes:
    with zipfile.ZipFile(folder / "log.zip", "w") as archive:
        archive.writestr("log.mcap", whole(folder))
    return (folder / "log.zip").read_bytes()


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (lambda _: POINTER, "Git LFS pointer.*git lfs pull"),
        (lambda _: b"<!DOCTYPE html>\n<html><head></head></html>", "web page.*raw or download link"),
        (lambda _: b"\n  <HTML lang='en'>", "web page"),
        (lambda _: b"", "is empty.*copy it again"),
        (lambda _: b"#ROSBAG V2.0\n" + bytes(50), "ROS 1 bag.*mcap convert"),
        (lambda _: b"SQLite format 3\0" + bytes(50), "SQLite.*ros2 bag convert"),
        (lambda f: gzip.compress(whole(f)), "gzip.*gunzip"),
        (lambda f: zstandard.compress(whole(f)), "zstd -d"),
        (lambda f: lz4.frame.compress(whole(f)), "lz4 -d"),
        (lambda f: bz2.compress(whole(f)), "bunzip2"),
        (lambda f: lzma.compress(whole(f)), "unxz"),
        (zipped, "unzip"),
        (lambda _: b'{"a": 1}', "a text"),
        (lambda _: b"<?xml version='1.0'?><Error/>", "a text"),
        (lambda _: b"\x89PNG\r\n\x1a\n", "not an MCAP"),
    ],
)
def test_each_is_named_with_what_to_do(
    tmp_path: Path, content: Callable[[Path], bytes], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(content(tmp_path))
    for recover in (False, True):
        with pytest.raises(LogError, match=says):
            open_log(path, recover=recover)
    assert run(["info", str(path)]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_the_case(shared_dir: Path) -> None:
    with pytest.raises(LogError, match="git lfs pull"):
        open_log(shared_dir / "cases" / "mesh_messages" / "lfs.mcap")
