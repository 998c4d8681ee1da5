"""Fits lengths of links that no two points measure, such as the moving metacarpal of a little finger.

A link is one of these if it is below a joint, has no point at its origin, and moves points at a distance. Its factor is searched
about that of its branch, as the one with the least fit error on some frames.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from geomphys.keypoints.bone_scale import BASE, DIGITS, ROUNDING
from geomphys.keypoints.fit_model import FitModel
from geomphys.keypoints.fitter import KeypointFitter

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
PointFrames = Sequence[tuple[Floats, Ints]]

MAX_FRAMES = 64
"""Lengths are fitted to fewer frames than this, evenly spread over a recording."""
RANGE = 0.3
"""Factors that are tried are up to this share from that of the branch,"""
STEPS = 13
"""so many, and between them the minimum of a parabola."""


def hidden_links(model: FitModel, branches: Sequence[str]) -> list[int]:
    """Links of a branch (not the base) that are below a joint, have no point, and whose length moves points."""
    count = len(model.parent)
    pointed = set(map(int, model.body))
    found = []
    for link in range(1, count):
        children = [k for k in range(count) if model.parent[k] == link]
        long = [k for k in children if np.linalg.norm(model.origin[k, :3]) > ROUNDING]
        coincident = {link}
        for k in range(link, count):  # the point of a body at the same position
            if model.parent[k] in coincident and np.linalg.norm(model.origin[k, :3]) <= ROUNDING:
                coincident.add(k)
        carries = any(_hangs_on(model, body, link) for body in pointed)
        if branches[link] != BASE and model.column[link] >= 0 and long and carries and not coincident & pointed:
            found.append(link)
    return found


def find_hidden_factors(
    model: FitModel, links: Sequence[int], factors: Mapping[int, float], frames: PointFrames
) -> dict[int, float]:
    """Link -> factor of `links`, each with the others as they are found before it.

    `factors` are those of all links (link -> factor), `frames` points (K, 3) m with which of them are seen (K,).
    """
    found = dict(factors)
    for link in links:
        first = found.get(link, 1.0)
        tried = first * np.linspace(1.0 - RANGE, 1.0 + RANGE, STEPS)
        squares = np.array([_misfit(model, {**found, link: float(f)}, frames) for f in tried])
        best = int(np.clip(squares.argmin(), 1, STEPS - 2))
        low, middle, high = squares[best - 1 : best + 2]
        curvature = low - 2.0 * middle + high
        shift = float(np.clip(0.5 * (low - high) / curvature, -1.0, 1.0)) if curvature > 0 else 0.0
        found[link] = round(float(tried[best] + shift * (tried[1] - tried[0])), DIGITS)
    return {link: found[link] for link in links}


def _misfit(model: FitModel, factors: Mapping[int, float], frames: PointFrames) -> float:
    """m², sum over frames of the mean square distance of a model with other lengths from the points."""
    lengths = np.array([factors.get(int(parent), 1.0) for parent in model.parent])
    origin = model.origin.copy()
    origin[:, :3] *= lengths[:, None]
    fitter = KeypointFitter(model._replace(origin=origin, fits_root=True))
    rest = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    for points, seen in frames:
        fitter.fit(points, seen, rest)
    return fitter.squares


def _hangs_on(model: FitModel, body: int, link: int) -> bool:
    """Whether a body is below a link."""
    while body > link:
        body = int(model.parent[body])
    return body == link
