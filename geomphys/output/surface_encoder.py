"""Encodes the display meshes of bodies as foxglove.SceneUpdate, so that a file shows them wherever it is opened."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from numpy.typing import NDArray

from geomphys.output.byte_strings import ByteStrings
from geomphys.output.colours import GHOST, Colour, colours_of_trees
from geomphys.output.protobuf_columns import Rows, message, stamps
from geomphys.scene.arrays import DRIVEN
from geomphys.scene.frame_ids import RECORDED_PREFIX
from geomphys.scene.world import World

GHOST_INSET_M = 3e-4
"""m; ghosts are smaller than their bodies by this on every side, so that a body at its recorded pose hides its ghost."""


def encode_surfaces(world: World, time_ns: int) -> bytes:
    """The message: one entity for each body with a surface, of its name, in its frame and moving with it."""
    return _serialized(_surfaces(world), time_ns)


def encode_ghosts(world: World, time_ns: int) -> bytes:
    """The message: a translucent entity for each driven body with a surface, in the frame in which it was recorded."""
    return _serialized(_ghosts(world), time_ns)


@lru_cache(maxsize=1)
def _surfaces(world: World) -> ByteStrings:
    """The entities, without their times."""
    palette = colours_of_trees(world.facts)
    entities: list[SceneEntity] = []
    for body, mesh in enumerate(world.triangles):
        colour = palette[world.tree_names[world.scene.bodies.tree[body]]]
        entities += _entity(world.body_names[body], world.frame_names[body], mesh, colour)
    return ByteStrings.of([entity.SerializeToString(deterministic=True) for entity in entities])


@lru_cache(maxsize=1)
def _ghosts(world: World) -> ByteStrings:
    """The entities, without their times."""
    entities: list[SceneEntity] = []
    for body in np.flatnonzero(world.scene.bodies.role == DRIVEN):
        vertices, faces = world.triangles[body]
        points = np.round(vertices - GHOST_INSET_M * _outward(vertices, faces), 7)  # m; no rounding of a library shows
        body_name, frame = RECORDED_PREFIX + world.body_names[body], RECORDED_PREFIX + world.frame_names[body]
        entities += _entity(body_name, frame, (points, faces), GHOST)
    return ByteStrings.of([entity.SerializeToString(deterministic=True) for entity in entities])


def _outward(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    """Unit directions (n, 3) out of a mesh at its vertices: means of the faces that meet there; 0 where they cancel."""
    _, position_of = np.unique(vertices, axis=0, return_inverse=True)
    corners = position_of.reshape(-1)[faces]
    a, b, c = vertices[faces].swapaxes(0, 1)
    areas = np.cross(b - a, c - a)
    sums = np.zeros((len(vertices), 3))
    for corner in range(3):
        np.add.at(sums, corners[:, corner], areas)
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    units = np.divide(sums, lengths, out=np.zeros_like(sums), where=lengths > 0.0)
    directions: NDArray[np.float64] = units[position_of.reshape(-1)]
    return directions


def _entity(
    name: str, frame: str, mesh: tuple[NDArray[np.float64], NDArray[np.int64]], colour: Colour
) -> Iterator[SceneEntity]:
    """The entity of a body, if it has a surface."""
    vertices, faces = mesh
    if len(faces) == 0:
        return
    entity = SceneEntity(id=name, frame_id=frame, frame_locked=True)
    surface = entity.triangles.add(indices=faces.ravel().tolist())
    surface.pose.orientation.w = 1.0
    surface.color.r, surface.color.g, surface.color.b, surface.color.a = (channel / 255 for channel in colour)
    for x, y, z in vertices.tolist():
        surface.points.add(x=x, y=y, z=z)
    yield entity


def _serialized(entities: ByteStrings, time_ns: int) -> bytes:
    """The message; the time is the first field of an entity."""
    times = message(SceneEntity, timestamp=stamps(np.array([time_ns])))
    rows = message(SceneUpdate, entities=Rows.beside([times, entities]))
    return rows.split(np.array([len(entities)]))[0]
