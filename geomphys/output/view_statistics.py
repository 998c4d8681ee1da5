"""Samples body poses and contact points during a replay, in bounded memory, to choose the viewpoint."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geomphys.numerics.even_samples import EvenSamples
from geomphys.numerics.transforms import rotation_from_quaternion
from geomphys.output.camera import ContactFrame, Viewpoint, choose_viewpoint
from geomphys.results import ResultColumns
from geomphys.scene.arrays import DRIVEN, FIXED
from geomphys.scene.world import World

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
_Entry = tuple[Floats, Floats]
"""Poses (b, 7) of bodies, and contact points (n, 3), of a frame."""

MAX_FRAMES = 601
"""Fewer frames are sampled: of all frames, and of frames with contacts or corrections."""
MAX_CONTACT_FRAMES = 8
"""Frames with contacts for which occlusion by the avatar itself is checked."""
_MOTION_MARGIN = 2.0
"""The view may be this many times as large as the region of contacts and corrections, to show other motion."""

_BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
_BOX_FACES = np.array(
    [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4),
     (1, 5, 7), (1, 7, 3)]
)  # fmt: skip


class ViewStatistics:
    """Samples poses and contact points evenly over a replay.

    Parameters
    ----------
    world : World
    """

    def __init__(self, world: World) -> None:
        bodies = world.scene.bodies
        moving = (bodies.role != FIXED) | (world.scene.trees.moving[bodies.tree] != 0)
        active = np.flatnonzero(moving & (bodies.role != FIXED))
        driven = active[bodies.role[active] == DRIVEN]
        self._world = world
        self._bodies = driven if len(driven) else active
        self._static_bodies = np.flatnonzero(~moving)
        self._is_driven = bodies.role == DRIVEN
        self._first_poses: Floats | None = None
        self._all = EvenSamples[_Entry](MAX_FRAMES)
        self._event_frames = EvenSamples[_Entry](MAX_FRAMES)
        shapes = [world.triangles[body][0] for body in self._bodies]
        lows = np.array([s.min(axis=0) if len(s) else np.zeros(3) for s in shapes]).reshape(-1, 3)
        highs = np.array([s.max(axis=0) if len(s) else np.zeros(3) for s in shapes]).reshape(-1, 3)
        self._solid = np.array([len(s) > 0 for s in shapes], bool)
        self._corners = lows[:, None] + (highs - lows)[:, None] * _BOX  # (b, 8, 3) body frame

    def add(self, results: ResultColumns) -> None:
        """Add frames, in order."""
        if self._first_poses is None:
            self._first_poses = results.corrected[0].copy()
        contacts = results.contacts
        is_driven = self._is_driven[contacts.body_a] | self._is_driven[contacts.body_b]
        poses, points, ends = results.corrected[:, self._bodies], contacts.point[is_driven], results.contact_end
        ends = np.concatenate([[0], np.cumsum(is_driven)])[ends]
        has_event = (np.diff(ends) > 0) | (results.metrics["correction_m"] > 0.0)
        for row, is_event in enumerate(has_event.tolist()):
            samples = [self._all] if self._all.takes_next() else []
            samples += [self._event_frames] if is_event and self._event_frames.takes_next() else []
            for sample in samples:  # of their own, as the columns are many times as large
                sample.append((poses[row].copy(), points[ends[row] : ends[row + 1]].copy()))

    def viewpoint(self) -> Viewpoint:
        """The viewpoint: it frames contacts and corrections, and the other motion if that is nearby."""
        motion, event_points = self._boxes(self._all), self._boxes(self._event_frames)
        points = motion
        if len(event_points):
            low, high = np.percentile(event_points, [1, 99], axis=0)
            middle, half = (low + high) / 2, (high - low) / 2
            reach = np.maximum(half, 0.5 * half.max()) * _MOTION_MARGIN
            nearby = np.abs(motion - middle) <= reach
            points = np.concatenate([event_points, motion[nearby.all(axis=1)]])
        return choose_viewpoint(points, self._static_triangles(), self._contact_frames())

    def _boxes(self, sample: EvenSamples[_Entry]) -> Floats:
        """Corners (n, 3) of the boxes of all bodies in the sampled frames, world frame, m."""
        poses = np.array([pose for pose, _ in sample.items]).reshape(-1, len(self._bodies), 7)[:, self._solid]
        rotations = rotation_from_quaternion(poses[..., 3:])
        corners = np.einsum("nbij,bkj->nbki", rotations, self._corners[self._solid]) + poses[:, :, None, :3]
        flat: Floats = corners.reshape(-1, 3)
        return flat

    def _contact_frames(self) -> list[ContactFrame]:
        """Contact points, and the boxes of the avatar that may occlude them, of some frames with contacts."""
        in_contact = [entry for entry in self._event_frames.items if len(entry[1])]
        contact_frames = []
        for pose, points in in_contact[:: max(1, -(-len(in_contact) // MAX_CONTACT_FRAMES))]:
            rotations = rotation_from_quaternion(pose[:, 3:])
            corners = np.einsum("bij,bkj->bki", rotations, self._corners) + pose[:, None, :3]
            contact_frames.append(
                ContactFrame(points[:: max(1, len(points) // 4)], corners[self._solid][:, _BOX_FACES].reshape(-1, 3, 3))
            )
        return contact_frames

    def _static_triangles(self) -> Floats:
        """Triangles (n, 3, 3) of static bodies, world frame, m."""
        triangles = [np.zeros((0, 3, 3))]
        if self._first_poses is not None:
            for body in self._static_bodies:
                vertices, faces = self._world.collision_triangles[body]
                rotation = rotation_from_quaternion(self._first_poses[body, 3:])
                triangles.append((vertices @ rotation.T + self._first_poses[body, :3])[faces])
        return np.concatenate(triangles)
