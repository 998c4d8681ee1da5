"""Fits the offset of a tracker, the poses of surfaces and lengths of fingers to frames of contact: robust Gauss-Newton.

Unknown are small changes: of the root link seen from the tracker (translation, and rotation about its origin, both along the
tracker's axes), of each surface (height along the world's z, tilt about x and y through the middle of the contacts), and of each
finger (factor of its lengths). The residuals are the gaps of the links that touch, penetration and float alike. A change has
length 1 where it is `LENGTH`, `ANGLE` or `SHARE`: as much as a value may be wrong to be known.

What the frames show is said by the covariance of the changes: that of the measurements, whose variance is estimated from the
gaps that are left, with changes of the size of `EXPECTED` as prior. A touch is one measurement and a hand that lies flat three,
however many frames and points it has, as their errors are not independent. To it is added what lies between this fit and others
that are as good (`SAME_COST`), which are searched from many starts: with few touches another corner of the hand may touch.
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
from geomphys.scene.world import World

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
CONFIDENCE = 2.5
"""Standard deviations within which a change has to be known to one unit."""
DEVIATION = 0.5e-3
"""m; standard deviation of a measurement before anything is known of it,"""
PRIOR_WEIGHT = 3.0
"""which counts as so many measurements."""
STAGES = ((0.03, 0.03), (0.015, 0.01), (0.008, 0.005), (0.004, 0.003), (0.002, 0.0015))
"""m; how much higher than the lowest a point may be and count as touching, and the scale of the robust loss; in turn."""
ITERATIONS = 12
"""Steps of a stage."""
MAX_STEP = 20.0
"""Units; longest step."""
STARTS = 10
"""Random changes of the size of `EXPECTED` that are started from besides none,"""
NEAR_STARTS = 6
"""and changes within `NEAR` standard deviations of the best, in which it is sure least."""
NEAR = 3.0
SAME_COST = 16.0
"""Variances; fits whose costs differ by less are as good: chi-square of 9 values, 93 %."""
FLAT_MEASURES = 3
"""Measurements that a hand makes that lies flat: height and tilt."""


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


class ContactFit(NamedTuple):
    """Result of a fit."""

    change: Floats  # (N,) in units: 6 of the offset if it is sought, then 3 a surface, then 1 a finger
    covariance: Floats  # (N, N) of it
    pivots: dict[int, Floats]  # surface -> middle of its contacts (3,), which it tilts about
    residual: float  # m, median of the absolute gaps
    percentile_90: float  # m, 90th percentile


class _Gaps(NamedTuple):
    """Gaps of the m points that touch."""

    gap: Floats  # (m,) m
    jacobian: Floats  # (m, N)
    weight: Floats  # (m,) measurements each counts as


class _Frames(NamedTuple):
    """C frames of contact, the avatar posed in each, and P points on it."""

    contacts: Sequence[Contact]
    world_from_tracker: Floats  # (C, 4, 4)
    points: Floats  # (C, P, 3) m, in the frame of the root link
    radii: Floats  # (P,) m
    touching: NDArray[np.bool_]  # (C, P) whether a point may touch
    origins: Floats  # (C, F, 3) m, where fingers begin, in the frame of the root link
    stretch: Ints  # (C,)
    is_touch: NDArray[np.bool_]  # (C,)
    surface: Ints  # (C,) tree that is touched


class ContactProblem:
    """Gaps of the frames of contact as functions of the changes."""

    def __init__(
        self, world: World, tree: int, tracker_from_root: Floats, contacts: Sequence[Contact], unknowns: Unknowns
    ) -> None:
        """`tracker_from_root` (4, 4) is the offset as the frames have it."""
        self.tree, self.unknowns = tree, unknowns
        self._meter, self._offset = GapMeter(world), tracker_from_root
        self._members = [np.isin(self._meter.bodies_of(tree), sorted(f.bodies)) for f in unknowns.fingers]
        self._frames = self._posed(contacts)
        few: dict[tuple[int, int], Contact] = {}
        for contact in contacts:
            few.setdefault((contact.surface, contact.stretch), contact)
        self._few = self._posed(list(few.values()))
        self.pivots = dict.fromkeys(unknowns.surfaces, np.zeros(3))
        self.pivots = {surface: self._middle(surface) for surface in unknowns.surfaces}

    def fit(self) -> ContactFit:
        """Fit all frames: from the scene as it is or, where an offset is sought, from the best of several starts."""
        start, others = np.zeros(self.unknowns.size), list[Floats]()
        if self.unknowns.offset or self.unknowns.fingers:
            rng, expected = np.random.default_rng(0), self.unknowns.expected
            found = [self._descend(start, self._few)]
            for _ in range(STARTS):
                found.append(self._descend(rng.uniform(-1.5, 1.5, len(start)) * expected, self._few))
            best = min(found, key=self._cost)
            near = np.linalg.cholesky(self._covariance(best, self._few)[0])
            for _ in range(NEAR_STARTS):
                direction = rng.normal(size=len(start))
                direction *= NEAR / np.linalg.norm(direction) * np.sqrt(len(start) / 3)
                found.append(self._descend(best + near @ direction, self._few))
            start = min(found, key=self._cost)
            limit = self._cost(start) + SAME_COST * self._covariance(start, self._few)[1]
            others = [other - start for other in found if self._cost(other) <= limit]
        change = self._descend(start, self._frames)
        covariance = with_differences(self._covariance(change, self._frames)[0], others)
        absolute = np.abs(self._linearise(change, STAGES[-1][0], self._frames, self._planes(change, self._frames)).gap)
        residual, percentile_90 = (
            float(np.percentile(absolute, share)) if len(absolute) else 0.0 for share in (50, 90)
        )
        return ContactFit(change, covariance, self.pivots, residual, percentile_90)

    def _covariance(self, change: Floats, frames: _Frames) -> tuple[Floats, float]:
        """Covariance (N, N) of the changes, and variance [m²] of a measurement."""
        found = self._linearise(change, STAGES[-1][0], frames, self._planes(change, frames))
        scale = STAGES[-1][1]
        squares = float(np.sum(found.weight * scale**2 * np.log1p((found.gap / scale) ** 2)))
        measured, prior = float(found.weight.sum()), np.diag(self.unknowns.expected**-2.0)
        information = (found.jacobian * found.weight[:, None]).T @ found.jacobian
        variance = DEVIATION**2
        for _ in range(4):
            covariance = np.linalg.inv(information / variance + prior)
            shown = len(change) - float(np.trace(covariance @ prior))
            reserve = max(measured - shown, 0.0)
            variance = (PRIOR_WEIGHT * DEVIATION**2 + squares) / (PRIOR_WEIGHT + reserve)
        final: Floats = np.asarray(np.linalg.inv(information / variance + prior), dtype=np.float64)
        return final, variance

    def _cost(self, change: Floats) -> float:
        """m², robust sum of squared gaps of the few frames."""
        found = self._linearise(change, STAGES[-1][0], self._few, self._planes(change, self._few))
        scale = STAGES[-1][1]
        return float(np.sum(found.weight * scale**2 * np.log1p((found.gap / scale) ** 2)))

    def _descend(self, change: Floats, frames: _Frames) -> Floats:
        """The minimum that is reached from a change, all stages in turn."""
        expected = self.unknowns.expected
        for band, scale in STAGES:
            planes = self._planes(change, frames)
            for _ in range(ITERATIONS):
                found = self._linearise(change, band, frames, planes)
                root = np.sqrt(found.weight / (1.0 + (found.gap / scale) ** 2))  # Cauchy
                step = _ridge_step(found.jacobian * root[:, None], found.gap * root, change, scale / 3.0 / expected)
                length = float(np.abs(step).max(initial=0.0))
                change = change + step * min(1.0, MAX_STEP / max(length, 1e-12))
                if length < 5e-3:
                    break
        return change

    def _posed(self, contacts: Sequence[Contact]) -> _Frames:
        """Frames of contact as arrays."""
        bodies, points, origins, trackers = self._meter.bodies_of(self.tree), [], [], []
        radii = self._meter.radii_of(self.tree)
        for contact in contacts:
            centres, poses = self._meter.pose(self.tree, contact.frame.roots, contact.frame.angles)
            world_from_root = matrix_from_pose(contact.frame.roots[self.tree])
            root_from_world = invert(world_from_root)
            points.append(centres @ root_from_world[:3, :3].T + root_from_world[:3, 3])
            starts = poses[[f.first for f in self.unknowns.fingers], :3]
            origins.append(starts @ root_from_world[:3, :3].T + root_from_world[:3, 3])
            trackers.append(compose(world_from_root, invert(self._offset)))
        count = len(contacts)
        links = np.array([c.link for c in contacts], dtype=np.int64).reshape(count, 1)
        return _Frames(
            contacts,
            np.array(trackers).reshape(count, 4, 4),
            np.array(points).reshape(count, len(bodies), 3),
            radii,
            (links < 0) | (bodies[None] == links),
            np.array(origins).reshape(count, len(self.unknowns.fingers), 3),
            np.array([c.stretch for c in contacts], dtype=np.int64),
            np.array([c.is_touch for c in contacts], dtype=bool),
            np.array([c.surface for c in contacts], dtype=np.int64),
        )

    def _world_points(self, change: Floats, frames: _Frames) -> tuple[Floats, Floats, Floats, Floats]:
        """Points (C, P, 3), radii (P,), poses of the root (C, 4, 4), and points from where their finger begins (C, P, 3)."""
        tracker_from_root = self._offset.copy()
        if self.unknowns.offset:
            tracker_from_root = moved_offset(tracker_from_root, change[:6])
        roots = frames.world_from_tracker @ tracker_from_root
        points, radii, arms = frames.points, frames.radii, np.zeros_like(frames.points)
        factors = 1.0 + SHARE * change[self.unknowns.size - len(self.unknowns.fingers) :]
        for k, members in enumerate(self._members):
            points, radii = points.copy() if k == 0 else points, radii.copy() if k == 0 else radii
            arms[:, members] = frames.points[:, members] - frames.origins[:, k, None]
            points[:, members] = frames.origins[:, k, None] + factors[k] * arms[:, members]
            radii[members] = factors[k] * frames.radii[members]
        rotated = np.einsum("cij,cpj->cpi", roots[:, :3, :3], points) + roots[:, None, :3, 3]
        return rotated, radii, roots, np.einsum("cij,cpj->cpi", roots[:, :3, :3], arms)

    def _surfaces(self, change: Floats, contact: Contact) -> Floats:
        """Poses (T, 7) of the trees of a frame with the surfaces moved."""
        roots, first = contact.frame.roots.copy(), 6 * self.unknowns.offset
        for k, surface in enumerate(self.unknowns.surfaces):
            part = change[first + 3 * k : first + 3 * k + 3]
            roots[surface] = moved_surface(roots[surface], part, self.pivots[surface])
        return roots

    def _planes(self, change: Floats, frames: _Frames) -> Floats:
        """(C, 6) normal and point of the surface where it is nearest to the avatar, in the frame of the surface."""
        planes = np.zeros((len(frames.contacts), 6))
        tracker_from_root = moved_offset(self._offset, change[:6]) if self.unknowns.offset else self._offset
        for c, contact in enumerate(frames.contacts):
            roots = self._surfaces(change, contact)
            roots[self.tree] = pose_from_matrix(compose(frames.world_from_tracker[c], tracker_from_root))
            normal, point = self._meter.nearest_plane(
                self.tree, contact.surface, roots, contact.frame.angles, contact.link
            )
            rotation = rotation_from_quaternion(roots[contact.surface, 3:])
            planes[c, :3] = normal @ rotation
            planes[c, 3:] = (point - roots[contact.surface, :3]) @ rotation
        return planes

    def _middle(self, surface: int) -> Floats:
        """Mean of the lowest points of the contacts with a surface, (3,) world frame."""
        points, radii, _, _ = self._world_points(np.zeros(self.unknowns.size), self._frames)
        planes, found = self._planes(np.zeros(self.unknowns.size), self._frames), []
        for c, contact in enumerate(self._frames.contacts):
            if contact.surface == surface:
                normal = rotation_from_quaternion(contact.frame.roots[surface, 3:]) @ planes[c, :3]
                height = np.where(self._frames.touching[c], points[c] @ normal - radii, np.inf)
                found.append(points[c, int(height.argmin())])
        return np.mean(found, axis=0) if found else np.zeros(3)

    def _linearise(self, change: Floats, band: float, frames: _Frames, planes: Floats) -> _Gaps:
        """Gaps of the points that touch, and their derivatives."""
        unknowns = self.unknowns
        points, radii, roots, arms = self._world_points(change, frames)
        surfaces = np.array([self._surfaces(change, c)[c.surface] for c in frames.contacts]).reshape(-1, 7)
        rotations = np.array([rotation_from_quaternion(q) for q in surfaces[:, 3:]]).reshape(-1, 3, 3)
        normals = np.einsum("cij,cj->ci", rotations, planes[:, :3])
        at = np.einsum("cij,cj->ci", rotations, planes[:, 3:]) + surfaces[:, :3]
        gaps = np.einsum("ci,cpi->cp", normals, points - at[:, None]) - radii
        gaps[~frames.touching] = np.inf
        lowest = gaps.min(axis=1, keepdims=True, initial=np.inf)
        chosen = gaps <= lowest + np.where(frames.is_touch, 0.0, band)[:, None]
        chosen &= np.isfinite(gaps) & ((np.cumsum(chosen, axis=1) == 1) | ~frames.is_touch[:, None])
        c, p = np.nonzero(chosen)
        n, x = normals[c], points[c, p] - radii[p, None] * normals[c]
        jacobian = np.zeros((len(c), unknowns.size))
        first = 6 * unknowns.offset
        if unknowns.offset:
            axes = frames.world_from_tracker[c, :3, :3]
            jacobian[:, :3] = LENGTH * np.einsum("mi,mij->mj", n, axes)
            jacobian[:, 3:6] = ANGLE * np.einsum("mi,mij->mj", np.cross(x - roots[c, :3, 3], n), axes)
        for k, surface in enumerate(unknowns.surfaces):
            on = frames.surface[c] == surface
            column = first + 3 * k
            jacobian[on, column] = -LENGTH * n[on, 2]
            jacobian[on, column + 1 : column + 3] = -ANGLE * np.cross(x[on] - self.pivots[surface], n[on])[:, :2]
        for k, members in enumerate(self._members):
            own = members[p]
            column = first + 3 * len(unknowns.surfaces) + k
            jacobian[own, column] = SHARE * (np.einsum("mi,mi->m", n[own], arms[c[own], p[own]]) - frames.radii[p[own]])
        counts = np.bincount(frames.stretch[c]) if len(c) else np.zeros(1)
        measures = np.where(frames.is_touch[c], 1.0, FLAT_MEASURES)
        return _Gaps(gaps[c, p], jacobian, measures / counts[frames.stretch[c]])


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


def _ridge_step(jacobian: Floats, gaps: Floats, change: Floats, ridge: Floats) -> Floats:
    """Step to the least of |gaps + jacobian step|² + |ridge (change + step)|²."""
    normal = jacobian.T @ jacobian + np.diag(ridge**2)
    return -np.asarray(np.linalg.solve(normal, jacobian.T @ gaps + ridge**2 * change), dtype=np.float64)


def with_differences(covariance: Floats, differences: Sequence[Floats]) -> Floats:
    """Covariance (N, N) so large that each difference (N,) is at most one standard deviation."""
    for difference in differences:
        square = float(difference @ np.linalg.solve(covariance, difference))
        if square > 1.0:
            covariance = covariance + np.outer(difference, difference) * (1.0 - 1.0 / square)
    return covariance
