"""Recovers recorded joint values from the recorded poses of links, which an output has."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from geomphys.numerics.transforms import matrix_from_frame, rotation_from_quaternion
from geomphys.output.decoders import Poses
from geomphys.scene.arrays import JOINT_PRISMATIC, World

Floats = NDArray[np.float64]


class RecordedJoints:
    """Joint values of the links' recorded poses: the rotation about, or the displacement along, each joint's axis."""

    def __init__(self, world: World) -> None:
        self._world = world
        bodies = world.scene.bodies
        own = (bodies.dof >= 0) & (bodies.multiplier == 1.0) & (bodies.offset == 0.0)  # others follow a joint
        self._body_of: dict[tuple[str, str], int] = {}
        for body in reversed(np.flatnonzero(own).tolist()):
            avatar = world.tree_names[bodies.tree[body]]
            self._body_of[avatar, world.dof_names[bodies.dof[body]]] = body
        self._origins = matrix_from_frame(bodies.origin)

    def values(self, recorded: Poses, avatar: str, joints: Sequence[str], near: Floats) -> Floats:
        """Recorded values (n,) of joints, rad or m; NaN where a link has no recorded pose.

        An angle is known up to whole turns: of those the one nearest to `near` (n,) is taken.
        """
        world, bodies = self._world, self._world.scene.bodies
        row_of = {name.removeprefix("recorded/"): row for row, name in enumerate(recorded.names)}
        found = np.full(len(joints), np.nan)
        children = [self._body_of.get((avatar, joint), -1) for joint in joints]
        rows = [
            (-1, -1)
            if b < 0
            else (row_of.get(world.frame_names[bodies.parent[b]], -1), row_of.get(world.frame_names[b], -1))
            for b in children
        ]
        usable = np.flatnonzero([parent >= 0 and child >= 0 for parent, child in rows])
        if len(usable) == 0:
            return found
        body = np.array(children)[usable]
        parent, child = (recorded.values[[rows[k][side] for k in usable]] for side in (0, 1))
        world_from_parent = rotation_from_quaternion(parent[:, 3:])
        world_from_joint = world_from_parent @ self._origins[body, :3, :3]
        origin = parent[:, :3] + np.einsum("nij,nj->ni", world_from_parent, self._origins[body, :3, 3])
        joint_from_child = np.swapaxes(world_from_joint, 1, 2) @ rotation_from_quaternion(child[:, 3:])
        axis = bodies.axis[body]
        skew = joint_from_child - np.swapaxes(joint_from_child, 1, 2)
        sine = 0.5 * np.einsum("ni,ni->n", axis, np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1))
        cosine = 0.5 * (np.trace(joint_from_child, axis1=1, axis2=2) - 1.0)
        angle = np.arctan2(sine, cosine)
        angle += 2.0 * np.pi * np.round((near[usable] - angle) / (2.0 * np.pi))
        along = np.einsum("ni,nji,nj->n", axis, world_from_joint, child[:, :3] - origin)
        found[usable] = np.where(bodies.joint[body] == JOINT_PRISMATIC, along, angle)
        return found
