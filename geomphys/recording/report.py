"""What is told of a recording after its frames were made."""

from __future__ import annotations

import dataclasses
import fnmatch
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from geomphys.recording.frame_plan import FrameUse
from geomphys.recording.held import held_warning
from geomphys.recording.matching import guess_unit
from geomphys.recording.naming import closest, listed, plain
from geomphys.recording.plan import split_topic
from geomphys.recording.routes import JointRoute, RootRoute
from geomphys.world.scene import DRIVEN

if TYPE_CHECKING:
    from geomphys.recording.frames import FrameSource, Run

TOLD = 8  # names told in a warning
FAR = 50.0  # m from the origin from which positions are probably millimetres


@dataclass(frozen=True)
class StreamReport:
    """One stream: a root's pose, or a joint."""

    topic: str  # `topic` or `topic#child`
    name: str  # tree of the pose, or joint
    constant: bool
    held_frames: int
    gaps: int  # longer than `max_gap`
    longest_gap_s: float
    bad_samples: int  # NaN, too large, or a quaternion that is none


@dataclass(frozen=True)
class Unmatched:
    """A name that found no partner on the other side."""

    topic: str
    name: str
    suggestion: str  # "" if nothing is like it


@dataclass(frozen=True)
class OutsideLimits:
    """A joint that was recorded outside of its limits."""

    tree: str
    joint: str
    frames: int
    amount: float  # rad or m, the furthest
    clamped: bool


@dataclass(frozen=True)
class RecordingReport:
    """Figures of a recording, as far as its frames have been made."""

    frames: int
    held_frames: int
    first_ns: int | None
    last_ns: int | None
    out_of_order: int  # messages that came after a later one of their topic, and were put in their place
    late: int  # messages that came after the frames of their time had been made
    lost_frames: int  # of these, messages of the frame clock: no frame came of them
    duplicates: int  # messages of a time that their stream had already; the first counts
    bad_samples: int
    bad_messages: int  # could not be decoded
    streams: tuple[StreamReport, ...]
    unmatched_recorded: tuple[Unmatched, ...]  # recorded joints that no joint of the scene takes
    unmatched_joints: tuple[Unmatched, ...]  # joints of the scene that are not recorded: 0
    ignored_mimics: tuple[str, ...]  # recorded, but follow their master
    outside_limits: tuple[OutsideLimits, ...]
    bytes_lost: int
    recovered: str  # what `recover` could not read; "" for a whole log
    warnings: tuple[str, ...]
    space: str | None = None  # frame id of the recorded space; None where no pose names a frame
    transforms: tuple[FrameUse, ...] = ()  # poses that are given in other frames
    ignored: tuple[str, ...] = ()  # recorded joints that `ignore` leaves out

    def as_dict(self) -> dict[str, Any]:
        """All of it as plain values."""
        return dataclasses.asdict(self)


def report_of(source: FrameSource, run: Run) -> RecordingReport:
    """Sum up a pass over a log as far as it has come."""
    damage = source.reader.damage
    unmatched_recorded, ignored = _unmatched_recorded(source, run.joints)
    streams = tuple(_streams(source, run))
    report = RecordingReport(
        frames=run.count,
        held_frames=run.held,
        first_ns=run.first_time if run.count else None,
        last_ns=run.last_time if run.count else None,
        out_of_order=sum(r.out_of_order for r in run.roots) + sum(r.out_of_order for r in run.joints),
        late=run.late,
        lost_frames=run.lost_frames,
        duplicates=sum(r.stream.duplicates for r in run.roots)
        + sum(r.stream.duplicates for r in run.joints if r.stream is not None),
        bad_samples=sum(s.bad_samples for s in streams),
        bad_messages=run.bad_messages,
        streams=streams,
        unmatched_recorded=unmatched_recorded,
        unmatched_joints=_unmatched_joints(source, run, unmatched_recorded),
        ignored_mimics=ignored,
        outside_limits=tuple(_outside_limits(source, run)),
        bytes_lost=damage.bytes_lost if damage is not None else 0,
        recovered=damage.text if damage is not None else "",
        warnings=(),
        space=next(iter(source.frames.spaces), None),
        transforms=source.frames.uses,
        ignored=tuple(sorted({n for r in run.joints for n in _names(source, r) if r.input.source.ignores(n)})),
    )
    return dataclasses.replace(report, warnings=tuple(_warnings(source, run, report)))


def _streams(source: FrameSource, run: Run) -> Iterator[StreamReport]:
    """Figures of each stream: roots, then joints, in the order of the scene."""
    world = source.world
    for root in run.roots:
        s, i = root.stream, root.input
        topic = f"{i.topic}#{i.child}" if i.child else i.topic
        name = world.tree_names[i.source.tree]
        yield StreamReport(topic, name, s.constant, s.held_frames, s.gaps, s.longest_gap.length / 1e9, s.bad)
    for joints in run.joints:
        topic = joints.input.topic
        for k, column in enumerate(joints.columns):
            assert joints.stream is not None
            j = joints.stream
            figures = (int(j.held_frames[k]), int(j.gaps[k]), float(j.longest_gap[k]) / 1e9, int(j.bad_samples[k]))
            yield StreamReport(topic, world.dof_names[column], False, *figures)
        for column in joints.constants:
            yield StreamReport(topic, world.dof_names[column], True, 0, 0, 0.0, 0)


def _names(source: FrameSource, route: JointRoute) -> set[str]:
    """Names of the joints in a route's topic."""
    return set(source.known.names.get(route.input.topic, ())) | route.names


def _unmatched_recorded(source: FrameSource, routes: list[JointRoute]) -> tuple[tuple[Unmatched, ...], tuple[str, ...]]:
    """Recorded joints that nothing takes, and those that are not used because their joint mimics another."""
    unmatched, ignored = [], set()
    for topic in sorted({r.input.topic for r in routes}):
        here = [r for r in routes if r.input.topic == topic]
        names = set(source.known.names.get(topic, ())).union(*(r.names for r in here))
        free = [n for r in here for n in r.input.source.dofs if n not in names]
        for name in sorted(names):
            if any(r.input.column(name) is not None for r in here) or all(r.input.source.ignores(name) for r in here):
                continue
            if any(r.input.source.rename.get(name, name) in r.input.source.mimics for r in here):
                ignored.add(name)
            else:
                unmatched.append(Unmatched(topic, name, closest(name, free)))
    return tuple(unmatched), tuple(sorted(ignored))


def _unmatched_joints(source: FrameSource, run: Run, recorded: tuple[Unmatched, ...]) -> tuple[Unmatched, ...]:
    """Joints of trees with a joint topic that are not recorded."""
    found = []
    for route in run.joints:
        topic = route.input.topic
        names = [u.name for u in recorded if u.topic == topic]
        for name, column in sorted(route.input.source.dofs.items(), key=lambda item: item[1]):
            if not run.recorded[column] and not route.input.source.covers(name):
                found.append(Unmatched(topic, name, closest(name, names)))
    return tuple(found)


def _outside_limits(source: FrameSource, run: Run) -> Iterator[OutsideLimits]:
    """Joints that left their limits."""
    world, dofs = source.world, source.world.scene.dofs
    for column in np.flatnonzero(run.outside_frames):
        amount = max(run.lower[column] - run.least[column], run.most[column] - run.upper[column])
        tree, name = world.tree_names[dofs.tree[column]], world.dof_names[column]
        frames = int(run.outside_frames[column])
        yield OutsideLimits(tree, name, frames, float(amount), source.config.clamp_limits)


def _warnings(source: FrameSource, run: Run, report: RecordingReport) -> Iterator[str]:
    """One line for everything a user should know of."""
    if report.recovered:
        yield f"the log is damaged: {report.recovered}"
    yield from source.reader.notes
    yield from run.times.warnings()
    yield from source.known.warnings
    if run.watch is not None:
        clock = source.plan.clock
        yield from run.watch.warnings((clock.topic, clock.child) if clock is not None else None)
    yield from _uneven_warnings(source, run)
    held = held_warning(source, run)
    if held:
        yield held
    for topic in source.topics:
        for channel in source.reader.of_topic(topic):
            if channel.messages and channel.key not in source.plan.keys | source.frames.keys:
                what = f"{channel.messages} messages ({plain(channel.schema_name)}, {plain(channel.encoding)})"
                yield f"topic {plain(topic)}: {what} of another kind than the rest are not used"
    for topic, child in sorted(source.known.only.items()):
        others = sum(r.others for key, r in run.routes.items() if source.reader.channels[key].topic == topic)
        if others:
            yield f"topic {plain(topic)}: {others} poses of other frames than {child!r} are not used"
    clock = source.plan.clock
    if clock is not None and source.config.rate is None and sum(c.messages for c in clock.channels) == 1:
        yield f"topic {clock.topic}, the frame clock, has a single message: one frame; see --clock and --rate"
    yield from _unit_warnings(source, run)
    yield from _name_warnings(source, run, report)
    for count, text in (
        (sum(root.unplaced for root in run.roots), "poses have no transform of their frame near enough in time"),
        (report.bad_messages, "messages could not be decoded"),
        (
            report.bad_samples,
            "samples are not finite, marked as not valid or have no unit quaternion; they count as missing",
        ),
        (report.late, f"messages came more than {source.config.max_delay:g} s late, after the frames of their time"),
        (report.lost_frames, "of these were of the frame clock: no frame came of them"),
        (report.out_of_order, f"messages were out of order and were put in their place{_furthest_back(run)}"),
        (
            report.duplicates,
            f"messages repeat a time of their stream; the first of them counts{_most_repeated(source, run)}",
        ),
    ):
        if count:
            yield f"{count} {text}"
    if report.outside_limits:
        worst = max(report.outside_limits, key=lambda o: o.amount)
        what = "were clamped to their limits" if worst.clamped else "are outside of their limits and are kept"
        yield f"{len(report.outside_limits)} joints {what}: {worst.joint} of {worst.tree} by {worst.amount:.3g} at most"


def _furthest_back(run: Run) -> str:
    """Which topic went back furthest in time, and by how much."""
    every: list[RootRoute | JointRoute] = [*run.roots, *run.joints]
    routes = [r for r in every if r.out_of_order]
    worst = max(routes, key=lambda r: r.furthest_back, default=None)
    if worst is None:
        return ""
    return f": up to {worst.furthest_back / 1e9:.3f} s behind, on topic {plain(worst.input.topic)}"


def _most_repeated(source: FrameSource, run: Run) -> str:
    """Which topic repeats its times most, and what to do where that loses much of it."""
    streams = [(r.stream.duplicates, r.input.topic) for r in run.roots]
    streams += [(r.stream.duplicates, r.input.topic) for r in run.joints if r.stream is not None]
    count, topic = max(streams, default=(0, ""))
    total = sum(c.messages for c in source.reader.of_topic(topic))
    if 2 * count <= total or source.config.time == "log":
        return ""
    return f": {count} of the {total} of topic {plain(topic)}; --time log goes by when the log received the messages"


def _uneven_warnings(source: FrameSource, run: Run) -> Iterator[str]:
    """Messages of joints that have not one position a name."""
    for topic in sorted({route.input.topic for route in run.joints}):
        met = max((r.uneven for r in run.joints if r.input.topic == topic), key=lambda u: u.bare + u.fewer + u.more)
        total = sum(c.messages for c in source.reader.of_topic(topic))
        kinds = (
            (met.bare, "have no positions"),
            (met.fewer, "have fewer positions than names"),
        )
        told = " and ".join(f"{count} {what}" for count, what in kinds if count)
        if told:
            yield f"topic {plain(topic)}: of {total} messages {told}; these are no samples of its joints"
        if met.more:
            told = f"{met.more} have more positions than names; those beyond are not used"
            yield f"topic {plain(topic)}: of {total} messages {told}"


def _unit_warnings(source: FrameSource, run: Run) -> Iterator[str]:
    """Positions and angles that look as if they were in another unit."""
    world = source.world
    for pose in source.plan.poses:
        facts = source.known.streams.get((pose.topic, pose.child))
        recorded = facts.value if facts is not None else None
        distance = max(map(abs, source.space.metres(recorded)[:3])) if recorded is not None else 0.0
        if distance > FAR:
            yield (
                f"topic {pose.topic}: begins {distance:.4g} m from the origin; if these are millimetres, say "
                'unit = "mm" under [recording]'
            )
    most = np.maximum(np.abs(run.least), np.abs(run.most))
    for route in run.joints:
        i = route.input
        columns = [c for c in (*route.columns, *route.constants) if not run.prismatic[c]]
        if not columns:
            continue
        if i.degrees:
            largest = math.degrees(max(most[c] for c in columns))
            if i.source.unit == "deg" and 0 < largest <= math.pi:
                yield (
                    f"topic {i.topic}: read as degrees, but no angle is above {largest:.3g}; are these radians? "
                    'then say unit = "rad"'
                )
            continue
        driven = world.scene.trees.role[i.source.tree] == DRIVEN
        limited = [c for c in columns if driven or math.isfinite(run.upper[c])]
        worst = max(limited, key=lambda c: float(most[c]), default=None)
        if worst is not None and most[worst] > 2 * math.pi:
            what = f"{world.dof_names[worst]} reaches {most[worst]:.4g} rad, more than a whole turn"
        else:
            ranges = {world.dof_names[c]: (float(run.least[c]), float(run.most[c])) for c in limited}
            limits = {world.dof_names[c]: (float(run.lower[c]), float(run.upper[c])) for c in limited}
            guess = guess_unit(ranges, limits)
            what = guess.reason if guess.unit == "deg" else ""
        if what:
            yield f'topic {i.topic}: {what}; if these are degrees, say unit = "deg"'


def _name_warnings(source: FrameSource, run: Run, report: RecordingReport) -> Iterator[str]:
    """Names without a partner."""
    for found, text in (
        (report.unmatched_recorded, "recorded joints match no joint of the scene and are not used"),
        (report.unmatched_joints, "joints are not recorded and stay at 0"),
    ):
        if found:
            told = [
                plain(u.name) + (f" (did you mean {plain(u.suggestion)}?)" if u.suggestion else "")
                for u in found[:TOLD]
            ]
            more = f" and {len(found) - TOLD} more" if len(found) > TOLD else ""
            yield f"{len(found)} {text}: {', '.join(told)}{more}"
    if report.ignored_mimics:
        yield f"recorded values of joints that follow another are not used: {listed(report.ignored_mimics, TOLD)}"
    for route in run.joints:
        topic, _ = split_topic(route.input.topic, source.reader.topics)
        names = set(source.known.names.get(topic, ())) | route.names
        absent = sorted(n for n in route.input.source.rename if n not in names)
        if absent:
            yield f"topic {topic}: `rename` speaks of {listed(absent, TOLD)}, which the log does not have"
        joints = [n for n, column in route.input.source.dofs.items() if not run.recorded[column]]
        idle = [p for p in route.input.source.ignore if not any(fnmatch.fnmatchcase(n, p) for n in (*names, *joints))]
        if idle:
            yield f"topic {topic}: `ignore` has {listed(idle, TOLD)}, which no joint is called"
        sides = source.known.sides.get(topic, set())
        if len(sides) > 1 and not route.input.side:
            yield f"topic {topic}: holds gloves of several sides; name one as {topic}#{plain(min(sides))}"
