"""Renders the frames of the largest differences: a solid, b translucent over it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.analysis.diff.compare import PeakPoses
from geomphys.analysis.diff.measures import Peak
from geomphys.analysis.diff.rasterizer import Surface, View, png, render
from geomphys.numerics.transforms import rotation_from_quaternion
from geomphys.output.camera import choose_viewpoint
from geomphys.output.decoders import Poses
from geomphys.output.output_log import OutputLog
from geomphys.scene.arrays import FIXED
from geomphys.scene.world import World

Floats = NDArray[np.float64]

COLOUR_A = (0.29, 0.53, 0.78)
COLOUR_B = (0.93, 0.51, 0.16)
COLOUR_STATIC = (0.80, 0.79, 0.77)

SMALLEST_VIEW_M = 0.02
"""m; smallest radius of a close-up."""
DIFFERENCES_ACROSS = 12.0
"""Radius of a close-up as a multiple of the difference."""


class Picture(NamedTuple):
    """A PNG of a frame; `radius_m` is half of the height it shows."""

    frame: int
    time_ns: int
    body: str
    difference_m: float
    radius_m: float
    png: bytes


def pictures_of(world: World, peaks: Sequence[Peak], static_a: Poses, static_b: Poses) -> Iterator[Picture]:
    """Two pictures of each frame: the surroundings of the body with the largest difference, and a close-up.

    `static_a` and `static_b` are the poses of the first frame of each: these include static bodies.
    """
    for peak in peaks:
        payload: PeakPoses = peak.payload
        a, b = _posed(world, payload.a, static_a), _posed(world, payload.b, static_b)
        body = world.frame_names.index(payload.body)
        target = _middle(a.get(body), payload)
        tree = world.scene.bodies.tree
        figure = [t for k, t in a.items() if tree[k] == tree[body]] or [target.reshape(1, 1, 3)]
        around = 0.7 * float(np.linalg.norm(np.ptp(np.concatenate(figure).reshape(-1, 3), axis=0))) + 0.05
        close = max(SMALLEST_VIEW_M, DIFFERENCES_ACROSS * peak.value)
        fixed = [t for k, t in a.items() if world.scene.bodies.role[k] == FIXED]
        eye = choose_viewpoint(np.concatenate(figure).reshape(-1, 3), np.concatenate([np.zeros((0, 3, 3)), *fixed]))
        direction = eye.position - eye.target
        near = float((eye.position - target) @ direction / np.linalg.norm(direction))
        for radius in dict.fromkeys([around, min(close, around)]):
            view = View(target, direction, radius, near=near)
            solid = [Surface(t, _colour(world, k)) for k, t in a.items()]
            translucent = [Surface(t, COLOUR_B) for k, t in b.items() if k not in a or not np.array_equal(a[k], t)]
            yield Picture(
                peak.frame, peak.time_ns, payload.body, peak.value, radius, png(render(view, solid, translucent))
            )


def first_poses(output: OutputLog) -> Poses:
    """Poses of the first frame of an output, which include static bodies."""
    return next(iter(output.frames(["/tf"]))).tf


def _posed(world: World, poses: Poses, first_poses: Poses) -> dict[int, Floats]:
    """Body -> its triangles (n, 3, 3) in the world, of bodies that have a shape and a pose."""
    poses_by_name = dict(zip(first_poses.names, first_poses.values, strict=True))
    poses_by_name |= zip(poses.names, poses.values, strict=True)
    found: dict[int, Floats] = {}
    for body, name in enumerate(world.frame_names):
        vertices, faces = world.triangles[body]
        if len(faces) == 0:
            vertices, faces = world.collision_triangles[body]
        if len(faces) and name in poses_by_name:
            pose = poses_by_name[name]
            found[body] = (vertices @ rotation_from_quaternion(pose[3:]).T + pose[:3])[faces]
    return found


def _colour(world: World, body: int) -> tuple[float, float, float]:
    return COLOUR_STATIC if world.scene.bodies.role[body] == FIXED else COLOUR_A


def _middle(triangles: Floats | None, payload: PeakPoses) -> Floats:
    """Centre of a body's bounding box in a; its origin if it has no shape."""
    if triangles is None:
        return np.array(payload.a.values[payload.a.names.index(payload.body), :3])
    points = triangles.reshape(-1, 3)
    middle: Floats = (points.min(axis=0) + points.max(axis=0)) / 2
    return middle
