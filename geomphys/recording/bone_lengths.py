"""Measures the bone lengths of recorded points against those of the models that are fitted to them: a first pass over a log."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.keypoints.bone_scale import BASE, DistanceSamples, branch_names, find_segments
from geomphys.recording.frames import FrameSource, LogPass
from geomphys.recording.name_words import FINGERS, words
from geomphys.scene.arrays import World
from geomphys.storage.remote_files import AnyPath

PLAUSIBLE = (0.4, 2.5)
"""Factors outside of this are those of another unit, or of points that are not what the scene says."""


class BoneScale(NamedTuple):
    """Factors of the lengths of an avatar."""

    branches: dict[str, float]  # finger, limb or "palm" -> factor
    links: dict[str, float]  # link -> factor of its geometry and of the joints on it


def measure_bones(log: AnyPath, world: World, config: Config) -> dict[str, BoneScale]:
    """Factors of the avatars of a scene that are fitted to points and scaled to them.

    Distances are medians over the recording, of at most `geomphys.keypoints.bone_scale.MAX_SAMPLES` frames.

    Raises LogError as `FrameSource` does, and for factors that no hand has.
    """
    modes = {s.tree: s.scale for s in world.keypoints if s.scale != "none"}
    if not modes:
        return {}
    with FrameSource(log, world, config) as source:
        log_pass = LogPass(source, fits=False)
        routes = [k for k in log_pass.keypoints if k.tree in modes]
        branches = [branch_names(k.model, tuple(k.links)) for k in routes]
        samples = [DistanceSamples(find_segments(k.model, b)) for k, b in zip(routes, branches, strict=True)]
        for _ in log_pass.frames():
            for route, table in zip(routes, samples, strict=True):
                table.add(route.points, route.seen)
    scales = {}
    for route, names, table in zip(routes, branches, samples, strict=True):
        factors = table.factors(modes[route.tree])
        if not factors:
            continue
        avatar = world.tree_names[route.tree]
        worst = max(factors.values(), key=lambda f: max(f, 1 / f))
        if not PLAUSIBLE[0] <= worst <= PLAUSIBLE[1]:
            raise LogError(
                f"{log}: the points of topic {route.input.topic!r} are {worst:.3g} times as far apart as the links of "
                f"{avatar!r}: check `unit` in [recording], and `layout` and `links` of its keypoints"
            )
        measured = _at_or_below(route.model.parent, set(map(int, route.model.body)))
        scales[avatar] = BoneScale(
            {_display_name(branch): factor for branch, factor in factors.items()},
            {
                link: factors.get(branch, factors[BASE])
                for link, branch, is_measured in zip(route.links, names, measured, strict=True)
                if is_measured
            },
        )
    return scales


def _at_or_below(parents: NDArray[np.int64], links: set[int]) -> list[bool]:
    """Whether each link is one of `links` or hangs on one: what is above all points keeps its size."""
    found: list[bool] = []
    for link, parent in enumerate(parents):
        found.append(link in links or (parent >= 0 and found[parent]))
    return found


def _display_name(branch: str) -> str:
    """Finger of a branch, ``palm`` of what is in none, else the name of its first link."""
    if branch == BASE:
        return "palm"
    return next((word for word in words(branch) if word in FINGERS), branch)
