"""A hand in one piece that meets something fast is not thrown aside whole: the finger that was hit yields."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geomphys.results import FLAG_SHAPE_CHANGED
from tests.driven.logs import Run, Thing, assert_free, play
from tests.scene.models import joint, link, urdf

HAND = '[[avatar]]\nname="hand"\nurdf="hand.urdf"\nmode="rigid"\nmaterial="human"\n'
HAND += 'root={topic="/wrist"}\njoints={topic="/angles"}\n'


def pressed(folder: Path, speed: float) -> Run:
    """A hand with one finger ahead that goes down on a bar at `speed` [m/s], 8 mm deep, and up again."""
    urdf(
        folder / "hand.urdf",
        link("palm", '<geometry><box size="0.08 0.08 0.03"/></geometry>'),
        link("finger", '<origin xyz="0.04 0 0"/><geometry><box size="0.06 0.02 0.02"/></geometry>'),
        joint("knuckle", "palm", "finger", inside='<axis xyz="0 1 0"/>', xyz="0.04 0 0"),
    )
    down = np.arange(0.0, 0.058 / speed, 1.0 / 60.0) * speed
    z = 0.06 - np.concatenate([np.zeros(4), down, np.full(10, 0.058), down[::-1], np.zeros(40)])
    wrist = np.column_stack([0.0 * z, 0.0 * z, z])
    bar = Thing(name="bar", shape=("box", 0.02, 0.3, 0.02), at=(0.1, 0.0, -0.01))
    return play(
        folder, [bar], avatars=HAND, roots={"/wrist": wrist}, angles={"/angles": (["knuckle"], 0.0 * z[:, None])}
    )


def test_slowly_the_hand_is_lifted_as_it_is(tmp_path: Path) -> None:
    run = pressed(tmp_path, 0.04)
    assert_free(run)
    assert (run.angles == 0.0).all()
    assert np.abs(run.offset("hand/palm")).max() > 5e-3
    assert not (run.figures("flags").astype(int) & FLAG_SHAPE_CHANGED).any()


def test_fast_its_finger_yields_too(tmp_path: Path) -> None:
    run = pressed(tmp_path, 0.5)
    assert_free(run)
    assert (run.figures("flags").astype(int) & FLAG_SHAPE_CHANGED).any()
    steps = np.linalg.norm(np.diff(run.offset("hand/palm"), axis=0), axis=1)
    assert np.ptp(run.angles) > 0.02
    assert steps.max() < 0.85 * run.figures("recorded_penetration_m").max()
    assert (run.corrected[-5:] == run.recorded[-5:]).all()
