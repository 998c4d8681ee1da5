"""The recorded space: axes, unit and origin of a log in the world, as closed forms and by twins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geomphys.config import Config
from geomphys.recording.frames import FrameSource
from geomphys.recording.poses import IDENTITY, compose, invert
from geomphys.recording.space import RecordedSpace
from geomphys.transforms import quaternion_from_rpy, rotation_from_quaternion
from geomphys.world.scene_inputs import RecordingTable
from tests.recording.log_files import S, Tree, joints, make_world, pose, transforms, turned, write_log

OFFSET = (0.01, -0.02, 0.03, *turned(0.4, axis=1))
HAND = Tree(root="/wrist", offset=OFFSET, topic="/glove", joints=("a",))
MUG = Tree(name="mug", root="/tf#mug", avatar=False)
TABLE = Tree(name="table", avatar=False, rest=(1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0))
TURNED_UP = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))  # +90 degrees about x: y to z


def moves(t: float) -> tuple[float, ...]:
    return (0.3 * math.sin(t), 0.1 * t, 0.5 + 0.1 * math.cos(2 * t), *turned(0.8 * math.sin(t), axis=0))


def frames_of(tmp_path, items, recording=None, trees=(HAND, MUG, TABLE)):
    log = write_log(tmp_path / "log.mcap", sorted(items, key=lambda item: item.log_time), encoding="protobuf")
    with FrameSource(log, make_world(*trees, recording=recording), Config()) as source:
        return list(source)


def recorded_as(value, *, unit=1.0, up="z"):
    """A pose in the world as a log of another space has it."""
    if up == "y":
        value = compose(invert((0.0, 0.0, 0.0, *TURNED_UP)), value)
    return (*(x * unit for x in value[:3]), *value[3:])


def log_of(unit=1.0, up="z"):
    """A hand, and a mug on a cart that moves: its transforms are of the same space."""
    items = []
    for k in range(80):
        t = k / 50
        cart, mug = moves(t + 1.0), moves(2 * t)
        items.append(pose("/wrist", t, recorded_as(moves(t), unit=unit, up=up)))
        items.append(joints("/glove", t, {"a": t}))
        items.append(transforms("/tf", t, {"cart": recorded_as(cart, unit=unit, up=up)}))
        inner = compose(invert(cart), mug)
        items.append(transforms("/tf", t, {"mug": (*(x * unit for x in inner[:3]), *inner[3:])}, frame="cart"))
    return items


@pytest.mark.parametrize(("unit", "name"), [(1.0, "m"), (100.0, "cm"), (1000.0, "mm")])
@pytest.mark.parametrize("up", ["y", "z"])
def test_a_log_in_another_space_gives_the_frames_of_its_twin_in_metres_with_z_up(tmp_path, unit, name, up):
    twin = frames_of(tmp_path, log_of())
    frames = frames_of(tmp_path, log_of(unit, up), {"unit": name, "up": up})
    assert len(frames) == len(twin) == 80
    for a, b in zip(frames, twin, strict=True):
        np.testing.assert_allclose(a.roots, b.roots, rtol=0, atol=1e-12)
        assert a.angles == b.angles
        assert (a.time_ns, a.held) == (b.time_ns, b.held)


def test_y_up_is_the_right_handed_rotation_about_x_that_takes_y_to_z():
    space = RecordedSpace.of(RecordingTable(up="y"))
    for recorded, world in (((1, 0, 0), (1, 0, 0)), ((0, 1, 0), (0, 0, 1)), ((0, 0, 1), (0, -1, 0))):
        assert space.point(recorded) == pytest.approx(world, abs=1e-15)
    x, y, z, *q = space.to_world((0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0))
    assert (x, y, z) == pytest.approx((0.1, -0.3, 0.2), abs=1e-15)
    assert q == pytest.approx(TURNED_UP, abs=1e-15)  # a body whose axes were those of the space lies on its back


def test_the_space_is_placed_in_the_world_after_its_axes_are_turned():
    space = RecordedSpace.of(RecordingTable(up="y", unit="mm", position=(1.0, 2.0, 3.0), rpy=(0.0, 0.0, 90.0)))
    # (100, 200, 300) mm -> (0.1, 0.2, 0.3) m -> y up: (0.1, -0.3, 0.2) -> by 90 degrees about z: (0.3, 0.1, 0.2)
    assert space.point((100, 200, 300)) == pytest.approx((1.3, 2.1, 3.2), abs=1e-15)


def test_where_the_space_is_put_the_whole_recording_is_but_not_what_the_scene_file_places(tmp_path):
    """The tracker's offset stays in the tracker's frame, a table of the scene where it is."""
    placed = (0.5, -0.4, 0.3, *quaternion_from_rpy((10.0, 20.0, 30.0)))
    twin = frames_of(tmp_path, log_of())
    frames = frames_of(tmp_path, log_of(), {"position": placed[:3], "rpy": (10.0, 20.0, 30.0)})
    for a, b in zip(frames, twin, strict=True):
        for tree in (0, 1):
            np.testing.assert_allclose(a.roots[tree], compose(placed, tuple(b.roots[tree])), rtol=0, atol=1e-14)
        assert tuple(a.roots[2]) == tuple(b.roots[2]) == TABLE.rest
    hand = frames[10]
    tracker = compose(placed, moves(hand.time_ns / S))
    back = rotation_from_quaternion(tracker[3:]).T @ (hand.roots[0, :3] - tracker[:3])
    assert back == pytest.approx(OFFSET[:3], abs=1e-12)


def test_the_space_of_the_world_changes_nothing_to_the_bit():
    space = RecordedSpace.of(RecordingTable())
    value = (-0.0, 0.1, 1e-300, 0.1825741858350554, 0.3651483716701107, 0.5477225575051661, 0.7302967433402214)
    assert space.to_world(space.metres(value)) is value or space.to_world(space.metres(value)) == value
    assert math.copysign(1.0, space.to_world(space.metres(value))[0]) == -1.0
    assert space.world_from_space == IDENTITY


def test_composing_and_inverting_are_those_of_matrices():
    rng = np.random.default_rng(3)

    def matrix(p):
        m = np.eye(4)
        m[:3, :3], m[:3, 3] = rotation_from_quaternion(p[3:]), p[:3]
        return m

    for _ in range(100):
        a, b = ((*rng.normal(size=3), *(q / np.linalg.norm(q))) for q in rng.normal(size=(2, 4)))
        np.testing.assert_allclose(matrix(compose(a, b)), matrix(a) @ matrix(b), atol=1e-14)
        np.testing.assert_allclose(matrix(invert(a)), np.linalg.inv(matrix(a)), atol=1e-14)
