"""Who yields: driven bodies share, fixed ones never yield, whatever moves them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.results import FLAG_SHAPE_CHANGED
from tests.driven.logs import GAP, Thing, assert_free, line, play, wander
from tests.scene.models import joint, link, urdf

CUBE = ("box", 0.1, 0.1, 0.1)


def held(*points: tuple[float, float, float], frames: int, still: int) -> np.ndarray:
    """A straight way in `frames`, then `still` frames at its end."""
    return np.vstack([line(*points, frames=[frames]), np.tile(points[-1], (still, 1))])


def test_two_driven_bodies_take_half_each(tmp_path: Path) -> None:
    left, right = (
        Thing(name=n, shape=CUBE, role="driven", path=held((s * 0.2, 0, 0), (s * 0.04, 0, 0), frames=20, still=30))
        for n, s in (("left", -1), ("right", 1))
    )
    run = play(tmp_path, [left, right])
    a, b = run.offset("left")[-10:], run.offset("right")[-10:]
    assert a[:, 0] == pytest.approx(-0.01, abs=3e-6)
    assert b[:, 0] == pytest.approx(0.01, abs=3e-6)
    assert np.abs(a[:, 1:]).max() == np.abs(b[:, 1:]).max() == 0.0
    assert_free(run)


def test_a_driven_body_takes_all_against_a_fixed_one(tmp_path: Path) -> None:
    wall = Thing(name="wall", shape=CUBE)
    path = held((0.3, 0, 0), (0.08, 0, 0), frames=20, still=30)
    run = play(tmp_path, [wall, Thing(name="cube", shape=CUBE, role="driven", path=path)])
    assert run.offset("cube")[-10:, 0] == pytest.approx(0.02, abs=3e-6)
    assert (run.offset("wall") == 0.0).all()
    assert_free(run)


def test_several_driven_bodies_in_a_row_all_come_free(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    things = [
        Thing(
            name=f"b{k}",
            shape=s,
            role="driven",
            path=wander(rng, 120, 0.12, 0.5) + np.array([0.1 * k, 0, 0, 0, 0, 0, 0]),
        )
        for k, s in enumerate([CUBE, ("sphere", 0.06), ("capsule", 0.03, 0.1), ("cylinder", 0.04, 0.1)])
    ]
    run = play(tmp_path, things)
    assert run.figures("recorded_penetration_m").max() > 0.02
    assert_free(run)


def test_avatars_of_a_scene_keep_clear_of_each_other(tmp_path: Path) -> None:
    urdf(
        tmp_path / "hand.urdf",
        link("palm", '<geometry><box size="0.08 0.02 0.1"/></geometry>'),
        link("finger", '<origin xyz="0 0 0.04"/><geometry><cylinder radius="0.01" length="0.06"/></geometry>'),
        joint("knuckle", "palm", "finger", inside='<axis xyz="1 0 0"/>', xyz="0 0 0.06"),
    )
    avatars = "".join(
        f'[[avatar]]\nname="{n}"\nurdf="hand.urdf"\nmode="rigid"\nmaterial="human"\nroot={{topic="/{n}"}}\n'
        for n in ("left", "right", "third")
    )
    rng = np.random.default_rng(3)
    roots = {
        f"/{n}": wander(rng, 120, 0.06, 0.3) + np.array([0, 0.03 * k, 0, 0, 0, 0, 0])
        for k, n in enumerate(("left", "right", "third"))
    }
    run = play(tmp_path, [], avatars=avatars, roots=roots)
    assert run.figures("recorded_penetration_m").max() > 0.01
    assert_free(run)
    # hands stay in one piece, but where that takes them too far: the finger is moved as its palm is
    whole = (run.figures("flags").astype(int) & FLAG_SHAPE_CHANGED) == 0
    for n in ("left", "right", "third"):
        apart = np.linalg.norm(run.offset(f"{n}/finger") - run.offset(f"{n}/palm"), axis=1)
        assert apart.max() < 0.06
        assert np.median(apart[whole]) <= 1e-15


def test_a_fixed_thing_that_moves_pushes_a_standing_driven_one_aside(tmp_path: Path) -> None:
    push = held((-0.4, 0.01, 0), (-0.05, 0.01, 0), frames=30, still=30)
    run = play(
        tmp_path,
        [
            Thing(name="pusher", shape=CUBE, path=push),
            Thing(name="cube", shape=CUBE, role="driven", path=np.zeros((len(push), 3))),
        ],
    )
    assert run.path("pusher")[:, :3].tobytes() == push.tobytes()
    assert run.offset("cube")[-10:, 0] == pytest.approx(0.05 + GAP, abs=2e-6)
    assert np.abs(run.offset("cube")[:, 1:]).max() <= 1e-9
    expected = np.maximum(0.0, push[:, 0] + 0.1)
    assert np.abs(run.offset("cube")[:, 0] - expected).max() <= 5e-6
    assert_free(run)


def test_a_fast_fixed_thing_does_not_pass_a_standing_driven_one(tmp_path: Path) -> None:
    """20 m/s: the pusher is on one side in one frame and on the other in the next."""
    x = np.concatenate([np.full(3, -0.5), np.full(10, 0.5)])
    push = np.column_stack([x, 0 * x, 0 * x])
    plate = Thing(name="plate", shape=("box", 0.01, 1, 1), path=push)
    run = play(tmp_path, [plate, Thing(name="cube", shape=CUBE, role="driven", path=np.zeros((len(x), 3)))])
    assert run.path("cube")[-1, 0] >= 0.5 + 0.055
    assert_free(run)


THIN = {
    "ball": ("sphere", 0.002),
    "rod": ("capsule", 0.001, 0.3),
    "plate": ("box", 0.0005, 0.1, 0.1),
    "cube": CUBE,
}


@pytest.mark.parametrize("spin", [0.0, 9.0])
@pytest.mark.parametrize("thick", [0.005, 0.0001])
@pytest.mark.parametrize("shape", THIN.values(), ids=THIN)
def test_a_thin_panel_at_speed_takes_a_thin_body_along(
    tmp_path: Path, shape: tuple[str, float], thick: float, spin: float
) -> None:
    """20 m/s: the panel goes a third of a metre in a frame, hundreds of times what both are thick."""
    x = np.concatenate([np.full(3, 0.5), 0.5 - np.arange(1, 5) / 3, np.full(4, -5 / 6), [0.5] * 90])
    push = np.column_stack([x, 0 * x, 0 * x])
    turns = Rotation.from_rotvec(np.outer(spin * np.arange(len(x)) / 60, [0.6, 0.3, 0.74])).as_quat()
    path = np.hstack([np.zeros((len(x), 3)), turns])
    things = [
        Thing(name="panel", shape=("box", thick, 2, 2), path=push),
        Thing(name="body", shape=shape, role="driven", path=path),
    ]
    run = play(tmp_path, things)
    assert (run.path("body")[:, 0] <= x - thick / 2).all()
    assert run.path("body")[6, 0] < -0.8
    assert run.path("body")[-3:].tobytes() == run.recorded[-3:, run.body("body")].tobytes()
    assert_free(run)


def test_a_door_turns_into_a_hand(tmp_path: Path) -> None:
    urdf(
        tmp_path / "door.urdf",
        link("frame"),
        link("leaf", '<origin xyz="0.4 0 0"/><geometry><box size="0.8 0.03 2"/></geometry>'),
        joint(
            "hinge",
            "frame",
            "leaf",
            inside='<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/>',
            xyz="0 0 0",
        ),
    )
    door = '[[object]]\nname="door"\nclass="fixed"\nurdf="door.urdf"\nmaterial="wood"\njoints={topic="/hinge"}\n'
    n = 150
    angle = 1.2 * np.sin(np.linspace(0, 2 * np.pi, n))  # there and back, through zero to the other side
    path = np.tile([0.5, 0.3, 0.0], (n, 1))
    run = play(
        tmp_path, [Thing(name="hand", shape=("sphere", 0.06), role="driven", path=path)], avatars=door,
        angles={"/hinge": (["hinge"], angle[:, None])},
    )  # fmt: skip
    leaf, hand = run.path("door/leaf"), run.path("hand")[:, :3]
    assert leaf[:, 3:] == pytest.approx(Rotation.from_euler("z", angle[:, None]).as_quat(), abs=1e-12)
    # the hand stays on the door's left: 6 cm + 1.5 cm from its middle plane where it is pushed
    across = np.sum(np.column_stack([-np.sin(angle), np.cos(angle)]) * hand[:, :2], axis=1)
    assert across.min() >= 0.075 - 1e-5
    assert run.figures("recorded_penetration_m").max() > 0.05
    assert_free(run)
