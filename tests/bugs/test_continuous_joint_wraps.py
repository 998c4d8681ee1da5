"""A continuous joint that passed half a turn was interpolated through zero: half a turn and back within two frames."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from geomphys.analysis.diff.channels import Tolerance
from geomphys.analysis.diff.motion_channels import JointChannel
from geomphys.config import Config
from geomphys.load import load_world
from geomphys.recording.frames import FrameSource
from geomphys.scene.world import World
from tests.recording.log_files import Tree, joints, make_world, pose, write_log
from tests.scene.models import joint, link, urdf

TURN = 2 * np.pi


def world_of(continuous: tuple[str, ...]) -> World:
    world = make_world(Tree(root="/wrist", topic="/glove", joints=("a", "b")))
    return replace(world, joints=tuple(replace(s, continuous=continuous) for s in world.joints))


def wrapped(angle: float) -> float:
    """In (-pi, pi], as recorders write it."""
    return float(np.pi - np.remainder(np.pi - angle, TURN))


@pytest.mark.parametrize("speed", [0.7, -0.7, 40.0, -40.0])
@pytest.mark.parametrize("lost", [False, True])
def test_between_samples_the_short_way_round_and_at_them_to_the_bit(tmp_path: Path, speed: float, lost: bool) -> None:
    """With `lost`, the other joint is missing now and then, so that joints are taken one by one."""
    recorded = [wrapped(3.0 + speed * k / 30) for k in range(60)]
    items = []
    for k, angle in enumerate(recorded):
        items.append(pose("/wrist", k / 30, (0, 0, 0, 0, 0, 0, 1)))
        items.append(joints("/glove", k / 30, {"a": angle} if lost and k % 3 == 1 else {"a": angle, "b": angle}))
    path = write_log(tmp_path / "log.mcap", items)
    with FrameSource(path, world_of(("a",)), Config(rate=120.0)) as source:
        frames = list(source)
    true = np.array([3.0 + speed * f.time_ns / 1e9 for f in frames])
    got = np.array([f.angles[0] for f in frames])
    assert np.abs(np.remainder(got - true + np.pi, TURN) - np.pi).max() < 1e-7
    assert np.abs(got).max() <= np.pi + abs(speed) / 60 + 1e-9  # no further past the cut than half a step
    with FrameSource(path, world_of(("a",)), Config()) as source:
        assert [f.angles[0] for f in source] == recorded


def test_joints_with_an_end_go_the_way_between_their_values(tmp_path: Path) -> None:
    items = []
    for k in range(4):
        items.append(pose("/wrist", k / 30, (0, 0, 0, 0, 0, 0, 1)))
        items.append(joints("/glove", k / 30, {"a": 3.0 * (-1) ** k, "b": 3.0 * (-1) ** k}))
    path = write_log(tmp_path / "log.mcap", items)
    with FrameSource(path, world_of(("a",)), Config(rate=60.0)) as source:
        middle = list(source)[1]
    assert abs(middle.angles[0]) == pytest.approx(np.pi, abs=1e-6)
    assert middle.angles[1] == pytest.approx(0.0, abs=1e-6)


def test_the_urdf_says_which(tmp_path: Path) -> None:
    ball = '<geometry><sphere radius="0.02"/></geometry>'
    urdf(
        tmp_path / "hand.urdf",
        *(link(name, ball) for name in ("palm", "wheel", "follower", "slide", "hinge")),
        '<joint name="turns" type="continuous"><parent link="palm"/><child link="wheel"/><axis xyz="0 0 1"/></joint>',
        '<joint name="follows" type="continuous"><parent link="palm"/><child link="follower"/><axis xyz="0 0 1"/>'
        '<mimic joint="turns" multiplier="-1"/></joint>',
        '<joint name="slides" type="prismatic"><parent link="palm"/><child link="slide"/><axis xyz="0 0 1"/>'
        '<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>',
        joint("bends", "palm", "hinge"),
    )
    (tmp_path / "scene.toml").write_text(
        '[[avatar]]\nname="hand"\nurdf="hand.urdf"\nmaterial="human"\nmode="rigid"\njoints={topic="/glove"}\n'
    )
    world = load_world(tmp_path / "scene.toml")
    (source,) = world.joints
    assert source.continuous == ("turns",)
    names = ("turns", "slides", "bends")
    path = write_log(
        tmp_path / "log.mcap", [joints("/glove", k / 30, dict.fromkeys(names, 3.1 * (-1) ** k)) for k in range(3)]
    )
    with FrameSource(path, world, Config(rate=60.0)) as frames:
        middle = dict(zip(world.dof_names, list(frames)[1].angles, strict=True))
    assert abs(middle["turns"]) == pytest.approx(np.pi, abs=1e-6)
    assert (middle["slides"], middle["bends"]) == (pytest.approx(0, abs=1e-6), pytest.approx(0, abs=1e-6))


def test_the_case(shared_dir: Path) -> None:
    folder = shared_dir / "cases" / "continuous_joint_wraps"
    world = load_world(folder / "scene.toml")
    (name,) = world.joints[0].continuous
    column = world.dof_names.index(name)
    with FrameSource(folder / "log.mcap", world, Config(rate=60.0)) as source:
        angles = np.array([f.angles[column] for f in source])
    steps = np.remainder(np.diff(angles) + np.pi, TURN) - np.pi
    assert np.abs(angles).max() > 3.1
    assert angles.min() < -3.0
    assert np.abs(steps).max() < 0.03
    crossing = int(np.argmax(np.abs(np.diff(angles))))
    assert np.abs(angles[crossing : crossing + 2]).min() > 3.1


@pytest.mark.parametrize(("tolerance", "apart"), [(1e-6, 0.02), (0.0, TURN - 0.02)])
def test_a_difference_of_such_angles_is_the_short_way_unless_bits_are_compared(tolerance: float, apart: float) -> None:
    channel = JointChannel("/joint_states", Tolerance(m=0.0, rad=tolerance), frozenset(), frozenset({"a"}))
    frames = [
        SimpleNamespace(index=0, joints={"/joint_states": SimpleNamespace(names=("a", "b"), values=np.array(values))})
        for values in ([np.pi - 0.01, 1.0], [-np.pi + 0.01, 1.5])
    ]
    channel.add(*frames)  # type: ignore[arg-type]
    radians = channel.result().radians
    assert radians["a"].max == pytest.approx(apart)
    assert radians["b"].max == 0.5
