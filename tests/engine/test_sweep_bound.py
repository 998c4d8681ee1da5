"""What grips leaves nothing inside anything, and its contact solve converges."""

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


def test_what_two_hands_hold_is_solved_in_every_frame() -> None:
    """Sweeps alone left more than the bound of the flag in 17 of 1,910 steps."""
    results = replay_until("two_hands", 3.6)
    assert not any(r.metrics.flags & FLAG_SWEEP_BOUND for r in results)
    assert FLAG_NAMES[FLAG_SWEEP_BOUND] == "sweep_bound"
