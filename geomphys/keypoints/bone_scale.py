"""Factors from the bone lengths of a model to those of recorded points: for each finger or limb, or one for all.

A *branch* is the part of the tree below the last link with several moving chains: a finger of a hand, a limb. Links
in no branch are the *base*: the palm. A *segment* is a pair of points whose distance no joint changes. A factor is the
least-squares one of the segments' lengths L to the medians m of the recorded distances: sum(L m) / sum(L²). A branch
with fewer than two segments takes the factor of all segments together. Bones of a body differ more than those of a finger:
there each link whose length alone makes that of a segment has a factor of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.keypoints.fit_model import FitModel
from geomphys.keypoints.setup import RIGID, point_distances
from geomphys.numerics.even_samples import EvenSamples

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MIN_LENGTH = 0.005
"""m; shorter segments do not count."""
ROUNDING = 1e-6
"""m; a joint nearer to its link's origin counts as at it."""
MAX_SAMPLES = 4096
"""Distances are measured in fewer frames than this, evenly spread over a recording."""
MIN_SAMPLES = 10
"""Distances that a segment needs."""
DIGITS = 3
"""Decimal places of a factor: 0.05 % of a length."""
BASE = "base"
"""Name of the links in no branch."""


class Segment(NamedTuple):
    """Two points at a constant distance."""

    first: int  # point
    second: int
    length: float  # m, of the model
    branch: str


def branch_names(parents: Ints, columns: Ints, links: Sequence[str]) -> list[str]:
    """Branch of each link (B,): the name of its first link, or `BASE`.

    `parents` (B,), parents first, and `columns` (B,), -1 for a fixed joint, are those of the tree; `links` its names.
    """
    count = len(parents)
    children: list[list[int]] = [[] for _ in range(count)]
    for link in range(1, count):
        children[parents[link]].append(link)
    chains = [0] * count  # tips with a moving joint above them, through or below a link
    for link in reversed(range(count)):
        chains[link] = sum(chains[c] for c in children[link]) or int(columns[link] >= 0)
    names = [BASE] * count
    for link in range(1, count):
        parent = parents[link]
        if names[parent] != BASE:
            names[link] = names[parent]
        elif chains[link] == 1 and chains[parent] > 1:
            names[link] = links[link]
    return names


def find_segments(model: FitModel, branches: list[str]) -> list[Segment]:
    """All pairs of points with a constant distance above zero in any posture."""
    distances = point_distances(model)
    variation, length = np.ptp(distances, axis=0), np.mean(distances, axis=0)
    found = []
    for i in range(len(model.body)):
        for j in range(i + 1, len(model.body)):
            if variation[i, j] < RIGID and length[i, j] > MIN_LENGTH:
                branch = {branches[model.body[i]], branches[model.body[j]]}
                name = branch.pop() if len(branch) == 1 else BASE
                found.append(Segment(i, j, float(length[i, j]), name))
    return found


def segment_owners(model: FitModel, segments: list[Segment]) -> list[int]:
    """Link that alone makes the length of each segment, by where the joints on it are; -1 where several do."""
    owners = []
    for segment in segments:
        ends = [int(model.body[segment.first]), int(model.body[segment.second])]
        offsets: dict[int, Floats] = {}
        while ends[0] != ends[1]:
            side = 0 if ends[0] > ends[1] else 1  # parents come first
            parent, offset = int(model.parent[ends[side]]), model.origin[ends[side], :3]
            offsets[parent] = offsets.get(parent, np.zeros(3)) + (offset if side else -offset)
            ends[side] = parent
        links = [link for link, offset in offsets.items() if np.linalg.norm(offset) > ROUNDING]
        owners.append(links[0] if len(links) == 1 else -1)
    return owners


class DistanceSamples:
    """Recorded lengths of segments, of fewer than `MAX_SAMPLES` frames that are spread evenly over the recording."""

    def __init__(self, segments: list[Segment]) -> None:
        self.segments = segments
        self._samples = EvenSamples[Floats](MAX_SAMPLES)

    def add(self, points: Floats, seen: NDArray[np.int64]) -> None:
        """Add a frame: points (K, 3) m, and which of them are seen."""
        if self._samples.takes_next():
            a = [s.first for s in self.segments]
            b = [s.second for s in self.segments]
            known = (seen[a] != 0) & (seen[b] != 0)
            self._samples.append(np.where(known, np.linalg.norm(points[a] - points[b], axis=1), np.nan))

    def medians(self) -> list[tuple[Segment, float]]:
        """The segments that were seen often enough, and the medians of their lengths [m]."""
        rows = self._samples.items
        table = np.array(rows).reshape(len(rows), len(self.segments))
        return [
            (s, float(np.nanmedian(table[:, k])))
            for k, s in enumerate(self.segments)
            if np.count_nonzero(~np.isnan(table[:, k])) >= MIN_SAMPLES
        ]

    def link_factors(self, model: FitModel) -> dict[int, float]:
        """Link -> factor, of the links whose lengths are measured by themselves."""
        known = self.medians()
        owned: dict[int, list[tuple[Segment, float]]] = {}
        for owner, each in zip(segment_owners(model, [s for s, _ in known]), known, strict=True):
            if owner >= 0:
                owned.setdefault(owner, []).append(each)
        return {owner: _factor(measured) for owner, measured in owned.items()}

    def factors(self, mode: str) -> dict[str, float]:
        """Branch -> factor, for the branches that have a segment and the base; {} if nothing was seen.

        `mode` is "fingers" or "hand".
        """
        known = self.medians()
        if not known:
            return {}
        overall = _factor(known)
        factors = {}
        for branch in sorted({BASE, *(s.branch for s in self.segments)}):
            own = [(s, m) for s, m in known if s.branch == branch]
            factors[branch] = _factor(own) if mode == "fingers" and len(own) >= 2 else overall
        return factors


def _factor(measured: list[tuple[Segment, float]]) -> float:
    """Least-squares factor of the lengths."""
    return round(sum(s.length * m for s, m in measured) / sum(s.length**2 for s, _ in measured), DIGITS)
