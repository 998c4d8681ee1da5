"""The viewpoint of a stretch of a replay: what moves, and what is handled, is in the picture, whatever its shape."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import geomphys
from geomphys.numerics.transforms import apply, matrix_from_pose
from geomphys.output.output_results import results_of_output
from geomphys.output.output_world import world_of_output
from geomphys.results import FrameResult
from geomphys.scene.arrays import DRIVEN, SIMULATED
from geomphys.scene.world import World
from geomphys.viewer.frame_picture import viewpoint_of
from geomphys.viewer.ray_caster import Camera
from tests.driven.logs import Thing, play
from tests.made import Results


def share_in_picture(world: World, results: list[FrameResult], bodies: np.ndarray, size: tuple[int, int]) -> float:
    """Part of the vertices of bodies, in all frames, that the picture holds."""
    eye = viewpoint_of(world, results, size=size)
    camera = Camera(eye.position, eye.target, *size)
    points = np.concatenate(
        [apply(matrix_from_pose(result.corrected[b]), world.triangles[b][0]) for result in results for b in bodies]
    )
    right, up, towards = ((points - eye.position) @ axis for axis in camera.axes())
    high = np.tan(np.radians(camera.view_angle) / 2)
    inside = (np.abs(up) <= high * -towards) & (np.abs(right) <= high * size[0] / size[1] * -towards)
    return float(inside.mean())


@pytest.mark.parametrize("size", [(400, 300), (300, 900), (900, 200)])
def test_a_hand_that_is_carried_away_stays_in_the_picture(landed: Results, size: tuple[int, int]) -> None:
    output = geomphys.open_output(landed.out)
    world = world_of_output(output)
    role = world.scene.bodies.role
    assert (role == SIMULATED).any()
    carried = [
        replace(
            result,
            corrected=result.corrected + np.where(role == DRIVEN, 0.02 * k, 0.0)[:, None] * [1, 0, 0, 0, 0, 0, 0],
            recorded=result.recorded + np.where(role == DRIVEN, 0.02 * k, 0.0)[:, None] * [1, 0, 0, 0, 0, 0, 0],
        )
        for k, result in enumerate(results_of_output(output, world))
    ]
    assert share_in_picture(world, carried, np.flatnonzero(role == DRIVEN), size) > 0.995


def test_what_the_hand_touches_is_in_the_picture(landed: Results) -> None:
    output = geomphys.open_output(landed.out)
    world = world_of_output(output)
    role = world.scene.bodies.role
    touched, hand = np.flatnonzero(role == SIMULATED)[:1], np.flatnonzero(role == DRIVEN)[0]
    beside = []
    for result in results_of_output(output, world):
        poses, contacts = result.corrected.copy(), result.contacts
        poses[touched, :3] = poses[hand, :3] + [0.0, 1.0, 0.0]
        row = {name: np.zeros((1, *column.shape[1:]), column.dtype) for name, column in contacts._asdict().items()}
        row |= {"body_a": np.array([hand]), "body_b": touched}
        beside.append(replace(result, corrected=poses, contacts=contacts._replace(**row)))
    assert share_in_picture(world, beside, touched, (400, 300)) > 0.99


@pytest.mark.parametrize("frames", [1, 3], ids=["one frame", "a stretch"])
def test_a_recorded_thing_that_moves_does_not_hide_what_touches(tmp_path: Path, frames: int) -> None:
    """A plate beside the cube, moved by the recording, where the camera would stand otherwise."""
    still = np.tile([0.0, 0.0, 0.05], (frames, 1))
    cube = Thing(name="cube", shape=("box", 0.1, 0.1, 0.1), role="driven", path=still)
    table = Thing(name="table", shape=("box", 0.4, 0.4, 0.02), at=(0.0, 0.0, -0.0095))  # the cube is in it by 0.5 mm
    alone = play(tmp_path / "alone", [cube, table])
    across = viewpoint_of(alone.world, alone.results).position[:2]
    across = across / np.linalg.norm(across)
    turn = Rotation.from_euler("z", np.arctan2(across[1], across[0])).as_quat()
    path = np.array([[*(0.09 + 0.001 * k) * across, 0.3, *turn] for k in range(frames)])
    hidden = play(tmp_path / "hidden", [cube, table, Thing(name="plate", shape=("box", 0.01, 1.0, 1.0), path=path)])
    assert viewpoint_of(hidden.world, hidden.results).position[:2] @ across < 0.09
