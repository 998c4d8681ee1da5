"""What grips leaves nothing inside anything, and a contact solve that has not converged is told."""

from __future__ import annotations

from pathlib import Path

import geomphys
from geomphys.output.summary import FLAG_NAMES
from geomphys.results import FLAG_NOT_CONVERGED, FLAG_SWEEP_BOUND

ROOT = Path(__file__).resolve().parents[2]


def replay_until(name: str, end: float) -> list[geomphys.FrameResult]:
    """The results of a recording of this project up to a time [s]."""
    world = geomphys.load_world(ROOT / "assets" / "scenes" / f"{name}.toml")
    return list(geomphys.replay(ROOT / "recordings" / f"{name}.mcap", world, config=geomphys.Config(end=end)))


def test_a_gripped_cube_is_left_in_nothing() -> None:
    results = replay_until("gripper_cube", 2.6)
    assert max(r.metrics.residual_penetration_m for r in results) < 2e-6
    assert not any(r.metrics.flags & (FLAG_NOT_CONVERGED | FLAG_SWEEP_BOUND) for r in results)


def test_the_bound_on_sweeps_is_told_where_what_is_held_may_creep() -> None:
    results = replay_until("two_hands", 3.6)
    flagged = [r.frame.index for r in results if r.metrics.flags & FLAG_SWEEP_BOUND]
    assert 0 < len(flagged) < 10
    assert min(flagged) > 150  # the hands press the box then
    texts = [text for r in results for _, text in r.messages]
    assert any("sweeps" in text for text in texts)
    assert FLAG_NAMES[FLAG_SWEEP_BOUND] == "sweep_bound"
