"""Fingertips at the poses of a replay and at others: the kernel of the metrics, the meter of peers and a plain twin agree."""

from __future__ import annotations

from pathlib import Path

import pytest

from geomphys.bench.fingertip_meter import FingertipMeter
from geomphys.config import Config
from geomphys.load import load_world
from geomphys.replays import replay
from geomphys.scene.arrays import DRIVEN
from tests.bench.fingertip_twin import PlainFingertipMeter


@pytest.mark.parametrize("mode", ["rigid", "chains"])
def test_the_figures_are_those_of_the_metrics_and_of_a_plain_twin(root: Path, mode: str) -> None:
    world = load_world(root / "assets/scenes/hand_ball.toml", mode=mode)
    meter, plain, touching, lost = FingertipMeter(world), PlainFingertipMeter(world), 0, 0
    driven = world.scene.bodies.role == DRIVEN
    for result in replay(root / "recordings/hand_ball.mcap", world, config=Config(start=2.0, end=4.0)):
        metrics, recorded, poses = result.metrics, result.recorded, result.corrected.copy()
        of_replay = (
            metrics.contacts_recorded,
            metrics.contacts_kept,
            pytest.approx(metrics.fingertip_error_m, abs=1e-9),
        )
        assert plain.figures(recorded, poses) == of_replay, result.frame.index
        assert meter.figures(recorded, poses) == of_replay, result.frame.index
        poses[driven, 2] += 1e-2 * (result.frame.index % 3)
        found = meter.figures(recorded, poses)
        expected = plain.figures(recorded, poses)
        assert found == (expected.recorded, expected.retained, pytest.approx(expected.error_m, abs=1e-9)), (
            result.frame.index
        )
        touching, lost = touching + found.recorded, lost + found.recorded - found.retained
    assert touching > 50
    assert lost > 3
