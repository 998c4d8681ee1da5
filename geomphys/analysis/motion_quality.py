"""Measures of the quality of a corrected motion over a whole sequence: spikes, jerk, share of deep frames; plain arrays in.

A link is seen through some of its points, so that a rotation about its origin counts too. Without points of its own these
are its origin and one point at `DEFAULT_REACH_M` along each of its axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.numerics.motion_rates import third_derivatives
from geomphys.numerics.quantiles import Quantiles
from geomphys.numerics.transforms import rotation_from_quaternion

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

DEFAULT_REACH_M = 0.02
SPIKE_M = 3e-3
"""m; an offset that steps by more than this in a frame is a spike, if also by more than `SPIKE_RATIO` times the motion."""
SPIKE_RATIO = 3.0
DEEP_M = 2e-3
"""m; a frame recorded deeper than this is a deep one."""
ACTIVE_M = 1e-6
"""m; a link that is off by more than this is being corrected."""


@dataclass(frozen=True, kw_only=True)
class MotionFigures:
    """Measures of a sequence, in SI units; None where there is nothing to measure."""

    frames: int
    spikes: int
    """Frames, counted once for each tree, in which the offset of a link steps by more than 3 mm and three times the
    largest recorded motion of the tree's links in that frame."""
    spike_max_m: float
    """The largest such step; 0 without one."""
    spike_row: int | None
    """Row (number of the frame in the sequence, from 0) of it."""
    jerk_rms_ratio: float | None
    """Root mean square of the jerk of the links' points, corrected over recorded, in frames in which some link is corrected."""
    jerk_p99_ratio: float | None
    """The same of the 99th percentile, over those frames, of the largest jerk."""
    joint_jerk_rms_ratio: float | None
    """The same of the joint angles."""
    joint_jerk_p99_ratio: float | None
    deep_share: float | None
    """Share of the frames recorded deeper than 2 mm, 0 to 1."""


class _Rows(NamedTuple):
    """Frames in a row."""

    times: Ints  # (n,) ns
    recorded: Floats  # (n, L, k, 3) m, points of the links
    corrected: Floats
    recorded_angles: Floats  # (n, Q) rad
    corrected_angles: Floats

    def after(self, history: _Rows) -> _Rows:
        """These rows after those of `history`."""
        joined: list[Any] = [np.concatenate(pair) for pair in zip(history, self, strict=True)]
        return _Rows(*joined)

    def last(self, count: int) -> _Rows:
        """The last `count` of them."""
        rows: list[Any] = [values[-count:] for values in self]
        return _Rows(*rows)


class _JerkRatio:
    """Jerk of corrected values over that of recorded ones: of the mean square, and of the largest of each frame."""

    def __init__(self) -> None:
        self._squares = [0.0, 0.0]
        self._largest = (Quantiles(), Quantiles())

    def add(self, recorded: Floats, corrected: Floats) -> None:
        """Take jerks (n, k, d) of k points, or of k joints with d = 1."""
        for side, values in enumerate((recorded, corrected)):
            squares = np.einsum("nkd,nkd->nk", values, values)
            self._squares[side] += float(squares.sum())
            for value in np.sqrt(squares.max(axis=1, initial=0.0)).tolist():
                self._largest[side].add(value)

    def of_mean_square(self) -> float | None:
        """Ratio of the root mean squares; None if the recorded one is 0."""
        return float(np.sqrt(self._squares[1] / self._squares[0])) if self._squares[0] > 0.0 else None

    def of_p99(self) -> float | None:
        """Ratio of the 99th percentiles; None if the recorded one is 0."""
        recorded, corrected = (series.quantile(0.99) for series in self._largest)
        return corrected / recorded if recorded > 0.0 else None


class MotionQuality:
    """Accumulates the measures over frames, given in order, in pieces of any length; memory does not grow with them.

    Parameters
    ----------
    trees
        (L,) the tree (avatar or object) that each link belongs to.
    points
        (L, k, 3) m, points of each link in its frame; None: its origin and a point on each axis.
    """

    def __init__(self, trees: Ints, points: Floats | None = None) -> None:
        self._trees = np.asarray(trees, np.int64)
        if points is None:
            points = np.tile(DEFAULT_REACH_M * np.eye(4, 3, k=-1), (len(self._trees), 1, 1))
        self._points = np.asarray(points, np.float64)
        self._jerk, self._joint_jerk = _JerkRatio(), _JerkRatio()
        self._frames = self._spikes = self._deep = self._depths = 0
        self._spike_m, self._spike_row = 0.0, -1
        self._history: _Rows | None = None

    def add(
        self,
        times: Ints,
        recorded: Floats,
        corrected: Floats,
        *,
        depths: Floats | None = None,
        recorded_angles: Floats | None = None,
        corrected_angles: Floats | None = None,
    ) -> None:
        """Take n more frames.

        Parameters
        ----------
        times
            (n,) ns.
        recorded, corrected
            (n, L, 7) world poses of the links.
        depths
            (n,) m, deepest recorded overlap of each frame.
        recorded_angles, corrected_angles
            (n, Q) rad, continuous in time (no jumps of 2 pi).
        """
        none = np.zeros((len(times), 0))
        angles = (none if a is None else np.asarray(a, np.float64) for a in (recorded_angles, corrected_angles))
        rows = _Rows(np.asarray(times, np.int64), self._points_at(recorded), self._points_at(corrected), *angles)
        first = 0 if self._history is None else len(self._history.times)
        rows = rows if self._history is None else rows.after(self._history)
        self._count_spikes(rows, first)
        self._add_jerks(rows)
        if depths is not None:
            self._depths += len(depths)
            self._deep += int(np.count_nonzero(np.asarray(depths) > DEEP_M))
        self._frames += len(times)
        self._history = rows.last(3)

    def figures(self) -> MotionFigures:
        """The measures of the frames so far."""
        return MotionFigures(
            frames=self._frames,
            spikes=self._spikes,
            spike_max_m=self._spike_m,
            spike_row=self._spike_row if self._spikes else None,
            jerk_rms_ratio=self._jerk.of_mean_square(),
            jerk_p99_ratio=self._jerk.of_p99(),
            joint_jerk_rms_ratio=self._joint_jerk.of_mean_square(),
            joint_jerk_p99_ratio=self._joint_jerk.of_p99(),
            deep_share=self._deep / self._depths if self._depths else None,
        )

    def _points_at(self, poses: Floats) -> Floats:
        """World positions (n, L, k, 3) of the points of links at poses (n, L, 7)."""
        poses = np.asarray(poses, np.float64)
        rotations = rotation_from_quaternion(poses[..., 3:])
        points: Floats = np.einsum("nlij,lkj->nlki", rotations, self._points) + poses[:, :, None, :3]
        return points

    def _count_spikes(self, rows: _Rows, first: int) -> None:
        """Count those of the rows from `first` on."""
        begin = max(first - 1, 0)
        motion = _largest_step(rows.recorded[begin:])
        steps = _largest_step((rows.corrected - rows.recorded)[begin:])
        for tree in range(self._trees.max(initial=-1) + 1):
            of_tree = self._trees == tree
            step, usual = (values[:, of_tree].max(axis=1, initial=0.0) for values in (steps, motion))
            spikes = np.flatnonzero((step > SPIKE_M) & (step > SPIKE_RATIO * usual))
            self._spikes += len(spikes)
            if len(spikes) and step[spikes].max() > self._spike_m:
                row = int(spikes[step[spikes].argmax()])
                self._spike_m, self._spike_row = float(step[row]), self._frames - first + begin + row + 1

    def _add_jerks(self, rows: _Rows) -> None:
        """Take the jerk at the end of each four rows in which a link is corrected; three of the first four are old ones."""
        count = len(rows.times)
        if count < 4:
            return
        offsets = np.linalg.norm(rows.corrected - rows.recorded, axis=-1)
        off = offsets.reshape(count, -1).max(axis=1, initial=0.0) > ACTIVE_M
        active = off[3:] | off[2:-1] | off[1:-2] | off[:-3]
        if not active.any():
            return
        flat = (count, offsets.shape[1] * offsets.shape[2], 3)
        before, gap_free = third_derivatives(rows.times, rows.recorded.reshape(flat))
        after, _ = third_derivatives(rows.times, rows.corrected.reshape(flat))
        chosen = active & gap_free
        self._jerk.add(before[chosen], after[chosen])
        if rows.recorded_angles.shape[1]:
            angles = (rows.recorded_angles, rows.corrected_angles)
            before, after = (third_derivatives(rows.times, a[:, :, None])[0] for a in angles)
            self._joint_jerk.add(before[chosen], after[chosen])


def _largest_step(points: Floats) -> Floats:
    """(n - 1, L) largest distance that a point of a link goes from one row of (n, L, k, 3) to the next."""
    steps: Floats = np.linalg.norm(np.diff(points, axis=0), axis=-1).max(axis=2, initial=0.0)
    return steps
