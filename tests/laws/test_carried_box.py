"""Two hands, two avatars, carry a simulated box that neither could carry alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.engine.grasps import GraspMeter
from geomphys.load import load_world
from geomphys.replays import replay
from geomphys.results import Grasp
from tests.laws.replayed import GRAVITY, Run

ROOT = Path(__file__).resolve().parents[2]
RATE, MASS = 60.0, 0.5  # Hz, kg
HELD = slice(240, 480)  # frames in which the hands alone carry it


@pytest.fixture(scope="module")
def carried() -> tuple[Run, tuple[Grasp, ...]]:
    world = load_world(ROOT / "assets" / "scenes" / "two_hands.toml")
    meter, results = GraspMeter(world), []
    for result in replay(ROOT / "recordings" / "two_hands.mcap", world):
        meter.add(result)
        results.append(result)
    return Run(world, results), meter.grasps()


def test_it_is_lifted_carried_and_set_down(carried: tuple[Run, tuple[Grasp, ...]]) -> None:
    run, (grasp,) = carried
    path = run.path("box")[:, :3]
    assert path[HELD, 2].max() > 0.995
    np.testing.assert_allclose(path[-1], (0.3, 0.0, 0.8), atol=2e-3)
    assert grasp.held_s > 4.5
    assert grasp.lifted_m > 0.19
    assert grasp.dropped == 0
    assert grasp.margin > 2.0
    assert max(r.metrics.residual_penetration_m for r in run.results) < 1e-5


def test_hands_press_alike_and_friction_carries_the_weight(carried: tuple[Run, tuple[Grasp, ...]]) -> None:
    run, _ = carried
    pressed, friction = np.zeros(3), 0.0
    for result in run.results[HELD]:
        c = result.contacts
        sign = np.where(c.body_a == run.world.body_names.index("box"), 1.0, -1.0)
        pressed += (sign * c.normal_impulse) @ c.normal
        friction += float(c.tangential_impulse.sum())
    seconds = (HELD.stop - HELD.start) / RATE
    assert abs(pressed[1]) / seconds < 0.5  # of 19 N a side: edges of the box press a little askew
    assert friction / seconds > MASS * GRAVITY


def test_it_stays_between_the_palms(carried: tuple[Run, tuple[Grasp, ...]]) -> None:
    run, _ = carried
    names = run.world.body_names
    palms = 0.5 * (run.path("near/palm") + run.path("far/palm"))
    beside = (run.path("box") - palms)[HELD, :3]
    assert np.ptp(beside, axis=0).max() < 1e-3
    turned = Rotation.from_quat([r.corrected[names.index("box"), 3:] for r in run.results[HELD]]).magnitude()
    assert np.degrees(turned).max() < 3.0
