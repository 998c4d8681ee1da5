"""Measures the fixed rotation between an oriented point of a palm and the root link, and how well the two agree.

Every source has axes of its own for a wrist or palm. So the recorded orientation is compared, frame by frame, with that of the
root link by the points that no joint moves relative to it (Kabsch 1976). Where the rotation between the two is constant, it is
the convention of the source, and the recorded orientation is used; where it varies, as with orientations that are not filled
in, it is not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from geomphys.keypoints.fit import pose_links
from geomphys.keypoints.fit_model import FitModel
from geomphys.keypoints.setup import nearest_rotation, spans_plane
from geomphys.numerics.even_samples import EvenSamples
from geomphys.numerics.transforms import angle_between, quaternion_from_rotation, quaternion_product
from geomphys.scene.topic_sources import PalmOrientation

Floats = NDArray[np.float64]

MAX_SAMPLES = 1024
"""Rotations are taken of fewer frames than this, evenly spread over a recording."""
MIN_SAMPLES = 20
"""Fewest rotations."""
MAX_DEVIATION = 0.1
"""rad; median angle of the rotations from their mean, above which the orientation is not used."""
MIN_MOTION = 0.02
"""rad; orientations that change by less over a recording are not filled in, or are not needed."""
MIN_DEVIATION = 0.002
"""rad; a smaller median angle counts as this one."""
OWN_SHARE = 0.1
"""Least share of the variance of the rotations that is attributed to the orientation, not to the points."""
MAX_LEVER = 0.2
"""m; most weight of an orientation, see `PalmOrientation.lever`."""
MEDIAN_OF_3 = 1.538
"""Median length of three normal values of variance 1."""


class OrientationSamples:
    """Rotations between the orientations of the oriented points of a model and its root link."""

    def __init__(self, model: FitModel, oriented: Sequence[int]) -> None:
        """`oriented`: candidate points; those whose link is rigid with the root are used."""
        moving = np.zeros(len(model.parent), dtype=bool)  # relative to the root link
        for body in range(1, len(model.parent)):
            moving[body] = moving[model.parent[body]] or model.column[body] >= 0
        self.oriented = [k for k in oriented if not moving[model.body[k]]]
        self._rigid = ~model.shown_by.any(axis=0)
        poses = np.zeros((len(model.parent), 7))
        pose_links(model, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), model.rest, poses)
        self._own = poses[model.body, :3]
        # orientations (K, 4), of the root (4,); see `add`
        self._samples = EvenSamples[tuple[Floats, Floats, float, float]](MAX_SAMPLES)

    @property
    def is_possible(self) -> bool:
        """Whether the model has such points, and enough others that determine its root link."""
        return bool(self.oriented) and spans_plane(self._own[self._rigid])

    def add(self, poses: Floats, seen: NDArray[np.int64]) -> None:
        """Add a frame: poses (K, 7) of the points in the world, and which of them are seen."""
        if self._samples.takes_next():
            use = self._rigid & (seen != 0)
            if all(seen[k] for k in self.oriented) and spans_plane(self._own[use]):
                rotation, left = nearest_rotation(self._own[use], poses[use, :3])
                root = quaternion_from_rotation(rotation)
                self._samples.append((poses[self.oriented, 3:].copy(), root, left, _sensitivity(self._own[use])))

    def orientation(self) -> PalmOrientation | None:
        """The orientation that agrees best with the points; None if none does."""
        rows = self._samples.items
        if len(rows) < MIN_SAMPLES:
            return None
        roots = np.array([row[1] for row in rows])
        distance, sensitivity = (float(np.median([row[k] for row in rows])) for k in (2, 3))
        best: PalmOrientation | None = None
        smallest = MAX_DEVIATION
        for column, k in enumerate(self.oriented):
            recorded = np.array([row[0][column] for row in rows])
            if float(np.max(angle_between(recorded, recorded[0]))) < MIN_MOTION:
                continue
            rotations = quaternion_product(recorded * [-1.0, -1.0, -1.0, 1.0], roots)
            mean = _mean_rotation(rotations)
            angle = float(np.median(angle_between(rotations, mean)))
            if angle < smallest:
                smallest = angle
                total = (max(angle, MIN_DEVIATION) / MEDIAN_OF_3) ** 2
                own = max(total - (distance * sensitivity) ** 2, OWN_SHARE * total)
                lever = round(min(distance / float(np.sqrt(own)), MAX_LEVER), 4)
                best = PalmOrientation(k, tuple(map(float, mean)), lever)
        return best


def _sensitivity(points: Floats) -> float:
    """Standard deviation [rad] of a component of the rotation by points (n, 3) of which each coordinate has one of 1 m."""
    arms = points - points.mean(axis=0)
    inertia = (arms**2).sum() * np.eye(3) - arms.T @ arms
    return float(np.sqrt(np.trace(np.linalg.inv(inertia)) / 3))


def _mean_rotation(rotations: Floats) -> Floats:
    """Mean (4,) of unit quaternions (n, 4), the farther half left out (Markley et al. 2007)."""
    chosen = rotations
    mean: Floats = rotations[0]
    for _ in range(3):
        mean = np.linalg.eigh(chosen.T @ chosen)[1][:, -1]
        angles = angle_between(rotations, mean)
        chosen = rotations[angles <= np.median(angles)]
    return mean * (np.sign(mean[3]) or 1.0)
