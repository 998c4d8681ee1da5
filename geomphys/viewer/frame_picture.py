"""Draws a frame of a result in software: bodies, the recorded motion as a ghost, contacts; and chooses where it is seen from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import ConfigError
from geomphys.numerics.even_samples import EvenSamples
from geomphys.numerics.transforms import rotation_from_quaternion
from geomphys.output import colours, frame_columns
from geomphys.output.camera import ContactFrame, Viewpoint, choose_viewpoint
from geomphys.output.vertex_normals import with_vertex_normals
from geomphys.results import FrameResult, ResultColumns
from geomphys.scene.arrays import DRIVEN, FIXED, SIMULATED
from geomphys.scene.tessellation import sphere_triangles
from geomphys.scene.world import World
from geomphys.viewer.ray_caster import Camera, Surface, render

Floats = NDArray[np.float64]
Motion = Literal["corrected", "recorded"]

MARK_PIXELS = 4.0
"""Radius of a contact, px of a picture 960 px high."""
_SURROUNDINGS = 2.5
"""Half-width of the view about a body in focus, of the body's own."""
_FILLED = 0.95
"""Part of the picture's width and height that the motion may fill."""
_OUTLIERS = 0.5
"""Percentage of the points of a motion that may be outside the picture."""


class FramePainter:
    """Draws frames of results in one world.

    Parameters
    ----------
    world : World
    """

    def __init__(self, world: World) -> None:
        self._world = world
        palette = colours.colours_of_trees(world.facts)
        self._colours = [palette[world.tree_names[tree]] for tree in world.scene.bodies.tree]
        self._meshes = [with_vertex_normals(vertices, faces) for vertices, faces in world.triangles]
        self._ball = sphere_triangles(1.0, 12)

    def picture(
        self, result: FrameResult, eye: Viewpoint, size: tuple[int, int], motion: Motion = "corrected"
    ) -> NDArray[np.uint8]:
        """Pixels (height, width, 3) of a frame.

        Driven bodies have the colour of their state, as in the rerun recording. With `motion` ``corrected`` the recorded
        poses of corrected bodies are drawn translucent; with ``recorded`` driven bodies are drawn where they were
        recorded, faintly also where they are inside something, without contacts.
        """
        world = self._world
        driven = world.scene.bodies.role == DRIVEN
        moved = driven & frame_columns.is_corrected(result.recorded[None], result.corrected[None])[0]
        touched = frame_columns.in_contact(ResultColumns.of(result), len(driven))[0]
        poses = result.corrected if motion == "corrected" else result.recorded
        paint: list[colours.Colour] = list(self._colours)
        for body in np.flatnonzero(driven):
            if motion == "recorded":
                paint[body] = (*colours.GHOST[:3], 255) if moved[body] else paint[body]
            elif touched[body]:
                paint[body] = colours.IN_CONTACT
            elif moved[body]:
                paint[body] = colours.CORRECTED
        solid = [self._surface(body, poses[body], paint[body]) for body in range(len(driven))]
        marks: list[Surface] = []
        camera = Camera(eye.position, eye.target, *size)
        ghosts = [self._surface(body, result.recorded[body], colours.GHOST) for body in np.flatnonzero(moved).tolist()]
        if motion == "corrected":
            radius = MARK_PIXELS * camera.pixel_size() * camera.height / 960.0
            marks = [self._mark(point, radius) for point in result.contacts.point]
        return render(camera, solid, ghosts, marks)

    def _surface(self, body: int, pose: Floats, colour: colours.Colour) -> Surface:
        points, faces, normals = self._meshes[body]
        rotation = rotation_from_quaternion(pose[3:])
        return Surface(
            (points @ rotation.T + pose[:3])[faces], (normals @ rotation.T)[faces], np.array(colour[:3]) / 255.0
        )

    def _mark(self, point: Floats, radius: float) -> Surface:
        vertices, faces = self._ball
        return Surface((radius * vertices + point)[faces], vertices[faces], np.array(colours.CONTACT[:3]) / 255.0)


class _Box(NamedTuple):
    low: Floats  # (B, 3) body frame, m
    high: Floats
    solid: NDArray[np.bool_]  # (B,) bodies that have a surface


def viewpoint_of(
    world: World, results: Sequence[FrameResult], focus: str | None = None, size: tuple[int, int] = (4, 3)
) -> Viewpoint:
    """Viewpoint for frames: as near as the moving bodies and what they handle fit into the picture, with little occlusion.

    Parameters
    ----------
    world : World
    results : sequence of FrameResult
        At least one; a sample of the frames to be seen.
    focus : str, optional
        Body (`object`, `object/link`, `avatar/link`; or its frame id in the output), avatar or object to look at.
    size : (2,)
        Width and height of the picture; their ratio counts.

    Raises
    ------
    ConfigError
        There is no such body.
    """
    boxes = _boxes(world)
    bodies = _bodies_in_focus(world, results, boxes, focus)
    points = np.concatenate([_corners(boxes, result.corrected, bodies) for result in results])
    points = np.concatenate([points, *[_corners(boxes, result.recorded, bodies) for result in results]])
    if focus is None:
        handled = [_corners(boxes, result.corrected, _handled(world, result)) for result in results]
        points = np.concatenate([points, *handled])
    else:
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        points = middle + _SURROUNDINGS * (points - middle)
    scene = world.scene
    fixed = (scene.bodies.role == FIXED) & ~np.isin(np.arange(len(world.body_names)), bodies)
    moves = scene.trees.moving[scene.bodies.tree] != 0
    still = fixed if len(results) == 1 else fixed & ~moves
    contacts = [
        ContactFrame(
            result.contacts.point[:: max(1, len(result.contacts.point) // 4)],
            _triangles(world, result, np.flatnonzero(fixed & ~still)),
        )
        for result in results[:: max(1, len(results) // 8)]
        if len(result.contacts.point)
    ]
    occluders = _triangles(world, results[0], np.flatnonzero(still))
    return _backed_off(choose_viewpoint(points, occluders, contacts), points, size)


def _backed_off(eye: Viewpoint, points: Floats, size: tuple[int, int]) -> Viewpoint:
    """The viewpoint, so far from its target that the points (n, 3), but for `_OUTLIERS`, are in a picture of that size."""
    camera = Camera(eye.position, eye.target, *size)
    right, up, towards = ((points - eye.target) @ axis for axis in camera.axes())
    half_height = _FILLED * np.tan(np.radians(camera.view_angle) / 2)
    half_width = half_height * camera.width / camera.height
    needed = towards + np.maximum(np.abs(right) / half_width, np.abs(up) / half_height)
    away = eye.position - eye.target
    distance = np.linalg.norm(away)
    return eye._replace(position=eye.target + away * max(1.0, np.percentile(needed, 100.0 - _OUTLIERS) / distance))


def _handled(world: World, result: FrameResult) -> NDArray[np.int64]:
    """Simulated bodies that a driven one touches in a frame."""
    role, contacts = world.scene.bodies.role, result.contacts
    a, b = contacts.body_a.astype(np.int64), contacts.body_b.astype(np.int64)
    pairs = np.concatenate([np.stack([a, b], axis=1), np.stack([b, a], axis=1)])
    return np.unique(pairs[(role[pairs[:, 0]] == SIMULATED) & (role[pairs[:, 1]] == DRIVEN), 0])


def sample_of(results: Iterable[FrameResult], count: int = 64) -> list[FrameResult]:
    """Fewer than `2 * count` results, evenly spread over a sequence of unknown length."""
    samples = EvenSamples[FrameResult](2 * count)
    for result in results:
        samples.offer(result)
    return samples.items


def _bodies_in_focus(world: World, results: Sequence[FrameResult], boxes: _Box, focus: str | None) -> NDArray[np.int64]:
    """Bodies to be seen: those named; else driven trees in contact or corrected, else what is driven, moves, is there."""
    scene = world.scene
    if focus is not None:
        names = enumerate(zip(world.body_names, world.frame_names, strict=True))
        named = [b for b, (name, frame) in names if focus in (name, frame, name.split("/")[0])]
        if not named:
            raise ConfigError(f"no body {focus!r} in the scene; it has {', '.join(world.body_names[:12])} …")
        return np.array([b for b in named if boxes.solid[b]] or named)
    driven = scene.bodies.role == DRIVEN
    busy = np.zeros(len(driven), bool)
    for result in results:
        busy |= frame_columns.in_contact(ResultColumns.of(result), len(driven))[0]
        busy |= frame_columns.is_corrected(result.recorded[None], result.corrected[None])[0]
    trees = np.unique(scene.bodies.tree[busy & driven])
    moving = (scene.bodies.role != FIXED) | (scene.trees.moving[scene.bodies.tree] != 0)
    for candidates in (np.isin(scene.bodies.tree, trees), driven, moving, np.ones(len(driven), bool)):
        found = np.flatnonzero(candidates & boxes.solid)
        if len(found):
            return found
    return np.arange(len(driven))


def _boxes(world: World) -> _Box:
    shapes = [vertices if len(vertices) else np.zeros((1, 3)) for vertices, _ in world.triangles]
    return _Box(
        np.array([s.min(axis=0) for s in shapes]).reshape(-1, 3),
        np.array([s.max(axis=0) for s in shapes]).reshape(-1, 3),
        np.array([len(faces) > 0 for _, faces in world.triangles], bool),
    )


def _corners(boxes: _Box, poses: Floats, bodies: NDArray[np.int64]) -> Floats:
    """Corners (8 n, 3) of the boxes of bodies, world frame."""
    unit = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    low, high = boxes.low[bodies], boxes.high[bodies]
    corners = low[:, None] + (high - low)[:, None] * unit
    placed = np.einsum("bij,bkj->bki", rotation_from_quaternion(poses[bodies, 3:]), corners)
    flat: Floats = (placed + poses[bodies, None, :3]).reshape(-1, 3)
    return flat


def _triangles(world: World, result: FrameResult, bodies: NDArray[np.int64]) -> Floats:
    """Triangles (n, 3, 3) of bodies, world frame."""
    found = [np.zeros((0, 3, 3))]
    for body in bodies:
        vertices, faces = world.triangles[body]
        pose = result.corrected[body]
        found.append((vertices @ rotation_from_quaternion(pose[3:]).T + pose[:3])[faces])
    return np.concatenate(found)
