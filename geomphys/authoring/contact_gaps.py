"""Gaps between an avatar and the surfaces it touches, in frames of contact, as functions of what a calibration seeks.

Unknown are small changes: of the root link seen from the tracker (translation, and rotation about its origin, both along the
tracker's axes), of each surface (height along the world's z, tilt about x and y through the middle of the contacts), and of each
finger (factor of its lengths). A change has length 1 where it is `LENGTH`, `ANGLE` or `SHARE`: as much as a value may be wrong
to be known.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.authoring.contact_frames import Contact
from geomphys.authoring.surface_gaps import GapMeter
from geomphys.numerics.transforms import (
    compose,
    invert,
    matrix_from_pose,
    pose_from_matrix,
    quaternion_product,
    rotation_about,
    rotation_from_quaternion,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LENGTH = 0.002
"""m; unit of translations."""
ANGLE = float(np.radians(1.0))
"""rad; unit of rotations."""
SHARE = 0.02
"""Unit of factors of lengths."""
EXPECTED = (25.0, 10.0, 25.0, 5.0, 6.0)
"""Units; standard deviation of what is expected of a translation, a rotation, a height, a tilt and a factor."""
FLAT_MEASURES = 3
"""Measurements that a hand makes that lies flat: height and tilt."""
DOWN = 0.5
"""Least downward part of a unit normal that points down."""


class Finger(NamedTuple):
    """A finger whose lengths are unknown."""

    name: str
    first: int  # body it begins with, counted from the tree's first
    bodies: frozenset[int]


class Unknowns(NamedTuple):
    """Which changes are sought."""

    offset: bool  # of the tracker
    surfaces: tuple[int, ...]  # trees
    fingers: tuple[Finger, ...] = ()

    @property
    def size(self) -> int:
        """Number of changes."""
        return 6 * self.offset + 3 * len(self.surfaces) + len(self.fingers)

    @property
    def groups(self) -> list[slice]:
        """Columns that belong together: translation, rotation, heights, tilts, factors."""
        offset = [slice(0, 3), slice(3, 6)] if self.offset else []
        starts = [6 * self.offset + 3 * k for k in range(len(self.surfaces))]
        fingers = 6 * self.offset + 3 * len(self.surfaces)
        return [
            *offset,
            *(s for first in starts for s in (slice(first, first + 1), slice(first + 1, first + 3))),
            *(slice(k, k + 1) for k in range(fingers, self.size)),
        ]

    @property
    def expected(self) -> Floats:
        """(N,) units, standard deviations of what is expected."""
        translation, rotation, height, tilt, factor = EXPECTED
        offset = [translation] * 3 + [rotation] * 3 if self.offset else []
        return np.array([*offset, *([height, tilt, tilt] * len(self.surfaces)), *([factor] * len(self.fingers))])

    @property
    def units(self) -> Floats:
        """(N,) m, degrees or share of a length, of a change of length 1."""
        degrees = float(np.degrees(ANGLE))
        offset = [LENGTH] * 3 + [degrees] * 3 if self.offset else []
        return np.array([*offset, *([LENGTH, degrees, degrees] * len(self.surfaces)), *([SHARE] * len(self.fingers))])


class Planes(NamedTuple):
    """Planes of the surfaces where they are nearest to the avatar in C frames, in the frames of the surfaces."""

    normal: Floats  # (C, 3)
    point: Floats  # (C, 3) m


class Gaps(NamedTuple):
    """Gaps of the m points that touch."""

    gap: Floats  # (m,) m
    jacobian: Floats  # (m, N)
    weight: Floats  # (m,) measurements each counts as


class ContactGaps:
    """The gaps of C frames of contact, with P points on the avatar."""

    def __init__(
        self, meter: GapMeter, tree: int, tracker_from_root: Floats, contacts: Sequence[Contact], unknowns: Unknowns
    ) -> None:
        """`tracker_from_root` (4, 4) is the offset as the frames have it."""
        self._meter, self._tree, self._offset = meter, tree, tracker_from_root
        self._contacts, self.unknowns = contacts, unknowns
        bodies, points, origins, trackers = meter.bodies_of(tree), [], [], []
        for contact in contacts:
            centres, poses = meter.pose(tree, contact.frame.roots, contact.frame.angles)
            world_from_root = matrix_from_pose(contact.frame.roots[tree])
            root_from_world = invert(world_from_root)
            points.append(centres @ root_from_world[:3, :3].T + root_from_world[:3, 3])
            starts = poses[[f.first for f in unknowns.fingers], :3]
            origins.append(starts @ root_from_world[:3, :3].T + root_from_world[:3, 3])
            trackers.append(compose(world_from_root, invert(tracker_from_root)))
        count = len(contacts)
        links = np.array([c.link for c in contacts], dtype=np.int64).reshape(count, 1)
        self._world_from_tracker: Floats = np.array(trackers).reshape(count, 4, 4)
        self._points: Floats = np.array(points).reshape(count, len(bodies), 3)  # m, in the frame of the root link
        self._radii = meter.radii_of(tree)  # (P,) m
        self._may_touch = (links < 0) | (bodies[None] == links)  # (C, P)
        self._members = [np.isin(bodies, sorted(f.bodies)) for f in unknowns.fingers]  # (P,) each
        self._origins: Floats = np.array(origins).reshape(count, len(unknowns.fingers), 3)  # m, where fingers begin
        self._stretch = np.array([c.stretch for c in contacts], dtype=np.int64)
        self._is_touch = np.array([c.is_touch for c in contacts], dtype=bool)
        self._surface = np.array([c.surface for c in contacts], dtype=np.int64)  # tree that is touched
        self._surface_poses: Floats = np.array([c.frame.roots[c.surface] for c in contacts]).reshape(count, 7)
        self.pivots = dict.fromkeys(unknowns.surfaces, np.zeros(3))
        self.pivots = {surface: self._middle(surface) for surface in unknowns.surfaces}
        """Surface -> middle of its contacts (3,), which it tilts about."""

    def first_of_stretches(self) -> ContactGaps:
        """The same with one frame of each stretch, tilting about the same pivots."""
        few: dict[tuple[int, int], Contact] = {}
        for contact in self._contacts:
            few.setdefault((contact.surface, contact.stretch), contact)
        reduced = ContactGaps(self._meter, self._tree, self._offset, list(few.values()), self.unknowns)
        reduced.pivots = self.pivots
        return reduced

    def planes(self, change: Floats) -> Planes:
        """The planes of the surfaces after a change (N,)."""
        roots_of_tree = pose_from_matrix(self._roots(change))
        surfaces = self._moved_surfaces(change)
        normal, point = np.zeros((len(self._contacts), 3)), np.zeros((len(self._contacts), 3))
        for c, contact in enumerate(self._contacts):
            roots = contact.frame.roots.copy()
            roots[contact.surface], roots[self._tree] = surfaces[c], roots_of_tree[c]
            normal[c], point[c] = self._meter.nearest_plane(
                self._tree, contact.surface, roots, contact.frame.angles, contact.link
            )
        rotations = rotation_from_quaternion(surfaces[:, 3:])
        point -= surfaces[:, :3]
        return Planes(np.einsum("cij,ci->cj", rotations, normal), np.einsum("cij,ci->cj", rotations, point))

    def linearise(self, change: Floats, band: float, planes: Planes) -> Gaps:
        """Gaps of the points that touch (of a flat hand all up to `band` [m] higher than the lowest), and their derivatives."""
        unknowns = self.unknowns
        points, radii, roots, arms = self._world_points(change)
        surfaces = self._moved_surfaces(change)
        rotations = rotation_from_quaternion(surfaces[:, 3:])
        normals = np.einsum("cij,cj->ci", rotations, planes.normal)
        at = np.einsum("cij,cj->ci", rotations, planes.point) + surfaces[:, :3]
        gaps = np.einsum("ci,cpi->cp", normals, points - at[:, None]) - radii
        gaps[~self._may_touch] = np.inf
        lowest = gaps.min(axis=1, keepdims=True, initial=np.inf)
        chosen = gaps <= lowest + np.where(self._is_touch, 0.0, band)[:, None]
        chosen &= np.isfinite(gaps) & ((np.cumsum(chosen, axis=1) == 1) | ~self._is_touch[:, None])
        c, p = np.nonzero(chosen)
        n, x = normals[c], points[c, p] - radii[p, None] * normals[c]
        jacobian = np.zeros((len(c), unknowns.size))
        first = 6 * unknowns.offset
        if unknowns.offset:
            axes = self._world_from_tracker[c, :3, :3]
            jacobian[:, :3] = LENGTH * np.einsum("mi,mij->mj", n, axes)
            jacobian[:, 3:6] = ANGLE * np.einsum("mi,mij->mj", np.cross(x - roots[c, :3, 3], n), axes)
        for k, surface in enumerate(unknowns.surfaces):
            on = self._surface[c] == surface
            column = first + 3 * k
            jacobian[on, column] = -LENGTH * n[on, 2]
            jacobian[on, column + 1 : column + 3] = -ANGLE * np.cross(x[on] - self.pivots[surface], n[on])[:, :2]
        for k, members in enumerate(self._members):
            own = members[p]
            column = first + 3 * len(unknowns.surfaces) + k
            jacobian[own, column] = SHARE * (np.einsum("mi,mi->m", n[own], arms[c[own], p[own]]) - self._radii[p[own]])
        counts = np.bincount(self._stretch[c]) if len(c) else np.zeros(1)
        measures = np.where(self._is_touch[c], 1.0, FLAT_MEASURES)
        return Gaps(gaps[c, p], jacobian, measures / counts[self._stretch[c]])

    def count_beneath(self, change: Floats) -> int:
        """Number of frames in which the avatar touches a surface from beneath: whose normal there points down."""
        rotations = rotation_from_quaternion(self._moved_surfaces(change)[:, 3:])
        return int(np.sum(np.einsum("ci,ci->c", rotations[:, 2], self.planes(change).normal) < -DOWN))

    def _roots(self, change: Floats) -> Floats:
        """Poses (C, 4, 4) of the root link."""
        offset = moved_offset(self._offset, change[:6]) if self.unknowns.offset else self._offset
        return self._world_from_tracker @ offset

    def _world_points(self, change: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Points (C, P, 3), radii (P,), poses of the root (C, 4, 4), and points from where their finger begins (C, P, 3)."""
        roots = self._roots(change)
        points, radii, arms = self._points, self._radii, np.zeros_like(self._points)
        factors = 1.0 + SHARE * change[self.unknowns.size - len(self.unknowns.fingers) :]
        for k, members in enumerate(self._members):
            points, radii = points.copy() if k == 0 else points, radii.copy() if k == 0 else radii
            arms[:, members] = self._points[:, members] - self._origins[:, k, None]
            points[:, members] = self._origins[:, k, None] + factors[k] * arms[:, members]
            radii[members] = factors[k] * self._radii[members]
        rotations = roots[:, :3, :3].swapaxes(1, 2)
        return points @ rotations + roots[:, None, :3, 3], radii, roots, arms @ rotations

    def _moved_surfaces(self, change: Floats) -> Floats:
        """Poses (C, 7) of the surfaces; one that is sought has the same pose in all frames."""
        poses, first = self._surface_poses.copy(), 6 * self.unknowns.offset
        for k, surface in enumerate(self.unknowns.surfaces):
            on = self._surface == surface
            if on.any():
                part = change[first + 3 * k : first + 3 * k + 3]
                poses[on] = moved_surface(self._surface_poses[on][0], part, self.pivots[surface])
        return poses

    def _middle(self, surface: int) -> Floats:
        """Mean of the lowest points of the contacts with a surface, (3,) world frame."""
        unchanged = np.zeros(self.unknowns.size)
        points, radii, _, _ = self._world_points(unchanged)
        normals = np.einsum(
            "cij,cj->ci", rotation_from_quaternion(self._surface_poses[:, 3:]), self.planes(unchanged).normal
        )
        height = np.where(self._may_touch, np.einsum("cpi,ci->cp", points, normals) - radii, np.inf)
        lowest = points[np.arange(len(points)), height.argmin(axis=1)][self._surface == surface]
        middle: Floats = lowest.mean(axis=0) if len(lowest) else np.zeros(3)
        return middle


def moved_offset(offset: Floats, change: Floats) -> Floats:
    """Offset (4, 4) after a change (6,) in units: its translation, and its rotation about its own origin."""
    moved = offset.copy()
    rotation = ANGLE * change[3:6]
    angle = float(np.linalg.norm(rotation))
    if angle > 0.0:
        moved[:3, :3] = rotation_about(rotation / angle, angle) @ offset[:3, :3]
    moved[:3, 3] += LENGTH * change[:3]
    return moved


def moved_surface(pose: Floats, change: Floats, pivot: Floats) -> Floats:
    """Pose (7,) of a surface after a change (3,) in units: a rotation about `pivot` (3,), then a translation."""
    moved = pose.copy()
    rotation = ANGLE * np.array([change[1], change[2], 0.0])
    angle = float(np.linalg.norm(rotation))
    if angle > 0.0:
        quaternion = np.array([*(np.sin(angle / 2) * rotation / angle), np.cos(angle / 2)])
        moved[3:] = quaternion_product(quaternion, pose[3:])
        moved[:3] = pivot + rotation_about(rotation / angle, angle) @ (pose[:3] - pivot)
    moved[2] += LENGTH * change[0]
    return moved
