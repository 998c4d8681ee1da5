"""A log without a summary, as the official writer makes it on request, was called damaged: there is none to check."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest
from mcap.writer import CompressionType, IndexType

from geomphys.config import Config
from geomphys.load import load_world
from geomphys.recording.check import check_log
from geomphys.recording.frames import FrameSource
from geomphys.recording.reader import open_log
from tests.recording.log_files import Item, Tree, joints, make_world, pose, write_log
from tests.servers import web_server

FLAGS = (
    "use_statistics",
    "use_summary_offsets",
    "repeat_channels",
    "repeat_schemas",
    "enable_crcs",
    "enable_data_crcs",
)
INDEXES = (IndexType.NONE, IndexType.ALL, IndexType.CHUNK, IndexType.MESSAGE, IndexType.METADATA)
WORLD = make_world(Tree(root="/wrist", topic="/glove", joints=("a",)))


def items() -> list[Item]:
    made = []
    for k in range(40):
        made += [pose("/wrist", 5 + k / 100, (k, 0, 0, 0, 0, 0, 1)), joints("/glove", 5 + k / 100, {"a": 0.01 * k})]
    return made


@pytest.mark.parametrize("compression", [None, CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
@pytest.mark.parametrize("indexes", INDEXES)
def test_every_log_that_the_official_writer_makes_is_whole(
    tmp_path: Path, compression: CompressionType | None, indexes: IndexType
) -> None:
    """All combinations of its options; a compression of None is a log without chunks."""
    how = {"use_chunking": False} if compression is None else {"compression": compression, "chunk_size": 1500}
    for flags in itertools.product([False, True], repeat=len(FLAGS)):
        options = dict(zip(FLAGS, flags, strict=True)) | how | {"index_types": indexes}
        path = write_log(tmp_path / "log.mcap", items(), metadata={"note": {"a": "b"}}, **options)
        reader = open_log(path)
        assert reader.damage is None, options
        assert reader.messages == 80
        assert dict(reader.metadata)["note"] == {"a": "b"}
    with FrameSource(path, WORLD, Config()) as source:
        assert [f.roots[0, 0] for f in source] == list(range(40))


@pytest.mark.parametrize("indexes", INDEXES)
@pytest.mark.parametrize("statistics", [False, True])
def test_so_it_is_behind_a_url(tmp_path: Path, indexes: IndexType, statistics: bool) -> None:
    pytest.importorskip("aiohttp")
    off = dict.fromkeys(FLAGS[1:4], False)
    write_log(tmp_path / "log.mcap", items(), index_types=indexes, use_statistics=statistics, **off)
    with web_server(tmp_path) as web, open_log(f"{web.url}/log.mcap") as reader:
        assert sum(1 for _ in reader.read()) == 80


def test_a_summary_that_is_there_is_still_checked(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.mcap", items())
    content = bytearray(path.read_bytes())
    content[-8 - 4 - 30] ^= 1  # in the record before the footer
    path.write_bytes(content)
    assert open_log(path, recover=True).damage is not None


def test_the_case(shared_dir: Path) -> None:
    folder = shared_dir / "cases" / "whole_log_called_damaged"
    report = check_log(folder / "log.mcap", load_world(folder / "scene.toml"))
    assert report.errors == ()
    assert report.recording is not None
    assert report.recording.frames == 60
