"""A file format is one registry entry: a toy sink of JSON lines gets every frame of a replay that names its suffix."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import geomphys
from geomphys.config import Config
from geomphys.output.file_sinks import FILE_SINKS, FileSinkOptions, file_sink, make_file_sink
from geomphys.output.mcap_sink import McapSink
from geomphys.output.provenance import Provenance
from geomphys.output.rerun_sink import RerunSink
from geomphys.output.sink import ContextManaged
from geomphys.results import FrameResult
from geomphys.scene.world import World
from geomphys.storage.output_file import OutputFile
from tests.cli.press import SCENE, write_log


class JsonLinesSink(ContextManaged):
    """Writes one JSON object a line: the header, each frame, the footer."""

    def __init__(self, path: Path, *, force: bool) -> None:
        self._path, self._force = path, force
        self._lines: list[str] = []

    def open(self, world: World, config: Config, provenance: Provenance) -> None:
        self._output = OutputFile(self._path, force=self._force, inputs=provenance.files)
        self._lines = [json.dumps({"bodies": world.body_names, "seed": config.seed, "version": provenance.version})]

    def write(self, result: FrameResult) -> None:
        self._lines.append(json.dumps({"frame": result.frame.index, "corrected": result.corrected.tolist()}))

    def close(self, complete: bool) -> None:
        self._lines.append(json.dumps({"complete": complete}))
        self._output.stream.write(("\n".join(self._lines) + "\n").encode())
        self._output.publish(complete)


@pytest.fixture
def jsonl() -> Iterator[None]:
    @file_sink(".jsonl")
    def _json_lines(path: Path, options: FileSinkOptions) -> JsonLinesSink:
        return JsonLinesSink(path, force=options.force)

    yield
    del FILE_SINKS[".jsonl"]


@pytest.mark.usefixtures("jsonl")
def test_a_registered_sink_gets_every_frame(tmp_path: Path) -> None:
    log, scene, out = tmp_path / "press.mcap", tmp_path / "scene.toml", tmp_path / "out.JSONL"
    write_log(log)
    scene.write_text(SCENE)
    summary = geomphys.run(log, scene, out=out)
    header, *frames, footer = map(json.loads, out.read_text().splitlines())
    expected = list(geomphys.replay(log, scene))
    assert summary.frames == len(frames) == len(expected) > 0
    assert [frame["frame"] for frame in frames] == [result.frame.index for result in expected]
    assert [frame["corrected"] for frame in frames] == [result.corrected.tolist() for result in expected]
    assert header["version"] == geomphys.__version__
    assert footer == {"complete": True}


@pytest.mark.parametrize(
    ("name", "kind"),
    [("a.mcap", McapSink), ("a.rrd", RerunSink), ("a.RRD", RerunSink), ("a.result", McapSink), ("a", McapSink)],
)
def test_the_suffix_chooses_the_sink_and_others_are_written_as_the_default(
    name: str, kind: type, tmp_path: Path
) -> None:
    assert isinstance(make_file_sink(tmp_path / name, FileSinkOptions(), default=".mcap"), kind)


def test_the_registry_imports_no_format_before_it_is_written() -> None:
    code = (
        "import sys, geomphys.output.file_sinks\n"
        "print([m for m in sys.modules if m in ('rerun', 'geomphys.output.mcap_sink', 'geomphys.output.rerun_sink')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
