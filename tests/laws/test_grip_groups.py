"""What is gripped does not depend on what is gripped elsewhere: not a bit of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.laws.replayed import Run, floor, play, thing
from tests.laws.test_grasp import CUBE, HALF, LIFTED, Task, frictions


def two_grips(folder: Path, rate: float, far: float, mass: float, stiffness: float, noise: float) -> Run:
    """A cube that jaws lift and turn, and another `far` [m] away, of another mass, between jaws of another stiffness."""
    task = Task(about=(0.0, 1.0, 0.5))
    things, paths = [], {}
    tremble = np.random.default_rng(3)
    for k, (at, m, spring) in enumerate(((0.0, 0.2, 1000.0), (far, mass, stiffness))):
        keys = f"coupling = {{ stiffness = {spring}, damping = {2 * np.sqrt(0.4 * spring)} }}\n"
        things.append(thing(f"thing_{k}", position=(at, 0, HALF), **{**CUBE, "mass": m}))
        for side in (-1.0, 1.0):
            name, way = f"jaw_{k}_{'left' if side < 0 else 'right'}", task.jaw(side)
            things.append(
                thing(name, "driven", topic=f"/{name}", box=(0.02, 0.06, 0.04), mass=0.4, material="human") + keys
            )
            shake = noise if k == 1 else 0.0
            paths[f"/{name}"] = lambda t, way=way, at=at, shake=shake: (
                *(np.array(way(t)[:3]) + [at, 0, 0] + (tremble.normal(0, shake, 3) if shake and t > 1.0 else 0.0)),
                *way(t)[3:],
            )
    things.append(floor(material="metal", box=(100, 20, 0.2)))
    return play(folder, things, LIFTED + 0.7, rate, pairs=frictions(0.8), paths=paths)


@pytest.mark.parametrize("rate", [60, 240])
def test_a_grip_far_away_changes_not_a_bit(tmp_path: Path, rate: float) -> None:
    calm = two_grips(tmp_path / "calm", rate, 10.0, 0.2, 1000.0, 0.0)
    other = two_grips(tmp_path / "other", rate, 13.0, 0.02, 20_000.0, 3e-4)
    assert not np.array_equal(calm.path("jaw_1_left")[-1, 1:], other.path("jaw_1_left")[-1, 1:])
    for name in ("thing_0", "jaw_0_left", "jaw_0_right"):
        np.testing.assert_array_equal(calm.path(name), other.path(name))
