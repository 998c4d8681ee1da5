"""Warnings about the samples of a recording: their times, their order, and joint messages without a value for each name."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from geomphys.recording.diagnostics import Diagnostic
from geomphys.recording.display_names import plain
from geomphys.recording.routes import JointRoute, RootRoute

if TYPE_CHECKING:
    from geomphys.recording.frames import FrameSource, Run


def time_warnings(source: FrameSource, run: Run) -> Iterator[Diagnostic]:
    """Stamps that were replaced, clocks that lie apart, times that jump or drift."""
    clock = source.plan.clock
    texts = [*run.times.warnings(), *source.known.warnings]
    if run.watch is not None:
        texts += run.watch.warnings((clock.topic, clock.child) if clock is not None else None)
    yield from (Diagnostic(text, "times") for text in texts)


def furthest_back(run: Run) -> str:
    """Which topic went back furthest in time, and by how much: the end of a sentence; "" if none did."""
    every: list[RootRoute | JointRoute] = [*run.roots, *run.joints]
    worst = max((r for r in every if r.out_of_order), key=lambda r: r.furthest_back, default=None)
    if worst is None:
        return ""
    return f": up to {worst.furthest_back / 1e9:.3f} s behind, on topic {plain(worst.input.topic)}"


def most_repeated(source: FrameSource, run: Run) -> str:
    """Which topic repeats its times most, and what to do where that loses much of it: the end of a sentence, or ""."""
    streams = [(r.stream.duplicates, r.input.topic) for r in run.roots]
    streams += [(r.stream.duplicates, r.input.topic) for r in run.joints if r.stream is not None]
    count, topic = max(streams, default=(0, ""))
    total = sum(c.messages for c in source.reader.of_topic(topic))
    if 2 * count <= total or source.config.time == "log":
        return ""
    return f": {count} of the {total} of topic {plain(topic)}; --time log goes by when the log received the messages"


def uneven_warnings(source: FrameSource, run: Run) -> Iterator[Diagnostic]:
    """Joint messages whose positions are not as many as their names."""
    for topic in sorted({route.input.topic for route in run.joints}):
        counts = max((r.uneven for r in run.joints if r.input.topic == topic), key=lambda u: u.bare + u.fewer + u.more)
        total = sum(c.messages for c in source.reader.of_topic(topic))
        kinds = ((counts.bare, "have no positions"), (counts.fewer, "have fewer positions than names"))
        missing = " and ".join(f"{count} {what}" for count, what in kinds if count)
        if missing:
            text = f"topic {plain(topic)}: of {total} messages {missing}; these are no samples of its joints"
            yield Diagnostic(text, "uneven_joints")
        if counts.more:
            extra = f"{counts.more} have more positions than names; those beyond are not used"
            yield Diagnostic(f"topic {plain(topic)}: of {total} messages {extra}", "uneven_joints")
