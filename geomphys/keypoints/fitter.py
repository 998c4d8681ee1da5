"""Fits the points of a recording frame by frame: first posture, warm starts, held frames, undetermined joints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.jit.packed_records import pack
from geomphys.keypoints.fit import fit_frame, fit_next, measure_uncertainty, pose_links
from geomphys.keypoints.fit_model import FitModel
from geomphys.keypoints.setup import ROOT_POINTS, make_state, nearest_rotation, rigid_points, spans_plane
from geomphys.numerics.transforms import quaternion_from_rotation, rotation_from_quaternion

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FIRST_ITERATIONS = 200
ITERATIONS = 30
PROBED_FRAMES = 16
"""Uncertainty is measured every so many frames."""
BEYOND = 0.05
"""rad or m; a frame counts where the points would take a joint at its limit at least this far beyond it."""
NOT_SHOWN = 0.5
"""Posterior share of the variance of the rest term from which a joint counts as undetermined."""


MAX_PATTERNS = 4096
"""Patterns of seen points that are cached."""


class FittedPosture(NamedTuple):
    """The posture of a frame."""

    root: Floats  # (7,) world pose
    angles: Floats  # (Q,)
    held: bool  # the points are too few: all or part of the posture is that of the last frame


class _Pattern(NamedTuple):
    """What a set of seen points determines."""

    any_seen: bool
    all_shown: bool  # every joint
    shown: Ints  # (Q,) 1 for joints that a seen point determines, or none ever does
    shows_root: bool  # by points alone
    has_palm: bool  # a point of the palm, which determines the root together with an orientation


class KeypointFitter:
    """Joint values of one tree, and the pose of its root where the model has it unknown, over the frames of a recording."""

    def __init__(self, model: FitModel) -> None:
        self.model, self.state = model, make_state(model)
        self._model, self._state = pack(model), pack(self.state)
        self.started = False
        self._palm = _rigid_group(model)
        self._patterns: dict[bytes, _Pattern] = {}  # by which points are seen
        self.is_shown = model.shown_by.any(axis=1)  # (Q,) by any of the points
        self.frames = self.probed = 0
        self.unshown = np.zeros(
            len(model.rest), dtype=np.int64
        )  # (Q,) probed frames in which the points do not determine it
        self.limited = np.zeros(len(model.rest), dtype=np.int64)  # (Q,) probed frames with points beyond its limits
        self.squares = 0.0  # m², sum of mean square distances
        self.largest = 0.0  # m, largest root mean square distance of a frame

    def fit(
        self, points: Floats, seen: Ints, root: Floats, orientation: Floats | None = None, lever: float = 0.0
    ) -> FittedPosture:
        """Fit the points of the next frame.

        Parameters
        ----------
        points
            (K, 3) m, world frame.
        seen
            (K,) 1 for those that count.
        root
            (7,) world pose of the root; used where the model does not have it unknown.
        orientation, lever
            (4,) orientation of the root as the source has it, and the lever [m] of its weight
            (`geomphys.keypoints.palm_orientation.PalmOrientation`); None without one.
        """
        state, model = self.state, self.model
        state.weights["orientation"] = 0.0
        if orientation is not None and model.fits_root:
            state.orientation[:], state.weights["orientation"] = orientation, lever * lever
        pattern = self._pattern(seen)
        shown = pattern.shown
        if not model.fits_root:
            state.root[:] = root
        shows_root = pattern.shows_root or (state.weights["orientation"] > 0.0 and pattern.has_palm)
        if not pattern.any_seen or (model.fits_root and not shows_root):
            state.increment[:] = 0.0
            pose_links(self._model, state.root, state.angles, state.poses)
            return FittedPosture(state.root.copy(), state.angles.copy(), True)
        if self.started:
            distance = fit_next(self._model, self._state, points, seen, shown, ITERATIONS)
        else:
            distance = self._start(points, seen, shown)
        self._count(points, seen, distance)
        return FittedPosture(state.root.copy(), state.angles.copy(), not pattern.all_shown)

    def _start(self, points: Floats, seen: Ints, shown: Ints) -> float:
        """First posture: the best from several starts, each with the rigid motion that brings its points nearest.

        Returns the root mean square distance of the points [m].
        """
        state, model = self.state, self.model
        low = np.where(np.isfinite(model.lower), model.lower, model.rest)
        high = np.where(np.isfinite(model.upper), model.upper, model.rest)
        state.weights["smoothness"] = 0.0
        given, best = state.root.copy(), None
        for fraction in (0.0, 0.25, 0.5):
            state.angles[:] = np.clip(model.rest + fraction * ((low + high) / 2 - model.rest), model.lower, model.upper)
            state.root[:] = given
            if model.fits_root:
                state.root[:] = self._nearest_root(points, seen)
            for _ in range(2):  # what the points show is not known before
                distance = fit_frame(self._model, self._state, points, seen, shown, FIRST_ITERATIONS)
            if best is None or distance < best[0]:
                best = (distance, state.root.copy(), state.angles.copy())
        assert best is not None
        distance, state.root[:], state.angles[:] = best
        state.increment[:] = 0.0
        self.started = True
        pose_links(self._model, state.root, state.angles, state.poses)
        return distance

    def _pattern(self, seen: Ints) -> _Pattern:
        """What is determined where these points are seen.

        The pose of the root is where enough points that are rigid with each other are seen, not in a line; in models with too few
        of these, where half of all points are seen.
        """
        key = seen.tobytes()
        if key not in self._patterns:
            if len(self._patterns) >= MAX_PATTERNS:
                self._patterns.clear()
            shown = ((self.model.shown_by @ seen > 0) | ~self.is_shown).astype(np.int64)
            has_group = _spans(self.model, self._palm)
            group = self._palm & (seen != 0) if has_group else seen != 0
            enough = ROOT_POINTS if has_group else max(ROOT_POINTS, len(seen) // 2)
            shows_root = bool(group.sum() >= enough and _spans(self.model, group))
            has_palm = bool((self._palm & (seen != 0)).any())
            self._patterns[key] = _Pattern(bool(seen.any()), bool(shown.all()), shown, shows_root, has_palm)
        return self._patterns[key]

    def _nearest_root(self, points: Floats, seen: Ints) -> Floats:
        """Pose of the root (7,) that brings the points of the current angles nearest to those seen (Kabsch 1976)."""
        pose = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        pose_links(self._model, pose, self.state.angles, self.state.poses)
        use = seen != 0
        own, other = self.state.poses[self.model.body[use], :3], points[use]
        rotation = rotation_from_quaternion(self.state.orientation)
        if self.state.weights["orientation"] == 0.0:
            rotation, _ = nearest_rotation(own, other)
        pose[:3] = other.mean(axis=0) - rotation @ own.mean(axis=0)
        pose[3:] = quaternion_from_rotation(rotation)
        return pose

    def _count(self, points: Floats, seen: Ints, distance: float) -> None:
        """Add the frame to the statistics of the fit."""
        self.squares, self.largest = self.squares + distance * distance, max(self.largest, distance)
        if self.frames % PROBED_FRAMES == 0:
            variance_ratio = np.ones(len(self.model.rest))
            measure_uncertainty(self._model, self._state, points, seen, variance_ratio)
            is_unshown = variance_ratio > NOT_SHOWN
            self.unshown += is_unshown
            self.limited += self._is_pressed_on_limits() & ~is_unshown
            self.probed += 1
        self.frames += 1

    def _is_pressed_on_limits(self) -> NDArray[np.bool_]:
        """(Q,) whether a joint is at a limit and its step without limits leads beyond, after `measure_uncertainty`."""
        model, state = self.model, self.state
        step = state.step[: len(model.rest)]
        below, above = state.angles <= model.lower, state.angles >= model.upper
        pressed: NDArray[np.bool_] = (below & (step < -BEYOND)) | (above & (step > BEYOND))
        return pressed


def _rigid_group(model: FitModel) -> NDArray[np.bool_]:
    """(K,) the largest group of points that no joint moves against each other, found from each point in turn."""
    rigid, best = rigid_points(model), np.zeros(len(model.body), dtype=bool)
    for first in range(len(model.body)):
        group = [first]
        for other in np.flatnonzero(rigid[first]):
            if other != first and all(rigid[other, member] for member in group):
                group.append(int(other))
        if len(group) > best.sum():
            best = np.isin(np.arange(len(best)), group)
    return best


def _spans(model: FitModel, group: NDArray[np.bool_]) -> bool:
    """Whether points are not in a line, in the posture at rest."""
    poses = np.zeros((len(model.parent), 7))
    pose_links(model, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), model.rest, poses)
    return spans_plane(poses[model.body[group], :3])
