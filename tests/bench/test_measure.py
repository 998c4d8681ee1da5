"""Frames are measured as they are replayed, and peers get every frame once, in order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.bench.experiments import NAMES, experiment_files
from geomphys.bench.fingertip_meter import TipFigures
from geomphys.bench.measure import WARM_UP_FRAMES, PeerFrame, measure
from geomphys.bench.report import distribution_of
from geomphys.bench.run import BenchOptions, run_bench
from geomphys.bench.scaling import OVERLAP, Curve, block_of_pieces, curves, slide, table_of_hands, world_of_objects
from geomphys.config import Config
from geomphys.errors import ConfigError, InputError
from geomphys.results import FrameResult
from geomphys.scene.arrays import DRIVEN
from geomphys.scene.world import World

FRAMES = 70  # more than a block


class FakePeer:
    """Takes 1 ms for the first frame it gets, 2 ms for the next …; twice as long in its second life."""

    name, warnings = "fake 1.0", 0
    lives: list[FakePeer]

    def __init__(self, world: World, first: FrameResult) -> None:
        self.seen = [first.frame.index]
        self.lives.append(self)

    def frame(self, result: FrameResult) -> PeerFrame:
        self.seen.append(result.frame.index)
        return PeerFrame(1e6 * (len(self.seen) - 1) * len(self.lives), 3, 1e-3, TipFigures(2, 1, 4e-3))


@pytest.fixture(scope="module")
def hand(tmp_path_factory: pytest.TempPathFactory) -> World:
    return table_of_hands(tmp_path_factory.mktemp("hand"), 1)


def test_figures_of_a_known_series() -> None:
    figures = distribution_of(np.arange(101.0))
    assert (figures.count, figures.mean, figures.median, figures.p95, figures.p99, figures.max) == (
        101,
        50,
        50,
        95,
        99,
        100,
    )
    assert distribution_of(np.zeros(0)).count == 0


def test_peers_run_every_frame_in_turn_and_the_smallest_time_counts(hand: World) -> None:
    FakePeer.lives = []
    seen: list[int] = []
    experiment = slide("hand", hand, FRAMES)
    figures = measure(experiment, Config(), 2, (FakePeer,), lambda world, result: seen.append(result.frame.index))
    assert seen == list(range(FRAMES))
    assert [peer.seen for peer in FakePeer.lives] == [list(range(FRAMES))] * 2
    (peer,) = figures.peers
    assert peer.ns == distribution_of(1e6 * np.arange(1.0, FRAMES))
    assert (peer.engine, peer.steps_a_frame, peer.residual_m.max) == ("fake 1.0", 3.0, 1e-3)
    assert peer.ratio_median == figures.step.median / peer.ns.median
    assert peer.ratio_call == figures.call_ns / peer.ns.mean
    assert peer.ratio_p99 == figures.step.p99 / peer.ns.p99
    assert peer.ratio_mean == figures.step.mean / peer.ns.mean
    assert peer.ratio_max == figures.step.max / peer.ns.max
    assert (peer.fidelity.retained, peer.fidelity.touching_m.max, peer.fidelity.free_m.count) == (0.5, 4e-3, 0)


def test_stages_add_up_to_the_step(hand: World) -> None:
    figures = measure(slide("hand", hand, FRAMES), Config(), 1)
    stages = {stage.name: stage.ns for stage in figures.stages}
    assert figures.frames == FRAMES
    assert figures.step.count == FRAMES - WARM_UP_FRAMES
    assert stages.pop("step") == figures.step
    assert sum(ns.mean for ns in stages.values()) == pytest.approx(figures.step.mean, rel=0.01, abs=100.0)
    assert figures.call_ns > 0.0
    assert figures.hertz == pytest.approx(60.0)


def test_the_made_up_hands_are_as_deep_as_said_and_end_up_free(tmp_path: Path) -> None:
    one = measure(slide("hand", table_of_hands(tmp_path, 1), 8), Config(), 1)
    three = measure(slide("hands", table_of_hands(tmp_path, 3), 8), Config(), 1)
    for figures in (one, three):
        assert figures.recorded_m >= OVERLAP
        assert figures.residual_m.max <= 1e-5
        assert figures.contacts > 0
    assert three.contacts == 3 * one.contacts


def test_made_up_worlds_have_the_size_they_are_asked(tmp_path: Path) -> None:
    for count in (1, 6, 7):
        world = block_of_pieces(tmp_path, count)
        assert int(np.sum(world.scene.bodies.role[world.scene.pieces.body] != DRIVEN)) == count
        world = world_of_objects(tmp_path, count)
        assert len(world.scene.trees.role) - world.avatar_count == count


def test_a_curve_tells_of_every_point(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("geomphys.bench.scaling.FRAMES", 4)
    monkeypatch.setattr("geomphys.bench.scaling.HEAP_FRAMES", 4)
    for sizes in ("OBJECTS", "HANDS", "PIECES", "BALLS", "BOXES"):
        monkeypatch.setattr(f"geomphys.bench.scaling.{sizes}", (1, 2))
    told: list[int] = []
    drawn: list[Curve] = list(curves(Config(), 1, (), lambda: told.append(1)))
    assert len(drawn) == 5
    assert len(told) == 10
    for curve in drawn:
        assert curve.growth == curve.points[1].step.median / curve.points[0].step.median


def test_names_that_are_none_and_folders_without_recordings(tmp_path: Path) -> None:
    assert [files.name for files in experiment_files(None, ())] == list(NAMES)
    with pytest.raises(ConfigError, match="galery"):
        experiment_files(None, ["galery"])
    with pytest.raises(InputError, match=r"recordings/gallery_hand\.mcap"):
        run_bench(tmp_path, only=["gallery"])
    with pytest.raises(ConfigError, match="repeats = 0"):
        BenchOptions(repeats=0)
