"""A rigid hand that closes on something yields its shape; one that is moved into it is translated as it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.driven.links import make_links
from geomphys.load import load_world
from tests.driven.logs import Run, Thing, assert_free, play
from tests.scene.models import joint, link, urdf

DEPTH = 6e-3  # m: how deep a fingertip is recorded
REACH = 0.07  # m: from its joint to the middle of its surface
FAST, SLOW = 0.06, 0.008  # m/s: of closing fingertips; SLOW is slower than the rate that counts by itself
FINGER = '<origin xyz="0.05 0 0"/><geometry><box size="0.06 0.02 0.02"/></geometry>'


def hand(folder: Path) -> str:
    """A palm with two fingers, one above the other, in mode `rigid`."""
    folder.mkdir(exist_ok=True)
    urdf(
        folder / "hand.urdf",
        link("palm", '<geometry><box size="0.06 0.1 0.1"/></geometry>'),
        *(link(name, FINGER) for name in ("upper", "lower")),
        *(
            joint(f"{name}_joint", "palm", name, inside='<axis xyz="0 1 0"/>', xyz=f"0.03 0 {z}")
            for name, z in (("upper", 0.04), ("lower", -0.04))
        ),
    )
    avatar = '[[avatar]]\nname="hand"\nurdf="hand.urdf"\nmode="rigid"\nmaterial="human"\n'
    return avatar + 'root={topic="/wrist"}\njoints={topic="/angles"}\n'


BAR = Thing(name="bar", shape=("box", 0.04, 0.06, 0.04), at=(0.11, 0.0, 0.0))
BALL = Thing(name="ball", shape=("sphere", 0.026), at=(0.117, 0.0, 0.0))  # which a hand can be pushed off


def closing(folder: Path, rate: float, speed: float, both: bool, thing: Thing = BAR) -> Run:
    """The upper finger, or both, close on something at `speed` [m/s] of the tips, stay and open; the palm stands still."""
    way = 0.01 + DEPTH
    close = np.concatenate([np.zeros(20), np.arange(0.0, way, speed / rate), np.full(int(0.3 * rate), way)])
    close = np.concatenate([close, close[::-1], np.zeros(int(0.4 * rate))]) / 0.08
    still = np.zeros(len(close))
    angles = np.column_stack([close, -close if both else still])
    return play(
        folder, [thing], avatars=hand(folder), roots={"/wrist": np.column_stack([still, still, still])},
        angles={"/angles": (["upper_joint", "lower_joint"], angles)}, rate=rate,
    )  # fmt: skip


def lowered(folder: Path, rate: float, closes: float) -> Run:
    """The hand is moved down until the upper finger is in the bar, and up again; then it closes at `closes` [rad/s]."""
    way = 0.01 + 2.0 * DEPTH
    down = np.concatenate([np.arange(0.0, way, FAST / rate), np.full(int(0.3 * rate), way)])
    angle = np.concatenate([0.0 * down, closes / rate * np.arange(len(down) + int(0.4 * rate))])
    down = np.concatenate([down, np.maximum(way - FAST / rate * np.arange(len(angle) - len(down)), -0.02)])
    still = np.zeros(len(down))
    return play(
        folder, [Thing(name="bar", shape=("box", 0.04, 0.06, 0.02), at=(0.11, 0.0, 0.01))], avatars=hand(folder),
        roots={"/wrist": np.column_stack([still, still, -down])},
        angles={"/angles": (["upper_joint", "lower_joint"], np.column_stack([np.minimum(angle, 0.2), still]))}, rate=rate,
    )  # fmt: skip


@pytest.mark.parametrize("rate", [60.0, 240.0])
def test_a_finger_that_closes_on_something_stops_there_and_the_hand_stays(tmp_path: Path, rate: float) -> None:
    run = closing(tmp_path, rate, FAST, both=False)
    assert_free(run)
    assert run.figures("recorded_penetration_m").max() > 0.8 * DEPTH
    assert run.figures("shape_change_rad").max() > 0.3 * DEPTH / REACH
    assert np.abs(run.offset("hand/palm")).max() < 0.6 * DEPTH
    assert run.figures("shape_change_rad")[-1] == 0.0


@pytest.mark.parametrize("closes", [0.0, 0.7])
def test_a_hand_that_is_moved_onto_something_keeps_its_shape(tmp_path: Path, closes: float) -> None:
    """Also where a finger closes while the hand leaves."""
    run = lowered(tmp_path, 120.0, closes)
    assert_free(run)
    assert run.figures("recorded_penetration_m").max() > 1.6 * DEPTH
    assert run.figures("shape_change_rad").max() == 0.0


@pytest.mark.parametrize("both", [False, True])
def test_fingers_that_close_slowly_grip_from_opposing_sides(tmp_path: Path, both: bool) -> None:
    run = closing(tmp_path, 60.0, SLOW, both, BALL)
    assert_free(run)
    assert (run.figures("shape_change_rad").max() > 0.0) == both


def test_the_palm_of_a_fingertip_is_where_fingers_part(tmp_path: Path) -> None:
    box = '<geometry><box size="0.02 0.02 0.02"/></geometry>'
    pairs = [("arm", "palm"), ("palm", "a"), ("a", "a_tip"), ("palm", "b"), ("b", "b_tip"), ("arm", "lamp")]
    urdf(
        tmp_path / "hand.urdf",
        *(link(name, box) for name in dict.fromkeys(name for pair in pairs for name in pair)),
        *(joint(f"to_{child}", parent, child) for parent, child in pairs),
    )
    (tmp_path / "scene.toml").write_text('[[avatar]]\nname="hand"\nurdf="hand.urdf"\nmaterial="human"\n')
    world = load_world(tmp_path / "scene.toml")
    links, names = make_links(world.scene), [name.split("/")[1] for name in world.body_names]
    palms = {names[tip]: names[links.palm[tip]] for tip in np.flatnonzero(links.tip)}
    assert palms == {"a_tip": "palm", "b_tip": "palm", "lamp": "arm"}
