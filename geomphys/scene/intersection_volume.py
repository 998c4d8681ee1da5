"""The volume that two bodies have in common: a boolean operation on their collision surfaces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geomphys.numerics.transforms import rotation_from_quaternion
from geomphys.scene.world import World

Floats = NDArray[np.float64]


def intersection_volume(world: World, bodies: tuple[int, int], poses: Floats) -> float | None:
    """Volume common to two bodies at world poses (2, 7), m³; None if the surface of one is not closed.

    Of the triangles as they were read, spheres, capsules and cylinders tessellated; to 6 digits, as coordinates are single
    precision.
    """
    from manifold3d import Manifold, Mesh

    solids = []
    for body, pose in zip(bodies, poses, strict=True):
        vertices, faces = world.collision_triangles[body]
        placed: Floats = vertices @ rotation_from_quaternion(pose[3:]).T + pose[:3] - poses[0, :3]
        solid = Manifold(Mesh(placed.astype(np.float32), faces.astype(np.uint32)))
        if solid.is_empty():
            return None
        solids.append(solid)
    return float(f"{(solids[0] ^ solids[1]).volume():.6g}")
