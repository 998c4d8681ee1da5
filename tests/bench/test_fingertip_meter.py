"""Fingertips measured at the poses of a replay are as the replay's own metrics say."""

from __future__ import annotations

from pathlib import Path

import pytest

from geomphys.bench.fingertip_meter import FingertipMeter
from geomphys.config import Config
from geomphys.load import load_world
from geomphys.replays import replay


@pytest.mark.parametrize("mode", ["rigid", "chains"])
def test_the_figures_are_those_of_the_metrics(root: Path, mode: str) -> None:
    world = load_world(root / "assets/scenes/hand_ball.toml", mode=mode)
    meter, touching = FingertipMeter(world), 0
    config = Config(start=2.0, end=4.0)
    for result in replay(root / "recordings/hand_ball.mcap", world, config=config):
        found, metrics = meter.figures(result.recorded, result.corrected), result.metrics
        assert (found.recorded, found.retained) == (metrics.contacts_recorded, metrics.contacts_kept), (
            result.frame.index
        )
        assert found.error_m == pytest.approx(metrics.fingertip_error_m, abs=1e-9)
        touching += found.recorded
    assert touching > 50
