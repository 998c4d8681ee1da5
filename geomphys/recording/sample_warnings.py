"""Warnings about samples: times, order, and joint messages with unequal numbers of names and positions."""

from __future__ import annotations

from collections.abc import Iterator

from geomphys.recording.diagnostics import Diagnostic
from geomphys.recording.display_names import printable
from geomphys.recording.log_pass import LogPass
from geomphys.recording.prepared_log import PreparedLog
from geomphys.recording.routes import JointRoute, RootRoute


def time_warnings(source: PreparedLog, log_pass: LogPass) -> Iterator[Diagnostic]:
    """Stamps that were replaced, clocks that lie apart, times that jump or drift."""
    clock = source.plan.clock
    texts = [*log_pass.times.warnings(), *source.prescan.warnings]
    if log_pass.stamp_monitor is not None:
        texts += log_pass.stamp_monitor.warnings((clock.topic, clock.child) if clock is not None else None)
    yield from (Diagnostic(text, "times") for text in texts)


def largest_disorder(log_pass: LogPass) -> str:
    """The topic with the largest step back in time; ends a sentence, "" if there is none."""
    all_routes: list[RootRoute | JointRoute] = [*log_pass.poses, *log_pass.joints]
    worst = max((r for r in all_routes if r.out_of_order), key=lambda r: r.max_disorder, default=None)
    if worst is None:
        return ""
    return f": up to {worst.max_disorder / 1e9:.3f} s behind, on topic {printable(worst.input.topic)}"


def most_repeated(source: PreparedLog, log_pass: LogPass) -> str:
    """The topic with the most duplicate times and the remedy, where most of its messages are lost; ends a sentence, or ""."""
    streams = [(r.stream.duplicates, r.input.topic) for r in log_pass.poses]
    streams += [(r.stream.duplicates, r.input.topic) for r in log_pass.joints if r.stream is not None]
    count, topic = max(streams, default=(0, ""))
    total = sum(c.messages for c in source.reader.of_topic(topic))
    if 2 * count <= total or source.config.time == "log":
        return ""
    return (
        f": {count} of the {total} of topic {printable(topic)}; --time log goes by when the log received the messages"
    )


def length_mismatch_warnings(source: PreparedLog, log_pass: LogPass) -> Iterator[Diagnostic]:
    """Joint messages with unequal numbers of positions and names."""
    for topic in sorted({route.input.topic for route in log_pass.joints}):
        counts = max(
            (r.length_mismatches for r in log_pass.joints if r.input.topic == topic),
            key=lambda u: u.empty + u.shorter + u.longer,
        )
        total = sum(c.messages for c in source.reader.of_topic(topic))
        kinds = ((counts.empty, "have no positions"), (counts.shorter, "have fewer positions than names"))
        missing = " and ".join(f"{count} {what}" for count, what in kinds if count)
        if missing:
            text = f"topic {printable(topic)}: of {total} messages {missing}; these are no samples of its joints"
            yield Diagnostic(text, "uneven_joints")
        if counts.longer:
            extra = f"{counts.longer} have more positions than names; those beyond are not used"
            yield Diagnostic(f"topic {printable(topic)}: of {total} messages {extra}", "uneven_joints")
