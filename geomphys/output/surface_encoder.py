"""Encodes the display meshes of all bodies as one foxglove.SceneUpdate, so that a file shows them wherever it is opened."""

from __future__ import annotations

from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from geomphys.output.colours import colours_of_trees
from geomphys.scene.arrays import World


def encode_surfaces(world: World, time_ns: int) -> bytes:
    """The message: one entity for each body with a surface, of its name, in its frame and moving with it."""
    palette = colours_of_trees(world.file)
    message = SceneUpdate()
    for body, (vertices, faces) in enumerate(world.triangles):
        if len(faces) == 0:
            continue
        entity = message.entities.add(id=world.body_names[body], frame_id=world.frame_names[body], frame_locked=True)
        entity.timestamp.seconds, entity.timestamp.nanos = divmod(time_ns, 1_000_000_000)
        surface = entity.triangles.add(indices=faces.ravel().tolist())
        surface.pose.orientation.w = 1.0
        colour = palette[world.tree_names[world.scene.bodies.tree[body]]]
        surface.color.r, surface.color.g, surface.color.b, surface.color.a = (channel / 255 for channel in colour)
        for x, y, z in vertices.tolist():
            surface.points.add(x=x, y=y, z=z)
    data: bytes = message.SerializeToString(deterministic=True)
    return data
