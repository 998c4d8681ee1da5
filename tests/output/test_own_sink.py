"""A sink of one's own: one class, no other file touched."""

from __future__ import annotations

import csv
from itertools import islice
from pathlib import Path

import pytest

import geomphys
from geomphys.config import Config
from geomphys.output.memory_sink import MemorySink
from geomphys.output.provenance import Provenance
from geomphys.results import FrameResult
from geomphys.scene.world import World
from tests.cli.press import SCENE, write_log


class TableSink:
    """Writes position and overlap of each frame as comma-separated values."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.complete: bool | None = None

    def open(self, world: World, config: Config, provenance: Provenance) -> None:
        """Write the head."""
        self._stream = self.path.open("w", newline="")
        self._rows = csv.writer(self._stream)
        self._body = world.body_names.index("finger")
        self._rows.writerow(["frame", "z", "recorded_penetration_m"])

    def write(self, result: FrameResult) -> None:
        """Add a row."""
        height = float(result.corrected[self._body, 2])
        self._rows.writerow([result.frame.index, repr(height), repr(result.metrics.recorded_penetration_m)])

    def close(self, complete: bool) -> None:
        """Close the file."""
        self._stream.close()
        self.complete = complete


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """A sphere pressed into a table: log and scene."""
    log, scene = tmp_path / "press.mcap", tmp_path / "scene.toml"
    write_log(log)
    scene.write_text(SCENE)
    return log, scene


def test_a_sink_of_ones_own_gets_every_frame(files: tuple[Path, Path], tmp_path: Path) -> None:
    table, memory = TableSink(tmp_path / "table.csv"), MemorySink()
    results = list(geomphys.replay(*files, sinks=[table, memory]))
    with table.path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [int(row["frame"]) for row in rows] == [r.frame.index for r in results] == list(range(60))
    assert [float(row["recorded_penetration_m"]) for row in rows] == [r.metrics.recorded_penetration_m for r in results]
    assert min(float(row["z"]) for row in rows) >= 0.05  # never in the table
    assert min(r.recorded[-1, 2] for r in results) < 0.05
    assert memory.results == results
    assert memory.world is not None
    assert memory.world.body_names == ["table", "finger"] or "finger" in memory.world.body_names
    assert table.complete is memory.complete is True


def test_a_sink_is_told_when_frames_are_missing(files: tuple[Path, Path], tmp_path: Path) -> None:
    table, memory = TableSink(tmp_path / "table.csv"), MemorySink()
    frames = geomphys.replay(*files, sinks=[table, memory])
    assert len(list(islice(frames, 5))) == 5
    frames.close()  # type: ignore[attr-defined]
    assert table.complete is memory.complete is False
    assert len(memory.results) >= 5


def test_a_memory_sink_forgets_an_earlier_run(files: tuple[Path, Path]) -> None:
    memory = MemorySink()
    for _ in range(2):
        assert len(list(geomphys.replay(*files, sinks=[memory]))) == len(memory.results) == 60
