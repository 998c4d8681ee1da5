"""A rigid hand that closes on something yields its shape; one that is moved into it is translated as it is.

Whole replays first, then the two kernels that decide it, by hand-made contacts.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.driven.grips import MEMORY, find_grips, update_mean_tips
from geomphys.driven.links import make_links
from geomphys.driven.weights import WEIGHTS
from geomphys.engine.state import ReplayData, make_replay_data
from geomphys.jit.packed_records import pack
from geomphys.load import load_world
from geomphys.scene.kinematics import pose_tree
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


UP, DOWN, ASIDE = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)
DEEP, SHALLOW = -1.5 * WEIGHTS.grip_depth, -0.5 * WEIGHTS.grip_depth


class Hand:
    """The hand of two fingers and a fixed bar, with contacts that are set by hand."""

    def __init__(self, folder: Path) -> None:
        bar = '[[object]]\nname="bar"\nclass="fixed"\nbox=[0.04,0.06,0.04]\nposition=[0.11,0,0]\nmaterial="wood"\n'
        text = hand(folder).replace('root={topic="/wrist"}\njoints={topic="/angles"}\n', "")
        (folder / "scene.toml").write_text(text + bar)
        self.world = load_world(folder / "scene.toml")
        self.data: ReplayData = make_replay_data(self.world.scene)
        self.scene, self.ws, self.state = map(pack, (self.world.scene, self.data.workspace, self.data.driven))
        self.fingers = [self.world.body_names.index(f"hand/{name}") for name in ("upper", "lower")]
        self.bar = self.world.body_names.index("bar")

    def poses(self, angle: float = 0.0, position: tuple[float, ...] = (0, 0, 0), turn: float = 0.0) -> np.ndarray:
        """(B, 7) with the upper finger at `angle`, the palm at a position and turned about x."""
        out = self.data.driven.last.poses.copy()
        roots = self.world.scene.trees.rest.copy()
        roots[0] = (*position, *Rotation.from_rotvec([turn, 0, 0]).as_quat())
        pose_tree(self.scene, self.data.workspace.origins, 0, roots, np.array([angle, 0.0]), out)
        return out

    def touch(self, *touches: tuple[int, float, tuple[float, float, float]]) -> None:
        """Set the recorded contacts with the bar: finger, gap, normal out of the bar."""
        work = self.data.workspace.work
        for k, (finger, gap, normal) in enumerate(touches):
            record = work.touches[k]
            record["tip"], record["body"], record["gap"], record["normal"] = self.fingers[finger], self.bar, gap, normal
        work.counts["touches"] = len(touches)

    def grips(self, recorded: np.ndarray) -> bool:
        find_grips(self.scene, self.state, self.ws, recorded)
        return bool(self.data.workspace.work.grips[0])


@pytest.mark.parametrize("steps", [1, 4, 64])
def test_the_mean_position_of_a_tip_follows_with_its_time_constant_at_every_frame_rate(
    tmp_path: Path, steps: int
) -> None:
    """1 - exp(-t / MEMORY) of the way after a step of the joints; what the palm does meanwhile does not count."""
    made, seconds = Hand(tmp_path), 0.15
    tip = made.fingers[0]
    update_mean_tips(made.scene, made.state, made.ws, made.poses(0.0, (1, 2, 3), 0.4), np.inf)
    before = made.data.driven.mean_tip[tip].copy()
    assert before == pytest.approx([0.03 + 0.05, 0, 0.04], abs=1e-3)  # in the palm's frame, wherever that is
    for k in range(steps):
        moved = made.poses(0.3, (0.1 * k, 0, 0), 0.2 * k)
        update_mean_tips(made.scene, made.state, made.ws, moved, seconds / steps)
    after = made.data.driven.mean_tip[tip].copy()
    update_mean_tips(made.scene, made.state, made.ws, made.poses(0.3), np.inf)
    end = made.data.driven.mean_tip[tip]
    share = np.linalg.norm(after - before) / np.linalg.norm(end - before)
    assert share == pytest.approx(1.0 - np.exp(-seconds / MEMORY), abs=1e-12)


@pytest.mark.parametrize(
    ("touches", "grips"),
    [
        ([(0, DEEP, UP), (1, DEEP, DOWN)], True),
        ([(0, DEEP, UP), (1, SHALLOW, DOWN)], False),
        ([(0, SHALLOW, UP), (1, DEEP, DOWN)], False),
        ([(0, DEEP, UP), (1, DEEP, UP)], False),
        ([(0, DEEP, UP), (1, DEEP, ASIDE)], False),
        ([(0, DEEP, UP)], False),
        ([], False),
    ],
)
def test_tips_that_are_deep_from_opposing_sides_grip(
    tmp_path: Path, touches: list[tuple[int, float, tuple[float, float, float]]], grips: bool
) -> None:
    made = Hand(tmp_path)
    poses = made.poses()
    update_mean_tips(made.scene, made.state, made.ws, poses, np.inf)
    made.touch(*touches)
    made.data.workspace.work.grips[0] = not grips  # of the step before
    assert made.grips(poses) == grips


CLOSED = 1.5 * WEIGHTS.grip_depth / 0.05  # rad: takes a tip, 5 cm from its joint, that much farther


@pytest.mark.parametrize(
    ("before", "now", "gap", "grips"),
    [
        (0.5 * CLOSED, CLOSED, DEEP, True),
        (0.1 * CLOSED, 0.5 * CLOSED, DEEP, False),  # not far enough yet
        (1.2 * CLOSED, CLOSED, DEEP, False),  # it opens
        (0.5 * CLOSED, CLOSED, SHALLOW, False),  # not deep enough
        (-0.5 * CLOSED, -CLOSED, DEEP, False),  # away from it
    ],
)
def test_a_tip_that_joints_have_moved_deeper_grips(
    tmp_path: Path, before: float, now: float, gap: float, grips: bool
) -> None:
    """The finger goes down by its joint from an angle of zero; the bar's normal is up."""
    made = Hand(tmp_path)
    update_mean_tips(made.scene, made.state, made.ws, made.poses(0.0), np.inf)
    made.data.driven.recorded.poses[:] = made.poses(before)
    made.touch((0, gap, UP))
    assert made.grips(made.poses(now)) == grips


def test_a_hand_that_is_moved_into_something_does_not_close_on_it(tmp_path: Path) -> None:
    made = Hand(tmp_path)
    update_mean_tips(made.scene, made.state, made.ws, made.poses(0.0), np.inf)
    made.data.driven.recorded.poses[:] = made.poses(0.0, (0, 0, 0.02))
    made.touch((0, DEEP, UP))
    assert not made.grips(made.poses(0.0))


@pytest.mark.parametrize(("bar_moves", "grips"), [(0.0, True), (-0.01, False)])
def test_a_bar_that_moves_away_faster_is_not_closed_on(tmp_path: Path, bar_moves: float, grips: bool) -> None:
    made = Hand(tmp_path)
    update_mean_tips(made.scene, made.state, made.ws, made.poses(0.0), np.inf)
    made.data.driven.recorded.poses[:] = made.poses(0.5 * CLOSED)
    now = made.poses(CLOSED)
    now[made.bar, 2] += bar_moves
    made.touch((0, DEEP, UP))
    assert made.grips(now) == grips
