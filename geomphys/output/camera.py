"""Chooses the viewpoint of a scene: close to the motion, from a direction with little occlusion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_DISTANCE = 1.9  # of the radius of the points in view
_AZIMUTHS = np.radians(np.arange(-60, 300, 15))
_ELEVATIONS = np.radians([28.0, 45.0, 15.0, 65.0])  # in order of preference
_RAYS = 4_000_000  # most pairs of a ray and a triangle that are tested


_IGNORED = 0.15  # of that radius: geometry this close to a contact does not count as occluding it
_CLEARANCE = 0.7  # of that radius: preferred distance of the eye from static bodies


class ContactFrame(NamedTuple):
    """A frame with contacts, world frame, m."""

    points: Floats  # (k, 3) contact points
    triangles: Floats  # (m, 3, 3) of moving bodies that may occlude them


class Viewpoint(NamedTuple):
    """A camera position and the point it looks at, world frame, m."""

    position: Floats  # (3,)
    target: Floats  # (3,)


def choose_viewpoint(points: Floats, triangles: Floats, contact_frames: Sequence[ContactFrame] = ()) -> Viewpoint:
    """Choose the direction from which most of the points and contacts are visible.

    Parameters
    ----------
    points : (n, 3) m
        Positions of the motion; n may be 0.
    triangles : (m, 3, 3) m
        Static geometry that may occlude them.
    contact_frames : sequence of ContactFrame
    """
    if len(points) == 0:
        points = triangles.reshape(-1, 3) if len(triangles) else np.zeros((1, 3))
    low, high = np.percentile(points, [0.5, 99.5], axis=0)
    target = (low + high) / 2
    radius = max(float(np.linalg.norm(high - low)) / 2, 0.1) + 0.02
    candidates = [
        (np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)]), 0.04 * rank + 0.003 * azimuth_rank)
        for rank, e in enumerate(_ELEVATIONS)
        for azimuth_rank, a in enumerate(_AZIMUTHS)
    ]
    eyes = np.array([target + _DISTANCE * radius * direction for direction, _ in candidates])
    penalty = np.array([d for _, d in candidates])
    sample = points[:: max(1, len(points) // 24)]
    if len(triangles):
        sample = sample[:: max(1, len(sample) * len(triangles) * len(eyes) // _RAYS)]
        triangles = triangles[:: max(1, len(sample) * len(triangles) * len(eyes) // _RAYS)]
    around = _CLEARANCE * radius * (np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)]) - 1.0)
    best, largest = 0, -np.inf
    for k, eye in enumerate(eyes):  # but for those that cannot be better
        if 1.0 - penalty[k] <= largest:
            continue
        visible = _visible_fraction(eye, sample, triangles)
        shown = [_visible_fraction(eye, m.points, m.triangles, _IGNORED * radius) for m in contact_frames]
        if _score(visible, 1.0, shown) - penalty[k] <= largest:
            continue
        clear = _visible_fraction(eye, eye + around, triangles, 0.0)
        score = _score(visible, clear, shown) - penalty[k]
        if score > largest:
            best, largest = k, score
    return Viewpoint(eyes[best], target)


def _score(visible: float, clear: float, shown: Sequence[float]) -> float:
    """How good an eye is, at most 1: points that are visible, directions without a wall nearby, contacts that are visible."""
    score = visible - 0.5 * (1.0 - clear)
    return (score + float(np.mean(shown))) / 2 if shown else score


def _visible_fraction(eye: Floats, points: Floats, triangles: Floats, ignored: float | None = None) -> float:
    """Fraction of points that no triangle occludes from the eye (Möller and Trumbore's test for each pair).

    Triangles nearer to a point than `ignored` (m; None: 3 % of its distance) do not occlude it.
    """
    if len(triangles) == 0:
        return 1.0
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    rays = points - eye
    end = 0.97 if ignored is None else 1.0 - ignored / np.linalg.norm(rays, axis=1)[:, None]
    from_a = eye - a
    determinant = rays @ _cross(ac, ab).T  # (r x ac) . ab = r . (ac x ab)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / determinant
        u = rays @ _cross(ac, from_a).T * inverse
        q = _cross(from_a, ab)
        v = rays @ q.T * inverse
        t = np.einsum("tk,tk->t", ac, q)[None] * inverse
        hit = (np.abs(determinant) > 1e-15) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < end)
    return 1.0 - float(hit.any(axis=1).mean())


def _cross(a: Floats, b: Floats) -> Floats:
    """Cross products (n, 3) of (n, 3), to the bit those of `numpy.cross`, which takes three times as long for few."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
