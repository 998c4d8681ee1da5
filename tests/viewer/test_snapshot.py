"""Pictures of a frame, taken for real where there is a Vulkan driver."""

from __future__ import annotations

import glob
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from geomphys.config import Config
from geomphys.errors import ConfigError, InputError, LogError, OutputError, ViewerError
from geomphys.output import colours
from geomphys.output.mcap_sink import McapSink
from geomphys.output.provenance import provenance_of
from geomphys.output.rerun_sink import RerunSink
from geomphys.viewer import snapshot
from geomphys.viewer.snapshot import take_snapshot
from geomphys.viewer.view import as_recording
from tests.output.made_world import frames, make_world

needs_vulkan = pytest.mark.skipif(
    not glob.glob("/usr/share/vulkan/icd.d/*.json"),
    reason="there is no Vulkan driver: apt-get install mesa-vulkan-drivers",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Outputs of the same frames: out.rrd and out.mcap."""
    folder = tmp_path_factory.mktemp("out")
    world = make_world(folder / "scene", avatars=("hand",))
    provenance = provenance_of(world.path, world, Config())
    with RerunSink(folder / "out.rrd") as drawn, McapSink(folder / "out.mcap") as log:
        for sink in (drawn, log):
            sink.open(world, Config(), provenance)
        for result in frames(world, 30):
            drawn.write(result)
            log.write(result)
    return folder


def pixels(path: Path) -> NDArray[np.float64]:
    from matplotlib.image import imread

    return np.asarray(imread(path), np.float64)[:, :, :3]


def share_of(picture: NDArray[np.float64], colour: colours.Colour) -> float:
    """Share of the pixels that have the colour's hue, in whatever light."""
    wanted = np.array(colour[:3]) / np.linalg.norm(colour[:3])
    lit = picture.max(axis=2) > 0.15
    unit = picture / np.maximum(np.linalg.norm(picture, axis=2, keepdims=True), 1e-9)
    return float((lit & (unit @ wanted > 0.9995)).mean())


@needs_vulkan
def test_the_picture_of_a_recording_is_of_that_frame(folder: Path) -> None:
    free, touching, again = (folder / f"{name}.png" for name in ("free", "touching", "again"))
    take_snapshot(folder / "out.rrd", free, frame=1, size=(800, 600))
    take_snapshot(folder / "out.rrd", touching, frame=4, size=(800, 600))
    take_snapshot(folder / "out.rrd", again, frame=1, size=(800, 600))
    assert np.abs(pixels(free) - pixels(again)).max() < 0.02
    assert share_of(pixels(free), colours.IN_CONTACT) < 1e-4 < share_of(pixels(touching), colours.IN_CONTACT)


def test_the_picture_of_an_output_log_is_of_that_frame(folder: Path) -> None:
    free, touching, again = (folder / f"log_{name}.png" for name in ("free", "touching", "again"))
    take_snapshot(folder / "out.mcap", free, frame=1, size=(400, 300))
    take_snapshot(folder / "out.mcap", touching, frame=4, size=(400, 300))
    take_snapshot(folder / "out.mcap", again, frame=1, size=(400, 300))
    assert free.read_bytes() == again.read_bytes()
    assert pixels(free).shape == (300, 400, 3)
    assert share_of(pixels(free), colours.IN_CONTACT) < 1e-3 < share_of(pixels(touching), colours.IN_CONTACT)


def test_a_body_in_focus_is_what_is_seen(folder: Path) -> None:
    hand, table = folder / "hand.png", folder / "table.png"
    take_snapshot(folder / "out.mcap", hand, frame=4, size=(400, 300))
    take_snapshot(folder / "out.mcap", table, frame=4, size=(400, 300), focus="table")
    near, far = (share_of(pixels(path), colours.IN_CONTACT) for path in (hand, table))
    assert 0 < 10 * far < near, "the table is much larger than the hand"
    with pytest.raises(ConfigError, match="no body 'thumb' in the scene; it has hand/palm"):
        take_snapshot(folder / "out.mcap", folder / "x.png", focus="thumb")


def test_a_link_is_named_as_the_summary_or_as_the_output_does(folder: Path) -> None:
    pictures = [folder / "body.png", folder / "frame.png"]
    for path, name in zip(pictures, ("hand/palm", "palm"), strict=True):
        take_snapshot(folder / "out.mcap", path, frame=4, size=(200, 150), focus=name)
    assert pictures[0].read_bytes() == pictures[1].read_bytes()


def test_no_driver_is_needed_for_an_output_log(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("VK_ICD_FILENAMES", "VK_DRIVER_FILES"):
        monkeypatch.setenv(name, "/nowhere.json")
    take_snapshot(folder / "out.mcap", folder / "bare.png", frame=1, size=(64, 64))
    assert (folder / "bare.png").exists()


@needs_vulkan
def test_the_window_of_an_output_log_is_drawn_by_the_viewer(folder: Path) -> None:
    take_snapshot(folder / "out.mcap", folder / "window.png", frame=6, size=(800, 600), whole_window=True)
    assert pixels(folder / "window.png").shape[:2] == (600, 800)


@needs_vulkan
def test_a_frame_that_is_not_there_is_told(folder: Path) -> None:
    with pytest.raises(InputError, match="has no frame 30; it has 0 to 29"):
        take_snapshot(folder / "out.rrd", folder / "x.png", frame=30)
    assert not (folder / "x.png").exists()


def test_a_frame_that_is_not_in_the_log_is_told(folder: Path) -> None:
    with pytest.raises(LogError, match="has no frame 30; its last one is 29"):
        take_snapshot(folder / "out.mcap", folder / "x.png", frame=30)


def test_without_a_driver_the_remedy_is_told(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VK_ICD_FILENAMES", "/nowhere.json")
    monkeypatch.setenv("VK_DRIVER_FILES", "/nowhere.json")
    monkeypatch.setenv("WGPU_BACKEND", "vulkan")
    monkeypatch.setattr(snapshot, "TIMEOUT_S", 20.0)
    with pytest.raises(ViewerError, match=r"no graphics adapter; a snapshot of the output log \(.mcap\) needs none"):
        take_snapshot(folder / "out.rrd", folder / "x.png", frame=1)


@pytest.mark.parametrize("name", ["gone.rrd", "gone.mcap"])
def test_a_file_that_is_missing_is_told(folder: Path, name: str) -> None:
    with pytest.raises(InputError, match=name):
        take_snapshot(folder / name, folder / "x.png")


def test_a_file_of_another_kind_is_told(folder: Path) -> None:
    (folder / "notes.txt").write_text("no result")
    with pytest.raises(InputError, match=r"neither a rerun recording \(.rrd\) nor an output log"):
        take_snapshot(folder / "notes.txt", folder / "x.png")
    with pytest.raises(OutputError, match="does not exist"):
        take_snapshot(folder / "out.rrd", folder / "nowhere" / "x.png")


def test_an_output_log_becomes_the_recording_that_the_replay_writes(folder: Path) -> None:
    from rerun.chunk import RrdReader

    def rows(path: Path) -> dict[str, int]:
        counts: dict[str, int] = {}
        for chunk in RrdReader(path).stream():
            counts[str(chunk.entity_path)] = counts.get(str(chunk.entity_path), 0) + chunk.num_rows
        return counts

    with as_recording(folder / "out.mcap") as recording:
        assert rows(recording) == rows(folder / "out.rrd")
        assert len(RrdReader(recording).blueprints()) == 1
    assert not recording.exists()
