"""A gripper closes on a cube that stands on a table: nothing is left inside anything, and a solve that is not settled is told."""

from __future__ import annotations

from pathlib import Path

import geomphys
from geomphys.output.summary import FLAG_NAMES
from geomphys.results import FLAG_NOT_CONVERGED, FLAG_SWEEP_BOUND

ROOT = Path(__file__).resolve().parents[2]


def test_a_gripped_cube_is_left_in_nothing_and_the_bound_on_sweeps_is_told() -> None:
    world = geomphys.load_world(ROOT / "assets" / "scenes" / "gripper_cube.toml")
    log = ROOT / "recordings" / "gripper_cube.mcap"
    results = list(geomphys.replay(log, world, config=geomphys.Config(end=2.6)))
    assert max(r.metrics.residual_penetration_m for r in results) < 2e-6
    assert not any(r.metrics.flags & FLAG_NOT_CONVERGED for r in results)
    flagged = [r.frame.index for r in results if r.metrics.flags & FLAG_SWEEP_BOUND]
    assert 0 < len(flagged) < 10
    assert min(flagged) > 130  # the jaws close then
    texts = [text for r in results for _, text in r.messages]
    assert any("sweeps" in text for text in texts)
    assert FLAG_NAMES[FLAG_SWEEP_BOUND] == "sweep_bound"
