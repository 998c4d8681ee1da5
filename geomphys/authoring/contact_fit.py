"""Fits the offset of a tracker and the poses of surfaces to frames of contact: robust Gauss-Newton, and what the frames show.

Unknown are small changes: of the root link seen from the tracker (translation and rotation about the tracker's axes), and
of each surface (height along the world's z, tilt about x and y through the middle of the contacts). The residuals are the
gaps of the links that touch, penetration and float alike. A change has length 1 where it is `LENGTH` or `ANGLE`.

Every stretch counts as one measurement, however many frames and points it has: their errors are not independent. The singular
values of the Jacobian say which changes the stretches show: a direction whose unit changes their gaps by less than `INSENSITIVE`
(root of the sum of squares) is one that they do not. Nor do they show what lies between two changes that both fit, which are
looked for from several starts: with few touches another corner of the hand may touch.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.authoring.contact_frames import Contact
from geomphys.authoring.surface_gaps import GapMeter, PointGaps
from geomphys.numerics.transforms import (
    compose,
    invert,
    matrix_from_pose,
    pose_from_matrix,
    quaternion_product,
    rotation_about,
)
from geomphys.scene.arrays import World

Floats = NDArray[np.float64]

LENGTH = 0.01
"""m; unit of translations."""
ANGLE = 0.1
"""rad; unit of rotations."""
INSENSITIVE = 2.5e-3
"""m; a unit change that moves the gaps by less is not shown: of what an error of 0.5 mm makes 2 mm."""
EXPECTED = 3.0
"""Units; changes of this size are expected: what the frames hardly show stays near zero."""
STAGES = ((0.03, 0.03), (0.015, 0.01), (0.008, 0.005), (0.004, 0.003), (0.002, 0.0015))
"""m; how much higher than the lowest a point may be and count as touching, and the scale of the robust loss; in turn."""
ITERATIONS = 12
"""Steps of a stage."""
MAX_STEP = 4.0
"""Units; longest step."""


STARTS = 4
"""Random changes that are started from besides none: with few touches several changes fit as well."""
START_FRAMES = 1
"""Frames of a stretch that the starts are fitted to."""
START_LENGTH = 0.05
"""m; largest change that is started from."""
START_ANGLE = 0.15
"""rad; the same of rotations."""
SAME_COST = 17.0 * 0.001**2
"""m²; fits whose costs differ by less are as good: chi-square of 9 values, 95 %, for errors of 1 mm a touch."""
RESERVE = 3
"""Touches in reserve that a fit needs: with none any corner of the hand can be made to touch."""
PLENTY = 10
"""Measurements more than unknowns from which on one start is enough."""
SAME_CHANGE = 0.2
"""Units; fits that differ by less are the same."""


class Unknowns(NamedTuple):
    """Which changes are sought."""

    offset: bool  # of the tracker
    surfaces: tuple[int, ...]  # trees

    @property
    def size(self) -> int:
        """Number of changes."""
        return 6 * self.offset + 3 * len(self.surfaces)


class Minimum(NamedTuple):
    """Where a search ended."""

    change: Floats  # (N,)
    cost: float  # m², robust sum of squared gaps, a stretch counting as one


class ContactFit(NamedTuple):
    """Result of a fit."""

    change: Floats  # (N,) in units: 6 of the offset if it is sought, then 3 a surface
    hidden: Floats  # (N, M) orthonormal directions that the frames do not show, or in which other changes fit as well
    pivots: dict[int, Floats]  # surface -> middle of its contacts (3,), which it tilts about
    residual: float  # m, median of the absolute gaps
    percentile_90: float  # m, 90th percentile


class ContactProblem:
    """Gaps of the frames of contact as functions of the changes."""

    def __init__(
        self, world: World, tree: int, tracker_from_root: Floats, contacts: Sequence[Contact], unknowns: Unknowns
    ) -> None:
        """`tracker_from_root` (4, 4) is the offset as the frames have it."""
        self.tree, self.contacts, self.unknowns = tree, contacts, unknowns
        self._meter = GapMeter(world)
        self._offset, self._from_root = tracker_from_root, invert(tracker_from_root)
        self.pivots = {surface: self._middle(surface) for surface in unknowns.surfaces}

    def fit(self) -> ContactFit:
        """Fit all frames, from the scene as it is or, where several offsets may fit, from the best of several starts."""
        start, others = np.zeros(self.unknowns.size), list[Floats]()
        if self.unknowns.offset and self._measured() - self.unknowns.size < PLENTY:
            found = self._minima()
            best = min(found, key=lambda minimum: minimum.cost)
            start, others = best.change, [m.change - best.change for m in found if m.cost <= best.cost + SAME_COST]
        change = self._descend(start, self.contacts)
        gaps, jacobian, shares = self.linearise(change, STAGES[-1][0])
        absolute = np.abs(gaps)
        residual, percentile_90 = (float(np.percentile(absolute, share)) if len(gaps) else 0.0 for share in (50, 90))
        hidden = _with_differences(_hidden(jacobian * np.sqrt(shares)[:, None], self._most_shown()), others)
        return ContactFit(change, hidden, self.pivots, residual, percentile_90)

    def _touches(self) -> dict[tuple[int, int], bool]:
        """Surface and number of each stretch -> whether it is a touch."""
        return {(c.surface, c.stretch): c.is_touch for c in self.contacts}

    def _measured(self) -> int:
        """Number of independent measurements: three by a hand that lies flat, one by a touch."""
        return sum(1 if is_touch else 3 for is_touch in self._touches().values())

    def _most_shown(self) -> int:
        """Number of directions that may be shown: as many as are measured, but for `RESERVE` where an offset is sought."""
        touches = sum(self._touches().values())
        reserve = min(RESERVE, max(touches - 1, 0))
        return self._measured() - reserve if self.unknowns.offset else self.unknowns.size

    def _minima(self) -> list[Minimum]:
        """Minima from the scene as it is and from `STARTS` random changes, by `START_FRAMES` frames of each stretch."""
        few: dict[tuple[int, int], list[Contact]] = {}
        for contact in self.contacts:
            few.setdefault((contact.surface, contact.stretch), []).append(contact)
        thinned = [c for group in few.values() for c in group[:: max(1, len(group) // START_FRAMES)][:START_FRAMES]]
        rng, limit = np.random.default_rng(0), np.full(self.unknowns.size, START_ANGLE / ANGLE)
        first = 6 * self.unknowns.offset
        limit[: first // 2], limit[first::3] = START_LENGTH / LENGTH, START_LENGTH / LENGTH
        found = []
        for start in range(1 + STARTS):
            change = self._descend(np.zeros(len(limit)) if start == 0 else rng.uniform(-limit, limit), thinned)
            gaps, _, shares = self.linearise(change, STAGES[-1][0], thinned)
            scale = STAGES[-1][1]
            found.append(Minimum(change, float(np.sum(shares * scale**2 * np.log1p((gaps / scale) ** 2)))))
        return found

    def _descend(self, change: Floats, contacts: Sequence[Contact]) -> Floats:
        """The minimum that is reached from a change, all stages in turn."""
        for band, scale in STAGES:
            for _ in range(ITERATIONS):
                gaps, jacobian, shares = self.linearise(change, band, contacts)
                weights = shares / (1.0 + (gaps / scale) ** 2)  # Cauchy
                root = np.sqrt(weights)
                step = _ridge_step(jacobian * root[:, None], gaps * root, change, scale / EXPECTED)
                length = float(np.abs(step).max(initial=0.0))
                change = change + step * min(1.0, MAX_STEP / max(length, 1e-12))
                if length < 1e-3:
                    break
        return change

    def _middle(self, surface: int) -> Floats:
        """Mean of the lowest points of the contacts with a surface, (3,) world frame."""
        points = []
        for contact in self.contacts:
            if contact.surface == surface:
                found = self._meter.measure(self.tree, surface, contact.frame.roots, contact.frame.angles)
                points += [found.point[k] for k in _touching(found, contact, 0.0)]
        return np.mean(points, axis=0) if points else np.zeros(3)

    def linearise(
        self, change: Floats, band: float, contacts: Sequence[Contact] | None = None
    ) -> tuple[Floats, Floats, Floats]:
        """Gaps (m,) of the points that touch, their derivatives (m, N), and the share of each in its stretch (m,).

        Of all frames of contact, or of `contacts`.
        """
        offset, surfaces = self._split(change)
        root_from_root = self._from_root @ offset_matrix(offset) @ self._offset
        gaps, rows, stretches = [], [], []
        for contact in self.contacts if contacts is None else contacts:
            roots = contact.frame.roots.copy()
            before = matrix_from_pose(roots[self.tree])
            roots[self.tree] = pose_from_matrix(compose(before, root_from_root))
            for surface, part in surfaces.items():
                roots[surface] = moved_surface(roots[surface], part, self.pivots[surface])
            found = self._meter.measure(self.tree, contact.surface, roots, contact.frame.angles)
            world_from_tracker = compose(before, self._from_root)
            for k in _touching(found, contact, band):
                gaps.append(found.gap[k])
                stretches.append(contact.stretch)
                rows.append(self._row(world_from_tracker, roots, contact.surface, found.normal[k], found.point[k]))
        counts = np.bincount(stretches) if stretches else np.zeros(1)
        shares = 1.0 / counts[np.array(stretches, dtype=np.int64)]
        return np.array(gaps), np.array(rows).reshape(len(rows), len(change)), shares

    def _row(self, world_from_tracker: Floats, roots: Floats, surface: int, normal: Floats, point: Floats) -> Floats:
        """Derivative (N,) of a gap."""
        row: list[float] = []
        if self.unknowns.offset:
            axes = world_from_tracker[:3, :3]
            arm = point - world_from_tracker[:3, 3]
            row += list(LENGTH * (normal @ axes))
            row += [ANGLE * float(normal @ np.cross(axes[:, k], arm)) for k in range(3)]
        for moved in self.unknowns.surfaces:
            if moved != surface:
                row += [0.0, 0.0, 0.0]
                continue
            arm = point - self.pivots[surface]
            row += [-LENGTH * float(normal[2])]
            row += [-ANGLE * float(normal @ np.cross(np.eye(3)[k], arm)) for k in range(2)]
        return np.array(row)

    def _split(self, change: Floats) -> tuple[Floats, dict[int, Floats]]:
        """Change of the offset (6,) and of each surface (3,)."""
        first = 6 * self.unknowns.offset
        offset = change[:first] if first else np.zeros(6)
        parts = {s: change[first + 3 * k : first + 3 * k + 3] for k, s in enumerate(self.unknowns.surfaces)}
        return offset, parts


def _touching(found: PointGaps, contact: Contact, band: float) -> list[int]:
    """Points that touch: the lowest one of a touch, of a hand that lies flat all that are at most `band` higher."""
    gap = found.gap if contact.link < 0 else np.where(found.link == contact.link, found.gap, np.inf)
    if not np.isfinite(gap).any():
        return []
    if contact.is_touch:
        return [int(gap.argmin())]
    return [int(k) for k in np.flatnonzero(gap <= gap.min() + band)]


def offset_matrix(change: Floats) -> Floats:
    """(4, 4) of a change of the offset (6,) in units: a rotation about the tracker's origin, then a translation."""
    matrix = np.eye(4)
    rotation = ANGLE * change[3:6]
    angle = float(np.linalg.norm(rotation))
    if angle > 0.0:
        matrix[:3, :3] = rotation_about(rotation / angle, angle)
    matrix[:3, 3] = LENGTH * change[:3]
    return matrix


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


def _ridge_step(jacobian: Floats, gaps: Floats, change: Floats, ridge: float) -> Floats:
    """Step to the least of |gaps + jacobian step|² + ridge² |change + step|²."""
    normal = jacobian.T @ jacobian + ridge**2 * np.eye(len(change))
    return -np.asarray(np.linalg.solve(normal, jacobian.T @ gaps + ridge**2 * change), dtype=np.float64)


def _hidden(jacobian: Floats, most: int) -> Floats:
    """(N, M) orthonormal directions that the frames do not show: at least all but the `most` of largest singular value."""
    _, s, vt = np.linalg.svd(jacobian, full_matrices=True)
    values = np.zeros(len(vt))
    values[: len(s)] = s
    values[most:] = 0.0
    hidden: Floats = vt[values <= INSENSITIVE].T
    return hidden


def _with_differences(hidden: Floats, differences: Sequence[Floats]) -> Floats:
    """Hidden directions (N, M), and those of differences (N,) that are longer than `SAME_CHANGE` without them."""
    for difference in sorted(differences, key=lambda d: -float(np.linalg.norm(d))):
        rest = difference - hidden @ (hidden.T @ difference)
        length = float(np.linalg.norm(rest))
        if length > SAME_CHANGE:
            hidden = np.column_stack([hidden, rest / length])
    return hidden
