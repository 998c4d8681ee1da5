"""A server that gives no parts of files, or refuses, was told in the words of a library, or taken for a missing file."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from geomphys_cli.main import run
from mcap.writer import CompressionType

from geomphys.recording.reader import open_log
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
