"""Checks that the time stamps of all topics are of the same clock as those of the frame clock."""

from __future__ import annotations

from collections.abc import Iterable

from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.recording.display_names import printable
from geomphys.recording.input_plan import ClockInput, JointInput, Plan, PoseInput, is_static
from geomphys.recording.reader import LogReader
from geomphys.recording.stream_prescan import Prescan, StampOffset

MAX_CLOCK_OFFSET = 3600 * 10**9
"""ns; topics whose stamp offsets (stamp - log time) differ by more than this are of different clocks."""
WARNED_CLOCK_OFFSET = 10**9
"""ns; a difference of stamp offsets beyond this gives a warning."""


def check_clock_agreement(reader: LogReader, plan: Plan, prescan: Prescan, config: Config) -> None:
    """Raise LogError if a topic's stamps are of another clock than the frame clock's; warn where they may be.

        They are if both the stamps and the stamp offsets (stamp - log time) differ by more than `MAX_CLOCK_OFFSET`, or if by
    its stamps, but not by its log times, the topic ends before the first frame or begins after the last.
    """
    if plan.clock is None:
        return
    delays = {pose.topic: round(pose.source.delay * 1e9) for pose in plan.poses}
    delays |= {joints.topic: round(joints.source.delay * 1e9) for joints in plan.joints}
    shifted = {
        (topic, part): [
            StampOffset(m.time + delays.get(topic, 0), m.offset + delays.get(topic, 0)) for m in stamp_offsets
        ]
        for (topic, part), stamp_offsets in prescan.stamp_offsets.items()
    }
    clock = shifted.get((plan.clock.topic, plan.clock.child)) or shifted.get((plan.clock.topic, ""))
    if not clock:
        return
    spans = _log_spans(reader, [*plan.poses, *plan.joints, plan.clock])
    reported = {plan.clock.topic} if plan.clock.child == "" else set()
    for (topic, part), stamp_offsets in sorted(shifted.items()):
        if is_static(topic) or topic in reported or not stamp_offsets or stamp_offsets is clock:
            continue
        pairs = [(a, b) for a in stamp_offsets for b in clock]
        distance = min(min(abs(a.time - b.time), abs(a.offset - b.offset)) for a, b in pairs)
        if distance > MAX_CLOCK_OFFSET:
            raise LogError(
                f"{reader.path}: the times of topic {topic!r} and of the frame clock {plan.clock.topic!r} are of "
                f"different clocks, {distance / 1e9:.0f} s apart; --time log goes by when the log received the messages"
            )
        offset, clock_offset = max(m.offset for m in stamp_offsets), max(m.offset for m in clock)
        if abs(offset - clock_offset) <= WARNED_CLOCK_OFFSET or (
            distance <= WARNED_CLOCK_OFFSET and not (_is_logged_live(stamp_offsets) and _is_logged_live(clock))
        ):
            continue
        reported.add(topic)
        name = f"{topic}#{part}" if part else topic
        side = "before" if offset < clock_offset else "after"
        what = f"the time stamps of topic {printable(name)!r} lie {abs(offset - clock_offset) / 1e9:.3f} s {side} those of "
        what += f"the frame clock {printable(plan.clock.topic)!r} by when the log received them"
        first, last = spans[topic]
        begin, end = spans[plan.clock.topic]
        gap = max((begin + clock_offset) - (last + offset), (first + offset) - (end + clock_offset))
        if gap > config.max_gap * 1e9 and last > first and end > begin and min(end, last) > max(begin, first):
            raise LogError(
                f"{reader.path}: {what}: all of them come {gap / 1e9:.3f} s {side} its "
                f"{'first' if offset < clock_offset else 'last'} frame, so every frame would be held; "
                "--time log goes by when the log received the messages"
            )
        prescan.warnings.append(
            f"{what}: are their clocks apart? --time log goes by when the log received the messages"
        )


def _is_logged_live(stamp_offsets: list[StampOffset]) -> bool:
    """Whether messages were logged as they came: the log times go about as fast as the stamps."""
    times = [m.time for m in stamp_offsets]
    logged = [m.time - m.offset for m in stamp_offsets]
    span, log_span = max(times) - min(times), max(logged) - min(logged)
    return 0 < span <= 4 * log_span <= 16 * span


def _log_spans(reader: LogReader, inputs: Iterable[PoseInput | JointInput | ClockInput]) -> dict[str, tuple[int, int]]:
    """Topic -> log times of its first and its last message."""
    spans = {}
    for source in inputs:
        channels = [c for c in source.channels if c.messages]
        if channels:
            spans[source.topic] = (min(c.first_ns for c in channels), max(c.last_ns for c in channels))
    return spans


def log_times_agree(prescan: Prescan, delay: int) -> bool:
    """Whether the log times put the topics in the order of their messages' times, to within `delay` [ns].

    They do not where a writer left the log times of a topic unset.
    """
    offsets = [
        [m.offset for m in stamp_offsets]
        for (topic, _), stamp_offsets in prescan.stamp_offsets.items()
        if stamp_offsets and not is_static(topic)
    ]
    return not offsets or max(min(o) for o in offsets) - min(max(o) for o in offsets) <= delay
