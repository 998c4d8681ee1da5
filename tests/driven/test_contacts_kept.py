"""What fingertips touched in the recording they touch in the corrected motion, also of a hand in one piece."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.driven.weights import WEIGHTS
from geomphys.results import FLAG_SHAPE_CHANGED
from tests.driven.logs import Run, Thing, assert_free, play
from tests.scene.models import joint, link, urdf

DEPTH, DROP = 8e-3, 7e-3  # m: how deep one finger goes, and how much lower what the other touches is
FINGER = '<origin xyz="0.04 0 0"/><geometry><box size="0.06 0.02 0.02"/></geometry>'


def pressed(folder: Path, rate: float, speed: float = 0.5) -> Run:
    """A hand that goes down at `speed` [m/s] with one finger into a bar, and with the other onto a lower plate."""
    folder.mkdir(exist_ok=True)
    urdf(
        folder / "hand.urdf",
        link("palm", '<geometry><box size="0.08 0.1 0.03"/></geometry>'),
        *(link(name, FINGER) for name in "ab"),
        *(
            joint(f"knuckle_{name}", "palm", name, inside='<axis xyz="0 1 0"/>', xyz=f"0.04 {y} 0")
            for name, y in (("a", 0.03), ("b", -0.03))
        ),
    )
    hand = '[[avatar]]\nname="hand"\nurdf="hand.urdf"\nmode="rigid"\nmaterial="human"\n'
    hand += 'root={topic="/wrist"}\njoints={topic="/angles"}\n'
    down = 0.05 + 0.01 - np.arange(0.0, 0.05 + DEPTH, speed / rate)
    z = np.concatenate([down, np.full(int(0.5 * rate), 0.01 - DEPTH)])
    things = [
        Thing(name="bar", shape=("box", 0.02, 0.04, 0.02), at=(0.1, 0.03, -0.01)),
        Thing(name="plate", shape=("box", 0.02, 0.04, 0.02), at=(0.1, -0.03, -0.01 - DROP)),
    ]
    return play(
        folder, things, avatars=hand, roots={"/wrist": np.column_stack([0.0 * z, 0.0 * z, z])},
        angles={"/angles": (["knuckle_a", "knuckle_b"], np.zeros((len(z), 2)))}, rate=rate,
    )  # fmt: skip


@pytest.mark.parametrize("rate", [60.0, 240.0])
def test_the_finger_that_is_not_in_the_way_comes_back_to_what_it_touched(tmp_path: Path, rate: float) -> None:
    run = pressed(tmp_path, rate)
    assert_free(run)
    assert (run.figures("flags").astype(int) & FLAG_SHAPE_CHANGED).any()
    end = slice(-int(0.1 * rate), None)
    assert (run.figures("contacts_recorded")[end] == 2).all()
    assert (run.figures("contacts_kept")[end] == 2).all()


def test_it_comes_no_faster_than_it_may(tmp_path: Path) -> None:
    """Turned about its knuckle, a tip 0.07 m ahead goes by at most `closing_speed`, and a share of the recorded motion, more
    than the hand does."""
    rate = 120.0
    run = pressed(tmp_path, rate)
    touching = run.figures("contacts_recorded")[1:] == 2
    turns = np.diff(run.angles[:, 1])[touching]
    steps = np.linalg.norm(np.diff(run.recorded[..., :3], axis=0), axis=2).max(axis=1)[touching]
    assert turns.max() > 1e-3
    assert (0.06 * turns <= WEIGHTS.closing_speed / rate + WEIGHTS.closing_share * steps).all()


@pytest.mark.parametrize("rate", [60.0, 120.0, 240.0])
def test_how_a_hand_yields_does_not_hang_on_the_frame_rate(tmp_path: Path, rate: float) -> None:
    """Slowly it is lifted as it is; at a speed over `translation_speed` its shape yields, at every rate."""
    for speed, yields in ((0.6 * WEIGHTS.translation_speed, False), (4.0 * WEIGHTS.translation_speed, True)):
        run = pressed(tmp_path / f"{speed:g}", rate, speed)
        assert (run.figures("flags").astype(int) & FLAG_SHAPE_CHANGED).any() == yields
