"""The warning on held frames: which stream lacked samples, over which gap, and the remedy."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from geomphys.recording.display_names import printable
from geomphys.recording.log_pass import LogPass
from geomphys.recording.prepared_log import PreparedLog
from geomphys.recording.routes import JointRoute, RootRoute
from geomphys.recording.stamps import NEVER


class HeldStream(NamedTuple):
    """A stream that held frames."""

    frames: int
    stream_name: str  # topic, and the joint or root that it feeds
    length: int  # ns, of its longest interval without a good sample
    start: int  # time at which that begins
    text: str  # "" for a gap; else that the stream had not begun or had ended


def held_frames_warning(source: PreparedLog, log_pass: LogPass) -> str:
    """The warning on held frames; "" if there are none."""
    held_streams = [*_held_roots(source, log_pass), *_held_joints(source, log_pass), *_held_fits(source, log_pass)]
    if not log_pass.held_frames:
        return ""
    message = f"{log_pass.held_frames} frames are held: a stream had no good sample near them"
    if not held_streams:
        return message
    worst = max(held_streams, key=lambda h: (h.frames, h.length))
    more = f" (and {len(held_streams) - 1} more)" if len(held_streams) > 1 else ""
    gap = source.config.max_gap
    if worst.text:
        reason, remedy = worst.text, ""
    elif worst.length > gap * 1e9:
        start_s = (worst.start - log_pass.first_time) / 1e9
        reason = f"its longest gap is {worst.length / 1e9:.3f} s, {start_s:.3f} s after the first frame"
        remedy = f"; gaps up to {gap:g} s are interpolated, --max-gap SECONDS changes that"
    else:
        reason, remedy = "its samples there are not finite or have no unit quaternion", ""
    return f"{message}: {worst.frames} by {worst.stream_name}{more}: {reason}{remedy}"


def _held_roots(source: PreparedLog, log_pass: LogPass) -> Iterator[HeldStream]:
    for root in log_pass.roots:
        stream = root.stream
        if stream.held_frames:
            longest = stream.longest_gap
            yield HeldStream(
                stream.held_frames,
                f"topic {_topic(root)}, the root of {printable(source.world.tree_names[root.input.source.tree])}",
                *_longest_hold(log_pass, stream.first_sample_time, stream.last_time, longest.start, longest.length),
            )


def _held_joints(source: PreparedLog, log_pass: LogPass) -> Iterator[HeldStream]:
    for route in log_pass.joints:
        stream = route.stream
        for k in np.flatnonzero(stream.held_frames) if stream is not None else ():
            assert stream is not None
            yield HeldStream(
                int(stream.held_frames[k]),
                f"topic {_topic(route)}, the joint {printable(source.world.dof_names[route.columns[k]])}",
                *_longest_hold(
                    log_pass,
                    int(stream.first_sample_time[k]),
                    int(stream.last_time[k]),
                    int(stream.longest_gap_start[k]),
                    int(stream.longest_gap[k]),
                ),
            )


def _held_fits(source: PreparedLog, log_pass: LogPass) -> Iterator[HeldStream]:
    for route in log_pass.keypoints:
        if route.held_frames:
            longest = max((r.stream.longest_gap for r in route.routes), key=lambda gap: gap.length)
            name = (
                f"topic {printable(route.input.topic)}, the points of {printable(source.world.tree_names[route.tree])}"
            )
            gap = f"the fit lacks points; the longest gap of one is {longest.length / 1e9:.3f} s"
            yield HeldStream(route.held_frames, name, longest.length, longest.start, gap)


def _topic(route: RootRoute | JointRoute) -> str:
    part = route.input.child if hasattr(route.input, "child") else route.input.side
    return f"{printable(route.input.topic)}#{printable(part)}" if part else printable(route.input.topic)


def _longest_hold(log_pass: LogPass, first_sample_time: int, end: int, start: int, length: int) -> tuple[int, int, str]:
    """The longest interval without a good sample: length [ns], start [ns], and a description where it is not a gap."""
    if first_sample_time == NEVER:
        return (
            log_pass.last_time - log_pass.first_time,
            log_pass.first_time,
            "it has no good sample before the last frame",
        )
    gap = length if length > log_pass.config.max_gap * 1e9 else 0
    message, trail = first_sample_time - log_pass.first_time, log_pass.last_time - end
    if message > max(gap, trail):
        return message, log_pass.first_time, f"it begins {message / 1e9:.3f} s after the first frame"
    if trail > max(gap, message):
        return trail, end, f"it ends {trail / 1e9:.3f} s before the last frame"
    return gap, start, ""
