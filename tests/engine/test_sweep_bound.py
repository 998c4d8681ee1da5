"""What grips leaves nothing inside anything, and its contact solve converges; what is too large for it is flagged."""

from __future__ import annotations

from pathlib import Path

import pytest

import geomphys
from geomphys.output.summary import FLAG_NAMES
from geomphys.results import FLAG_NOT_CONVERGED, FLAG_SWEEP_BOUND
from tests.laws.replayed import UPRIGHT, play, thing

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


@pytest.mark.parametrize(("boxes", "flagged"), [(18, False), (22, True)])
def test_a_stack_of_more_boxes_than_newtons_method_takes_is_flagged(tmp_path: Path, boxes: int, flagged: bool) -> None:
    """With 2 kg on boxes of 20 g, on a driven plate, sweeps end at their bound: they carry a load from box to box."""
    height = 0.02
    things = [thing("plate", "driven", box=(0.2, 0.2, 0.02), topic="/plate", mass=0.4)]
    for k in range(boxes):
        at, mass = (0, 0, 0.01 + 2e-6 + k * (height + 2e-6) + 0.5 * height), 2.0 if k == boxes - 1 else 0.02
        things.append(thing(f"box{k}", box=(0.04, 0.04, height), position=at, mass=mass))
    run = play(tmp_path, things, 0.1, paths={"/plate": lambda _: (0, 0, 0, *UPRIGHT)})
    assert bool(run.flags & FLAG_SWEEP_BOUND) == flagged
    assert run.overlap < 1e-5
