"""Whole avatars: limbs stay in their reach cones, a torso yields where limbs cannot, what nothing frees is held free."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from geomphys.driven.reach_cones import cone_angle
from geomphys.jit.packed_records import pack
from tests.driven.compound import CAPSULE, NOTCHED, limit
from tests.driven.logs import Run, Thing, assert_free, play
from tests.scene.models import joint, link, urdf


def avatar(folder: Path, parts: list[str], rest: str) -> str:
    """Scene text of an avatar with a recorded root."""
    urdf(folder / "body.urdf", *parts)
    return (
        '[[avatar]]\nname="body"\nurdf="body.urdf"\nmode="chains"\nmaterial="human"\n'
        'joints={topic="/angles"}\nroot={topic="/root"}\n' + rest
    )


def pose(folder: Path, scene: str, joints: list[str], angles: np.ndarray, things: Sequence[Thing] = ()) -> Run:
    """Replay recorded angles (n, Q) of an avatar whose root stands still, and which overlaps something on the way."""
    run = play(
        folder,
        list(things),
        avatars=scene,
        roots={"/root": np.zeros((len(angles), 3))},
        angles={"/angles": (joints, angles)},
    )
    assert run.figures("recorded_penetration_m").max() > 0.01
    return run


def arm(folder: Path) -> str:
    """An arm on a shoulder of three joints whose cone has a notch."""
    turning = {axis: limit(-2.6, 2.6, axis) for axis in ("0 1 0", "1 0 0", "0 0 1")}
    parts = [
        *(link(name) for name in ("torso", "y", "x")),
        *(link(name, CAPSULE.format(-0.15)) for name in ("upper", "lower")),
        joint("sy", "torso", "y", xyz="0 0 0.6", inside=turning["0 1 0"]),
        joint("sx", "y", "x", xyz="0 0 0", inside=turning["1 0 0"]),
        joint("sz", "x", "upper", xyz="0 0 0", inside=turning["0 0 1"]),
        joint("elbow", "upper", "lower", xyz="0 0 -0.3", inside=limit(-2.5, 0.1, "0 1 0")),
    ]
    cone = (
        '[[avatar.chain]]\nname="arm"\nbase="torso"\ntip="lower"\n[[avatar.reach_cone]]\njoints=["sy","sx","sz"]\n'
        f"limb=[0.0,0.0,-1.0]\ndirections={NOTCHED}\n"
    )
    return avatar(folder, parts, cone)


def cone_angles(run: Run, angles: np.ndarray) -> np.ndarray:
    """Signed angle [rad] of the limb in its cone for each row of angles, positive inside."""
    scene = pack(run.world.scene)
    return np.array([cone_angle(scene, 0, row) for row in angles])


@pytest.mark.parametrize("sweep", [0.8, -0.8])
def test_a_limb_pushed_by_a_wall_stays_in_its_cone(tmp_path: Path, sweep: float) -> None:
    """A wall comes at the arm from a side to which the cone leaves it little room: the elbow must do the rest."""
    n = 200
    t = np.linspace(0, 1, n)
    angles = np.zeros((n, 4))
    angles[:, 0] = 0.05 + sweep * 0.2 * np.sin(2 * np.pi * t)
    angles[:, 3] = -0.6
    x = np.sign(sweep) * (0.45 - 0.42 * np.clip(3 * np.minimum(t, 1 - t), 0, 1))
    path = np.column_stack([x, np.zeros(n), np.full(n, 0.3)])
    wall = Thing(name="wall", shape=("box", 0.02, 0.3, 0.5), path=path)
    run = pose(tmp_path, arm(tmp_path), ["sy", "sx", "sz", "elbow"], angles, [wall])
    assert np.abs(run.angles - run.recorded_angles).max() > 0.05
    assert_free(run, every=3)
    order = [("sy", "sx", "sz", "elbow").index(name) for name in run.world.dof_names]
    assert order == [0, 1, 2, 3]
    inside, recorded = cone_angles(run, run.angles), cone_angles(run, run.recorded_angles)
    assert (inside >= np.minimum(0.0, recorded) - 1e-9).all()
    free = ~run.touched()
    assert run.angles[:5].tobytes() == run.recorded_angles[:5].tobytes()
    assert free.any()


def test_the_back_yields_where_a_hip_cannot(tmp_path: Path) -> None:
    """A back bends down on the ball at the hip joint, which the hip's own joint cannot move away."""
    n = 150
    turning = limit(-2.0, 2.0, "0 1 0")
    parts = [
        link("pelvis", '<origin xyz="0 0 -0.1"/><geometry><box size="0.1 0.1 0.1"/></geometry>'),
        link("back", '<origin xyz="0 0 0.25"/><geometry><box size="0.1 0.3 0.3"/></geometry>'),
        link("thigh", '<origin xyz="0.01 0 0"/><geometry><sphere radius="0.08"/></geometry>'),
        link("shin", '<origin xyz="0 0 -0.45"/><geometry><box size="0.05 0.05 0.3"/></geometry>'),
        joint("spine", "pelvis", "back", xyz="0 0 0", inside=turning),
        joint("hip", "pelvis", "thigh", xyz="0.15 0 0.05", inside=turning),
        joint("knee", "thigh", "shin", xyz="0 0 -0.1", inside=turning),
    ]
    scene = avatar(tmp_path, parts, '[[avatar.chain]]\nname="leg"\nbase="pelvis"\ntip="shin"\n')
    bend = 0.9 * np.sin(np.linspace(0, np.pi, n)) ** 2
    run = pose(tmp_path, scene, ["spine", "hip", "knee"], np.column_stack([bend, 0.0 * bend, 0.0 * bend]))
    assert_free(run, every=2)
    names = list(run.world.dof_names)
    offset = run.angles - run.recorded_angles
    assert np.abs(offset[:, names.index("spine")]).max() > 0.05
    assert np.abs(offset[:, names.index("hip")]).max() < 0.3
    assert run.corrected[-3:].tobytes() == run.recorded[-3:].tobytes()
    assert run.angles[0].tobytes() == run.recorded_angles[0].tobytes()


def test_a_limb_that_can_yield_leaves_the_back_alone(tmp_path: Path) -> None:
    """A hand that reaches into the own chest is turned away by the arm; the back hardly helps."""
    n = 120
    turning = limit(-2.5, 2.5, "0 1 0")
    parts = [
        link("pelvis"),
        link("chest", '<origin xyz="0 0 0.3"/><geometry><box size="0.15 0.3 0.4"/></geometry>'),
        link("shoulder"),
        link("arm", '<origin xyz="0 0 -0.15"/><geometry><box size="0.05 0.05 0.25"/></geometry>'),
        link("hand", '<origin xyz="0 0 -0.15"/><geometry><box size="0.05 0.05 0.25"/></geometry>'),
        joint("spine", "pelvis", "chest", xyz="0 0 0", inside=turning),
        joint("mount", "chest", "shoulder", "fixed", xyz="0.3 0 0.5"),
        joint("swing", "shoulder", "arm", xyz="0 0 0", inside=turning),
        joint("elbow", "arm", "hand", xyz="0 0 -0.3", inside=turning),
    ]
    scene = avatar(tmp_path, parts, '[[avatar.chain]]\nname="arm"\nbase="chest"\ntip="hand"\n')
    reach = 0.7 * np.sin(np.linspace(0, np.pi, n)) ** 2
    run = pose(tmp_path, scene, ["spine", "swing", "elbow"], np.column_stack([0.1 * reach, reach, 0.6 * reach]))
    assert_free(run, every=2)
    spine = list(run.world.dof_names).index("spine")
    assert np.abs(run.angles[:, spine] - run.recorded_angles[:, spine]).max() <= 0.01


def test_limbs_that_cannot_come_free_are_held(tmp_path: Path) -> None:
    """Two fingers are recorded from beyond their limits to within, where they overlap all the way: they stay before."""
    n = 120
    parts = [
        link("palm", '<origin xyz="-0.1 0 0"/><geometry><box size="0.1 0.1 0.2"/></geometry>'),
        *(link(name, '<origin xyz="0.1 0 0"/><geometry><box size="0.2 0.02 0.02"/></geometry>') for name in ("a", "b")),
        joint("ja", "palm", "a", xyz="0 0 0.05", inside=limit(0.3, 0.6, "0 1 0")),
        joint("jb", "palm", "b", xyz="0 0 -0.05", inside=limit(-0.6, -0.3, "0 1 0")),
    ]
    chains = "".join(f'[[avatar.chain]]\nname="{c}"\nbase="palm"\ntip="{c}"\n' for c in "ab")
    close = 0.5 * np.sin(np.minimum(np.linspace(0, 1.5 * np.pi, n), np.pi)) ** 2
    run = pose(tmp_path, avatar(tmp_path, parts, chains), ["ja", "jb"], np.column_stack([close, -close]))
    assert_free(run, every=1)
    held = np.abs(run.recorded_angles).max(axis=1) > 0.3
    assert held.any()
    assert np.abs(run.angles[held]).max() < 0.3  # nothing within the limits is free
    assert np.abs(np.diff(run.angles, axis=0)).max() <= np.abs(np.diff(run.recorded_angles, axis=0)).max() + 0.01
    assert run.corrected[-2:].tobytes() == run.recorded[-2:].tobytes()
