"""Where to look from: near what moves, from a side where nothing stands in between."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_DISTANCE = 2.3  # of the radius of what is looked at
_AZIMUTHS = np.radians(np.arange(-60, 300, 15))
_ELEVATIONS = np.radians([28.0, 45.0, 15.0, 65.0])  # best liked first
_RAYS = 4_000_000  # pairs of a ray and a triangle that are tried at most


class Eye(NamedTuple):
    """A point of view, world frame, m."""

    position: Floats  # (3,)
    target: Floats  # (3,)


def choose_eye(points: Floats, triangles: Floats) -> Eye:
    """The direction from which most of the points are seen.

    Parameters
    ----------
    points : (n, 3) m
        Where things moved; n may be 0.
    triangles : (m, 3, 3) m
        What stands still and may hide them.
    """
    if len(points) == 0:
        points = triangles.reshape(-1, 3) if len(triangles) else np.zeros((1, 3))
    low, high = np.percentile(points, [0.5, 99.5], axis=0)
    target = (low + high) / 2
    radius = max(float(np.linalg.norm(high - low)) / 2, 0.1) + 0.02
    candidates = [
        (np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)]), 0.04 * rank + 0.01 * turn)
        for rank, e in enumerate(_ELEVATIONS)
        for turn, a in enumerate(_AZIMUTHS)
    ]
    eyes = np.array([target + _DISTANCE * radius * direction for direction, _ in candidates])
    dislike = np.array([d for _, d in candidates])
    sample = points[:: max(1, len(points) // 24)]
    if len(triangles):
        sample = sample[:: max(1, len(sample) * len(triangles) * len(eyes) // _RAYS)]
        triangles = triangles[:: max(1, len(sample) * len(triangles) * len(eyes) // _RAYS)]
    seen = np.array([_share_seen(eye, sample, triangles) for eye in eyes])
    best = int(np.argmax(seen - dislike))
    return Eye(eyes[best], target)


def _share_seen(eye: Floats, points: Floats, triangles: Floats) -> float:
    """Share of points that no triangle hides from the eye (Möller and Trumbore's test for each pair)."""
    if len(triangles) == 0:
        return 1.0
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    rays = points - eye
    p = np.cross(rays[:, None], ac[None])
    determinant = np.einsum("ntk,tk->nt", p, ab)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / determinant
        from_a = eye - a
        u = np.einsum("ntk,tk->nt", p, from_a) * inverse
        q = np.cross(from_a, ab)
        v = rays @ q.T * inverse
        t = np.einsum("tk,tk->t", ac, q)[None] * inverse
        hit = (np.abs(determinant) > 1e-15) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < 0.97)
    return 1.0 - float(hit.any(axis=1).mean())
