"""Units, up axis and pose of the recorded space, against rotations of scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.recording.recorded_space import RecordedSpace
from geomphys.scene.recording_tables import RecordingTable
from geomphys.scene.scene_facts import facts_of_recording

POSE = (120.0, -34.0, 56.0, 0.1, 0.7, -0.1, 0.7)


@pytest.mark.parametrize(("unit", "per_metre"), [("m", 1.0), ("cm", 100.0), ("mm", 1000.0)])
def test_positions_become_metres_and_rotations_stay(unit: str, per_metre: float) -> None:
    space = RecordedSpace.from_table(facts_of_recording(RecordingTable(unit=unit)))
    metres = space.to_metres(POSE)
    assert metres[:3] == pytest.approx(np.array(POSE[:3]) / per_metre, rel=1e-15)
    assert metres[3:] == POSE[3:]


def test_y_up_becomes_z_up() -> None:
    """(x, y, z) becomes (x, -z, y), and so do the axes of what is there; a space rotated about y is rotated about z."""
    space = RecordedSpace.from_table(facts_of_recording(RecordingTable(up="y")))
    assert space.world_position((1.0, 2.0, 3.0)) == pytest.approx((1.0, -3.0, 2.0), abs=1e-15)
    about_y = Rotation.from_rotvec([0, 0.4, 0])
    world = space.to_world((0.0, 0.0, 0.0, *about_y.as_quat()))
    expected = Rotation.from_rotvec([np.pi / 2, 0, 0]) * about_y
    assert (Rotation.from_quat(world[3:]) * expected.inv()).magnitude() <= 1e-12


def test_the_pose_of_the_space_is_applied_after_unit_and_up_axis() -> None:
    turn = Rotation.from_euler("xyz", [0.3, -0.2, 0.5])
    table = RecordingTable(unit="cm", up="y", position=(1.0, 2.0, 3.0), orientation=tuple(turn.as_quat()))
    space = RecordedSpace.from_table(facts_of_recording(table))
    p = np.array(POSE[:3]) / 100.0
    expected = np.array([1.0, 2.0, 3.0]) + turn.apply([p[0], -p[2], p[1]])
    assert space.to_world(space.to_metres(POSE))[:3] == pytest.approx(expected, abs=1e-12)
    assert space.world_position(POSE[:3]) == pytest.approx(expected, abs=1e-12)


def test_a_space_that_is_the_world_changes_no_bit() -> None:
    space = RecordedSpace.from_table(facts_of_recording(RecordingTable()))
    pose = (0.1, -0.0, 1e-300, 0.6, -0.0, 0.8, 0.0)
    assert np.array(space.to_world(space.to_metres(pose))).tobytes() == np.array(pose).tobytes()
