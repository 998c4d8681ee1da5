"""Measures recorded points against the models that are fitted to them, in a first pass over a log: bone lengths, orientations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.keypoints.bone_scale import BASE, DistanceSamples, branch_names, find_segments
from geomphys.keypoints.hidden_lengths import MAX_FRAMES, find_hidden_factors, hidden_links
from geomphys.keypoints.palm_orientation import OrientationSamples
from geomphys.numerics.even_samples import EvenSamples
from geomphys.recording.frames import FrameSource
from geomphys.recording.keypoint_routes import KeypointRoute
from geomphys.recording.log_pass import LogPass
from geomphys.recording.name_words import FINGERS, words
from geomphys.scene.topic_sources import PalmOrientation
from geomphys.scene.world import World
from geomphys.storage.remote_files import AnyPath

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PLAUSIBLE = (0.4, 2.5)
"""Factors outside of this are those of another unit, or of points that are not what the scene says."""


class PointMeasures(NamedTuple):
    """Measurements of the points of an avatar in a recording."""

    branches: dict[str, float]  # finger, limb or "palm" -> factor
    links: dict[str, float]  # link -> factor of its geometry and of the joints on it
    orientation: PalmOrientation | None  # of the wrist or palm, where it agrees with the points


def measure_points(log: AnyPath, world: World, config: Config) -> dict[str, PointMeasures]:
    """Measures of the avatars of a scene that are fitted to points; those of which nothing is found are left out.

    Distances are medians over the recording, of at most `geomphys.keypoints.bone_scale.MAX_SAMPLES` frames.

    Raises LogError as `FrameSource` does, and for factors that no hand has.
    """
    if not world.keypoints:
        return {}
    with FrameSource(log, world, config) as source:
        log_pass = LogPass(source, fits=False)
        passes = [_Pass(route) for route in log_pass.keypoints]
        passes = [p for p in passes if p.is_needed]
        for _ in log_pass.frames() if passes else ():
            for each in passes:
                each.add_frame()
    found = {}
    for each in passes:
        measures = each.measures(f"{log}: ", world.tree_names[each.route.tree])
        if measures.links or measures.orientation is not None:
            found[world.tree_names[each.route.tree]] = measures
    return found


class _Pass:
    """The samples of one avatar."""

    def __init__(self, route: KeypointRoute) -> None:
        self.route, self.scale = route, route.input.source.scale
        self.branches = branch_names(route.model.parent, route.model.column, route.links)
        self.distances = DistanceSamples(find_segments(route.model, self.branches)) if self.scale != "none" else None
        self.hidden = hidden_links(route.model, self.branches) if self.scale == "fingers" else []
        self.samples = EvenSamples[tuple[Floats, Ints]](MAX_FRAMES)
        rotations = OrientationSamples(route.model, route.oriented)
        fits_root = route.model.fits_root and not route.in_hand
        self.rotations = rotations if fits_root and rotations.is_possible else None

    @property
    def is_needed(self) -> bool:
        """Whether there is something to measure."""
        return self.distances is not None or self.rotations is not None

    def add_frame(self) -> None:
        """Add the points of the frame."""
        if self.distances is not None:
            self.distances.add(self.route.points, self.route.seen)
        if self.hidden and self.samples.takes_next() and self.route.seen.any():
            self.samples.append((self.route.points.copy(), self.route.seen.copy()))
        if self.rotations is not None:
            self.rotations.add(self.route.poses, self.route.seen)

    def measures(self, where: str, avatar: str) -> PointMeasures:
        """Measures of all frames. Raises LogError, which begins with `where`."""
        orientation = self.rotations.orientation() if self.rotations is not None else None
        factors = self.distances.factors(self.scale) if self.distances is not None else {}
        if not factors:
            return PointMeasures({}, {}, orientation)
        worst = max(factors.values(), key=lambda f: max(f, 1 / f))
        if not PLAUSIBLE[0] <= worst <= PLAUSIBLE[1]:
            raise LogError(
                f"{where}the points of topic {self.route.input.topic!r} are {worst:.3g} times as far apart as the links of "
                f"{avatar!r}: check `unit` in [recording], and `layout` and `links` of its keypoints"
            )
        measured = _at_or_below(self.route.model.parent, set(map(int, self.route.model.body)))
        names = zip(self.route.links, self.branches, measured, strict=True)
        links = {link: factors.get(branch, factors[BASE]) for link, branch, is_measured in names if is_measured}
        shown = {branch_title(branch): factor for branch, factor in factors.items()}
        if self.scale == "fingers" and self.route.input.source.layout is None and self.distances is not None:
            bones = {self.route.links[k]: f for k, f in self.distances.link_factors(self.route.model).items()}
            links |= bones
            shown |= bones
        if self.hidden and self.samples.items:
            known = {k: links[name] for k, name in enumerate(self.route.links) if name in links}
            known = find_hidden_factors(self.route.model, self.hidden, known, self.samples.items)
            lengths = {self.route.links[k]: factor for k, factor in known.items()}
            links |= lengths
            shown |= lengths
        return PointMeasures(shown, links, orientation)


def _at_or_below(parents: NDArray[np.int64], links: set[int]) -> list[bool]:
    """Whether each link is one of `links` or below one: links above all points keep their size."""
    found: list[bool] = []
    for link, parent in enumerate(parents):
        found.append(link in links or (parent >= 0 and found[parent]))
    return found


def branch_title(branch: str) -> str:
    """Finger of a branch, ``palm`` of what is in none, else the name of its first link."""
    if branch == BASE:
        return "palm"
    return next((word for word in words(branch) if word in FINGERS), branch)
