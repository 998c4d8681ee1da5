"""The report on a recording after its frames were made: counts, streams, unmatched names, warnings."""

from __future__ import annotations

import dataclasses
import fnmatch
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from geomphys.recording.channels import kind_of
from geomphys.recording.diagnostics import Diagnostic, DiagnosticKey
from geomphys.recording.display_names import closest_name, join_names, printable
from geomphys.recording.fit_report import FitReport, fit_report
from geomphys.recording.held_frames import held_frames_warning
from geomphys.recording.input_plan import split_topic
from geomphys.recording.log_pass import LogPass
from geomphys.recording.prepared_log import PreparedLog
from geomphys.recording.routes import JointRoute
from geomphys.recording.sample_warnings import largest_disorder, length_mismatch_warnings, most_repeated, time_warnings
from geomphys.recording.transform_plan import TransformUse
from geomphys.recording.unit_warnings import angle_warnings, space_warnings

MAX_NAMES = 8  # names listed in a warning


@dataclass(frozen=True)
class StreamReport:
    """One stream: a root's pose, or a joint."""

    topic: str  # `topic` or `topic#child`
    name: str  # tree of the pose, or joint
    constant: bool
    held_frames: int
    gaps: int  # longer than `max_gap`
    longest_gap_s: float
    bad_samples: int  # NaN, too large, or a without unit quaternion
    is_point: bool = False  # a point that joint values are fitted to; its `held_frames` hold no frame by themselves


@dataclass(frozen=True)
class UnmatchedName:
    """A name without a match on the other side."""

    topic: str
    name: str
    suggestion: str  # "" if no name is similar


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
    """Statistics of a recording, up to the last frame made."""

    frames: int
    held_frames: int
    first_ns: int | None
    last_ns: int | None
    out_of_order: int  # messages after a later one of their topic; sorted into their stream
    late: int  # messages that came after the frames of their time had been made
    lost_frames: int  # of these, messages of the frame clock: no frame came of them
    duplicates: int  # messages of a time that their stream had already; the first counts
    bad_samples: int
    bad_messages: int  # could not be decoded
    streams: tuple[StreamReport, ...]
    unmatched_recorded: tuple[UnmatchedName, ...]  # recorded joints without a joint of the scene
    unmatched_joints: tuple[UnmatchedName, ...]  # joints of the scene that are not recorded: 0
    ignored_mimics: tuple[str, ...]  # recorded, but follow their master
    outside_limits: tuple[OutsideLimits, ...]
    bytes_lost: int
    recovered: str  # what `recover` could not read; "" for a whole log
    warnings: tuple[str, ...]
    space: str | None = None  # frame id of the recorded space; None where no pose names a frame
    transforms: tuple[TransformUse, ...] = ()  # poses that are given in other frames
    ignored: tuple[str, ...] = ()  # recorded joints that `ignore` leaves out
    fits: tuple[FitReport, ...] = ()  # of avatars whose joint values are fitted to points

    def as_dict(self) -> dict[str, Any]:
        """All of it as plain values."""
        return dataclasses.asdict(self)


def make_report(source: PreparedLog, log_pass: LogPass) -> RecordingReport:
    """Make the report of a pass over a log, up to the last frame made."""
    damage = source.reader.damage
    unmatched_recorded, ignored = _unmatched_recorded(source, log_pass.joints)
    streams = tuple(_streams(source, log_pass))
    report = RecordingReport(
        frames=log_pass.count,
        held_frames=log_pass.held_frames,
        first_ns=log_pass.first_time if log_pass.count else None,
        last_ns=log_pass.last_time if log_pass.count else None,
        out_of_order=sum(r.out_of_order for r in log_pass.poses) + sum(r.out_of_order for r in log_pass.joints),
        late=log_pass.late,
        lost_frames=log_pass.lost_frames,
        duplicates=sum(r.stream.duplicates for r in log_pass.poses)
        + sum(r.stream.duplicates for r in log_pass.joints if r.stream is not None),
        bad_samples=sum(s.bad_samples for s in streams if not s.is_point),
        bad_messages=log_pass.bad_messages,
        streams=streams,
        unmatched_recorded=unmatched_recorded,
        unmatched_joints=_unmatched_joints(source, log_pass, unmatched_recorded),
        ignored_mimics=ignored,
        outside_limits=tuple(_outside_limits(source, log_pass)),
        bytes_lost=damage.bytes_lost if damage is not None else 0,
        recovered=damage.text if damage is not None else "",
        warnings=(),
        space=next(iter(source.transforms.spaces), None),
        transforms=source.transforms.uses,
        fits=tuple(fit_report(source.world, route) for route in log_pass.keypoints),
        ignored=tuple(sorted({n for r in log_pass.joints for n in _names(source, r) if r.input.source.ignores(n)})),
    )
    return dataclasses.replace(report, warnings=tuple(_warnings(source, log_pass, report)))


def _streams(source: PreparedLog, log_pass: LogPass) -> Iterator[StreamReport]:
    """Figures of each stream: roots, then joints, in the order of the scene."""
    world = source.world
    for root in log_pass.poses:
        s, i = root.stream, root.input
        topic = f"{i.topic}#{i.child}" if i.child else i.topic
        name = world.tree_names[i.source.tree]
        yield StreamReport(
            topic, name, s.constant, s.held_frames, s.gaps, s.longest_gap.length / 1e9, s.bad, i.is_point
        )
    for joints in log_pass.joints:
        topic = joints.input.topic
        for k, column in enumerate(joints.columns):
            assert joints.stream is not None
            j = joints.stream
            figures = (int(j.held_frames[k]), int(j.gaps[k]), float(j.longest_gap[k]) / 1e9, int(j.bad_samples[k]))
            yield StreamReport(topic, world.dof_names[column], False, *figures)
        for column in joints.constants:
            yield StreamReport(topic, world.dof_names[column], True, 0, 0, 0.0, 0)


def _names(source: PreparedLog, route: JointRoute) -> set[str]:
    """Names of the joints in a route's topic."""
    return set(source.prescan.names.get(route.input.topic, ())) | route.names


def _unmatched_recorded(
    source: PreparedLog, routes: list[JointRoute]
) -> tuple[tuple[UnmatchedName, ...], tuple[str, ...]]:
    """Recorded joints without a match, and those whose joint mimics another."""
    unmatched, ignored = [], set()
    for topic in sorted({r.input.topic for r in routes}):
        topic_routes = [r for r in routes if r.input.topic == topic]
        names = set(source.prescan.names.get(topic, ())).union(*(r.names for r in topic_routes))
        unused = [n for r in topic_routes for n in r.input.source.dofs if n not in names]
        for name in sorted(names):
            if any(r.input.column(name) is not None for r in topic_routes) or all(
                r.input.source.ignores(name) for r in topic_routes
            ):
                continue
            if any(r.input.source.rename.get(name, name) in r.input.source.mimics for r in topic_routes):
                ignored.add(name)
            else:
                unmatched.append(UnmatchedName(topic, name, closest_name(name, unused)))
    return tuple(unmatched), tuple(sorted(ignored))


def _unmatched_joints(
    source: PreparedLog, log_pass: LogPass, recorded: tuple[UnmatchedName, ...]
) -> tuple[UnmatchedName, ...]:
    """Joints of trees with a joint topic that are not recorded."""
    found = []
    for route in log_pass.joints:
        topic = route.input.topic
        names = [u.name for u in recorded if u.topic == topic]
        for name, column in sorted(route.input.source.dofs.items(), key=lambda item: item[1]):
            if not log_pass.recorded[column] and not route.input.source.covers(name):
                found.append(UnmatchedName(topic, name, closest_name(name, names)))
    return tuple(found)


def _outside_limits(source: PreparedLog, log_pass: LogPass) -> Iterator[OutsideLimits]:
    """Joints that left their limits."""
    world, dofs = source.world, source.world.scene.dofs
    for column in np.flatnonzero(log_pass.outside_frames):
        amount = max(
            log_pass.lower[column] - log_pass.min_angles[column], log_pass.max_angles[column] - log_pass.upper[column]
        )
        tree, name = world.tree_names[dofs.tree[column]], world.dof_names[column]
        frames = int(log_pass.outside_frames[column])
        yield OutsideLimits(tree, name, frames, float(amount), source.config.clamp_limits)


def _warnings(source: PreparedLog, log_pass: LogPass, report: RecordingReport) -> Iterator[str]:
    """All warnings, one line each."""
    if report.recovered:
        yield Diagnostic(f"the log is damaged: {report.recovered}", "damaged")
    yield from (Diagnostic(text, "files") for text in source.reader.notes)
    yield from time_warnings(source, log_pass)
    yield from length_mismatch_warnings(source, log_pass)
    yield from (Diagnostic(text, "fit") for report_of_fit in report.fits for text in report_of_fit.warnings())
    held_frames = held_frames_warning(source, log_pass)
    if held_frames:
        yield Diagnostic(held_frames, "held")
    used = source.plan.keys | source.transforms.keys
    for topic in source.topics:
        for channel in source.reader.of_topic(topic):
            if channel.messages and channel.key not in used:
                what = f"{channel.messages} messages ({printable(channel.schema_name)}, {printable(channel.encoding)})"
                yield Diagnostic(
                    f"topic {printable(topic)}: {what} of another kind than the rest are not used", "mixed_kinds"
                )
    for topic, child in sorted(source.prescan.implied_children.items()):
        unused_poses = sum(
            r.unused_poses for key, r in log_pass.routes.items() if source.reader.channels[key].topic == topic
        )
        if unused_poses:
            text = f"topic {printable(topic)}: {unused_poses} poses of other frames than {child!r} are not used"
            yield Diagnostic(text, "other_frames")
    clock = source.plan.clock
    if clock is not None and source.config.rate is None and sum(c.messages for c in clock.channels) == 1:
        text = f"topic {clock.topic}, the frame clock, has a single message: one frame; see --clock and --rate"
        yield Diagnostic(text, "single_message_clock")
    yield from space_warnings(source, log_pass)
    yield from angle_warnings(source, log_pass)
    yield from _name_warnings(source, log_pass, report)
    counts: tuple[tuple[int, DiagnosticKey, str], ...] = (
        (
            sum(root.untransformed for root in log_pass.poses),
            "unplaced",
            "poses have no transform of their frame near enough in time",
        ),
        (report.bad_messages, "bad_messages", "messages could not be decoded"),
        (
            report.bad_samples,
            "bad_samples",
            "samples are not finite, marked as not valid or have no unit quaternion; they count as missing",
        ),
        (
            report.late,
            "late",
            f"messages came more than {source.config.max_delay:g} s late, after the frames of their time",
        ),
        (report.lost_frames, "lost_frames", "of these were of the frame clock: no frame came of them"),
        (
            report.out_of_order,
            "out_of_order",
            f"messages were out of order and were put in their place{largest_disorder(log_pass)}",
        ),
        (
            report.duplicates,
            "duplicates",
            f"messages repeat a time of their stream; the first of them counts{most_repeated(source, log_pass)}",
        ),
    )
    yield from (Diagnostic(f"{count} {text}", key) for count, key, text in counts if count)
    if report.outside_limits:
        worst = max(report.outside_limits, key=lambda o: o.amount)
        what = "were clamped to their limits" if worst.clamped else "are outside of their limits and are kept"
        text = (
            f"{len(report.outside_limits)} joints {what}: {worst.joint} of {worst.tree} by {worst.amount:.3g} at most"
        )
        yield Diagnostic(text, "outside_limits")


def _name_warnings(source: PreparedLog, log_pass: LogPass, report: RecordingReport) -> Iterator[str]:
    """Warnings on unmatched names."""
    groups: tuple[tuple[tuple[UnmatchedName, ...], DiagnosticKey, str], ...] = (
        (
            report.unmatched_recorded,
            "unmatched_recorded",
            "recorded joints match no joint of the scene and are not used",
        ),
        (report.unmatched_joints, "unmatched_joints", "joints are not recorded and stay at 0"),
    )
    for found, key, text in groups:
        if found:
            names_text = [
                printable(u.name) + (f" (did you mean {printable(u.suggestion)}?)" if u.suggestion else "")
                for u in found[:MAX_NAMES]
            ]
            more = f" and {len(found) - MAX_NAMES} more" if len(found) > MAX_NAMES else ""
            yield Diagnostic(f"{len(found)} {text}: {', '.join(names_text)}{more}", key)
    if report.ignored_mimics:
        text = f"recorded values of joints that follow another are not used: {join_names(report.ignored_mimics, MAX_NAMES)}"
        yield Diagnostic(text, "recorded_mimics")
    yield from _unfed_avatars(source)
    for route in log_pass.joints:
        topic, _ = split_topic(route.input.topic, source.reader.topics)
        names = set(source.prescan.names.get(topic, ())) | route.names
        absent = sorted(n for n in route.input.source.rename if n not in names)
        if absent:
            text = f"topic {topic}: `rename` speaks of {join_names(absent, MAX_NAMES)}, which the log does not have"
            yield Diagnostic(text, "unknown_rename")
        joints = [n for n, column in route.input.source.dofs.items() if not log_pass.recorded[column]]
        unmatched_patterns = [
            p for p in route.input.source.ignore if not any(fnmatch.fnmatchcase(n, p) for n in (*names, *joints))
        ]
        if unmatched_patterns:
            text = f"topic {topic}: `ignore` has {join_names(unmatched_patterns, MAX_NAMES)}, which no joint is called"
            yield Diagnostic(text, "unknown_ignore")
        sides = source.prescan.sides.get(topic, set())
        if len(sides) > 1 and not route.input.side:
            text = f"topic {topic}: holds gloves of several sides; name one as {topic}#{printable(min(sides))}"
            yield Diagnostic(text, "several_gloves")


def _unfed_avatars(source: PreparedLog) -> Iterator[str]:
    """Avatars without a joint topic though the log has unused joint values."""
    world, plan = source.world, source.plan
    used = {i.topic for i in plan.joints} | {k.topic for k in plan.keypoints}
    fed = {i.source.tree for i in plan.joints} | {k.source.tree for k in plan.keypoints}
    unused = sorted(
        {
            c.topic
            for c in source.reader.channels.values()
            if c.messages
            and c.topic not in used
            and (kind := kind_of(c)) is not None
            and kind.content in ("joints", "glove")
        }
    )
    for tree in range(world.avatar_count if unused else 0):
        joints = int((world.scene.dofs.tree == tree).sum())
        if joints and tree not in fed:
            text = f"the {joints} joints of {world.tree_names[tree]} stand still at 0, nothing feeds them; the log has "
            yield Diagnostic(f"{text}joint values on {join_names(unused, MAX_NAMES)}", "joints_without_topic")
