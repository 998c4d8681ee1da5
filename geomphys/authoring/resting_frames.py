"""Averages frames in which a hand rests, so that noise of the tracker counts less: about a touch, and along a stretch.

A hand rests in some frames where neither the trend of its position, rotation and joint values nor their curvature is more than
their noise makes, which is that of the differences of successive frames. Frames that are far from those beside them are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from geomphys.numerics.transforms import quaternion_product
from geomphys.results import Frame

Floats = NDArray[np.float64]

TOUCH_WINDOWS = (0.25, 0.15, 0.08, 0.015)
"""s before and after a touch of which the frames are used: the longest in which the hand rests, the last one in any case."""
MIN_FRAMES = 6
"""Frames that show whether a hand rests."""
MAX_MOTION = 2e-4
"""m; trend or curvature of a hand that rests, beside what noise makes."""
DEVIATIONS = 3.0
"""Standard deviations of a trend that noise may make."""
NEIGHBOURS = 2
"""Frames before and after one, from whose median with it an outlier differs"""
OUTLIER = 4.0
"""by more than so many times what four of five frames do, five standard deviations of noise,"""
FAR = 1e-3
"""m; and this."""
ARM = 0.1
"""m; distance at which rotations and joint values count."""


def rests(frames: Sequence[Frame], tree: int, columns: slice) -> bool:
    """Whether the avatar `tree`, whose joint values are `columns`, rests in some frames."""
    if len(frames) < MIN_FRAMES:
        return False
    values = np.array([_features(frame, frames[0], tree, columns) for frame in frames])
    noise = np.sqrt(np.mean(np.diff(values, axis=0) ** 2, axis=0) / 2)
    parts = np.array([np.mean(part, axis=0) for part in np.array_split(values, 3)])
    limit = DEVIATIONS * noise * np.sqrt(2 / (len(frames) / 3)) + MAX_MOTION
    trend, curvature = np.abs(parts[2] - parts[0]), np.abs(parts[1] - (parts[0] + parts[2]) / 2)
    return bool(np.all(trend < limit) and np.all(curvature < limit))


def without_outliers(frames: Sequence[Frame], tree: int, columns: slice) -> Sequence[Frame]:
    """The frames in which the avatar is where those beside them have it (Hampel's test)."""
    if len(frames) < MIN_FRAMES:
        return frames
    values = np.array([_features(frame, frames[0], tree, columns) for frame in frames])
    padded = np.pad(values, ((NEIGHBOURS, NEIGHBOURS), (0, 0)), mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * NEIGHBOURS + 1, axis=0)
    distance = np.abs(values - np.median(windows, axis=-1))
    is_near = np.all(distance <= OUTLIER * np.percentile(distance, 80, axis=0) + FAR, axis=1)
    return [frame for frame, near in zip(frames, is_near, strict=True) if near]


def mean_frame(frames: Sequence[Frame], tree: int, columns: slice) -> Frame:
    """The middle frame with the mean pose and joint values of an avatar; its rotations differ little."""
    middle = frames[len(frames) // 2]
    roots, angles = middle.roots.copy(), middle.angles.copy()
    poses = np.array([frame.roots[tree] for frame in frames])
    poses[:, 3:] *= np.where(poses[:, 3:] @ roots[tree, 3:] < 0.0, -1.0, 1.0)[:, None]
    roots[tree] = poses.mean(axis=0)
    roots[tree, 3:] /= np.linalg.norm(roots[tree, 3:])
    angles[columns] = np.mean([frame.angles[columns] for frame in frames], axis=0)
    return replace(middle, roots=roots, angles=angles)


def frame_of_touch(frames: Sequence[Frame], time_ns: float, tree: int, columns: slice) -> Frame | None:
    """Mean of the frames about a time in which the avatar rests, else of the nearest; None if none is near."""
    frames = without_outliers(frames, tree, columns) or frames
    for window in TOUCH_WINDOWS:
        near = [frame for frame in frames if abs(frame.time_ns - time_ns) <= window * 1e9]
        if rests(near, tree, columns) or (near and window == TOUCH_WINDOWS[-1]):
            return mean_frame(near, tree, columns)
    return min(frames, key=lambda frame: abs(frame.time_ns - time_ns), default=None)


def means_of_parts(frames: Sequence[Frame], most: int, tree: int, columns: slice) -> list[Frame]:
    """At most `most` frames along a stretch: means of its parts where the avatar rests in one, else their middle frames."""
    frames, found = without_outliers(frames, tree, columns) or frames, []
    for part in np.array_split(np.arange(len(frames)), min(most, max(len(frames) // MIN_FRAMES, 1))):
        own = [frames[k] for k in part]
        found.append(mean_frame(own, tree, columns) if rests(own, tree, columns) else own[len(own) // 2])
    return found


def _features(frame: Frame, first: Frame, tree: int, columns: slice) -> Floats:
    """Position, rotation from that of the first frame, and joint values, m at `ARM`."""
    inverse = first.roots[tree, 3:] * np.array([-1.0, -1.0, -1.0, 1.0])
    rotation = quaternion_product(frame.roots[tree, 3:], inverse)
    rotation = rotation * (1.0 if rotation[3] >= 0.0 else -1.0)
    return np.array([*frame.roots[tree, :3], *(2.0 * ARM * rotation[:3]), *(ARM * frame.angles[columns])])
