"""Which stream held the frames of a recording, over which gap, and what to do about it: one line for the user."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from geomphys.recording.display_names import plain
from geomphys.recording.streams import NEVER

if TYPE_CHECKING:
    from geomphys.recording.frames import FrameSource, Run
    from geomphys.recording.routes import JointRoute, RootRoute


class Hold(NamedTuple):
    """A stream that held frames."""

    frames: int
    who: str  # topic, and the joint or root that it feeds
    length: int  # ns, of its longest stretch without a good sample
    start: int  # time at which that begins
    text: str  # what that stretch is: "", or that the stream had not begun, or had ended


def held_warning(source: FrameSource, run: Run) -> str:
    """The line on held frames; "" if there are none."""
    holds = [*_of_roots(source, run), *_of_joints(source, run)]
    if not run.held:
        return ""
    lead = f"{run.held} frames are held: a stream had no good sample near them"
    if not holds:
        return lead
    worst = max(holds, key=lambda h: (h.frames, h.length))
    more = f" (and {len(holds) - 1} more)" if len(holds) > 1 else ""
    gap = source.config.max_gap
    if worst.text:
        why, remedy = worst.text, ""
    elif worst.length > gap * 1e9:
        at = (worst.start - run.first_time) / 1e9
        why = f"its longest gap is {worst.length / 1e9:.3f} s, {at:.3f} s after the first frame"
        remedy = f"; gaps up to {gap:g} s are interpolated, --max-gap SECONDS changes that"
    else:
        why, remedy = "its samples there are not finite or have no unit quaternion", ""
    return f"{lead}: {worst.frames} by {worst.who}{more}: {why}{remedy}"


def _of_roots(source: FrameSource, run: Run) -> Iterator[Hold]:
    for root in run.roots:
        stream = root.stream
        if stream.held_frames:
            longest = stream.longest_gap
            yield Hold(
                stream.held_frames,
                f"topic {_topic(root)}, the root of {plain(source.world.tree_names[root.input.source.tree])}",
                *_stretch(run, stream.begin, stream.last_time, longest.start, longest.length),
            )


def _of_joints(source: FrameSource, run: Run) -> Iterator[Hold]:
    for route in run.joints:
        stream = route.stream
        for k in np.flatnonzero(stream.held_frames) if stream is not None else ():
            assert stream is not None
            yield Hold(
                int(stream.held_frames[k]),
                f"topic {_topic(route)}, the joint {plain(source.world.dof_names[route.columns[k]])}",
                *_stretch(
                    run,
                    int(stream.begin[k]),
                    int(stream.last_time[k]),
                    int(stream.longest_from[k]),
                    int(stream.longest_gap[k]),
                ),
            )


def _topic(route: RootRoute | JointRoute) -> str:
    part = route.input.child if hasattr(route.input, "child") else route.input.side
    return f"{plain(route.input.topic)}#{plain(part)}" if part else plain(route.input.topic)


def _stretch(run: Run, begin: int, end: int, start: int, length: int) -> tuple[int, int, str]:
    """The longest stretch without a good sample: length [ns], beginning, and what to say of it where it is no gap."""
    if begin == NEVER:
        return run.last_time - run.first_time, run.first_time, "it has no good sample before the last frame"
    gap = length if length > run.config.max_gap * 1e9 else 0
    lead, trail = begin - run.first_time, run.last_time - end
    if lead > max(gap, trail):
        return lead, run.first_time, f"it begins {lead / 1e9:.3f} s after the first frame"
    if trail > max(gap, lead):
        return trail, end, f"it ends {trail / 1e9:.3f} s before the last frame"
    return gap, start, ""
