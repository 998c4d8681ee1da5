"""Prints what a log holds, and whether it can be replayed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from .show_draft import space_lines
from .terminal import counted, fields, heading, printable, size_text

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

    from geomphys.recording.check import CheckReport, SpaceReport
    from geomphys.recording.inspect import LogInfo, TopicInfo
    from geomphys.recording.report import RecordingReport
    from geomphys.scene.findings import Findings

    from .terminal import Terminal

NAMES_SHOWN = 6
"""Names of a list shown without ``-v``."""

NARROW = 90
"""Columns below which topics are listed one below the other instead of in a table."""

FROM_1990 = 631_152_000
"""s; a smaller time is not of a clock that counts from 1970."""


def show_log(terminal: Terminal, log: LogInfo) -> None:
    """Print what a log holds: the file, its topics, and what was found in them."""
    from geomphys.recording.inspect import log_space

    size = size_text(log.size_bytes) + (f" in {len(log.files)} files" if len(log.files) > 1 else "")
    rows = [("Size", [size]), ("Messages", [f"{log.messages:,} in {log.duration_s:,.2f} s"])]
    if log.first_ns is not None:
        rows.append(("Begins", [_clock(log.first_ns)]))
    if log.profile:
        rows.append(("Profile", [log.profile]))
    if log.metadata:
        rows.append(("Metadata", sorted(log.metadata)))
    if log.damage:
        rows.append(("Damage", [log.damage]))
    if log.notes:
        rows.append(("Files", list(log.notes)))
    space = list(space_lines(log_space(log)))
    if space:
        rows.append(("Space", space))
    narrow = terminal.width < NARROW
    terminal.result(heading(Path(log.path).name), fields(rows), "", _list_of(log) if narrow else _topics(log.topics))
    found = [(topic.topic, list(_found(topic, terminal.verbose))) for topic in log.topics]
    details = fields([row for row in found if row[1]])
    if details.row_count:
        terminal.result("", details)


def _list_of(log: LogInfo) -> Text:
    """Return the topics one below the other."""
    from rich.text import Text

    parts = []
    for topic in log.topics:
        figures = [counted(topic.messages, "message")]
        if topic.rate_hz is not None:
            figures.append(f"{topic.rate_hz:,.1f} Hz")
        if topic.longest_gap_s is not None:
            figures.append(f"longest gap {topic.longest_gap_s:.3g} s")
        what = f"{topic.schema or 'no schema'}, {topic.encoding}: {topic.use}"
        style = "" if topic.kind else "dim"
        parts.append(Text(printable(topic.topic), style=f"{style} bold".strip()))
        parts += [Text(f"  {printable(line)}", style=style) for line in (what, ", ".join(figures))]
    return Text("\n").join(parts)


def _topics(topics: Iterable[TopicInfo]) -> Table:
    """Return one row per topic with its content; unsupported topics are dim."""
    from rich.table import Table

    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    for name in ("topic", "type", "encoding", "holds"):
        table.add_column(name, overflow="fold")
    for name in ("messages", "rate", "longest gap"):
        table.add_column(name, justify="right", no_wrap=True)
    for topic in topics:
        rate = "" if topic.rate_hz is None else f"{topic.rate_hz:,.1f} Hz"
        gap = "" if topic.longest_gap_s is None else f"{topic.longest_gap_s:.3g} s"
        table.add_row(
            printable(topic.topic),
            printable(topic.schema or "no schema"),
            printable(topic.encoding),
            topic.use,
            f"{topic.messages:,}",
            rate,
            gap,
            style=None if topic.kind else "dim",
        )
    return table


def _found(topic: TopicInfo, all_names: bool) -> Iterator[str]:
    """Yield what the messages of a topic hold, and what is wrong with them."""
    of = "pose" if topic.kind in ("poses", "named_poses") else "frame"
    for what, names in (("joint", topic.joints), (of, topic.frames), ("side", topic.sides)):
        if names:
            yield f"{counted(len(names), what)}: {_list(names, all_names)}"
    if topic.bad_samples:
        yield f"{counted(topic.bad_samples, 'bad sample')}: not finite, marked as not valid, or no unit quaternion"
    if topic.bad_messages:
        yield f"{counted(topic.bad_messages, 'message')} not decodable; the first {topic.bad_reason}"
    if topic.problem:
        yield topic.problem


def show_check(terminal: Terminal, report: CheckReport) -> None:
    """Print whether a log can be replayed in a scene: mapped inputs, missing inputs, expected problems."""
    rows: list[tuple[str, Sequence[str]]] = []
    if report.clock is not None:
        rows.append(("Clock", [report.clock]))
    rows += [
        ("Pose", [f"{pose.tree} follows {pose.topic} ({counted(pose.messages, 'message')})"]) for pose in report.poses
    ]
    rows += [("Joints", [line]) for line in _joint_lines(report)]
    rows += list(_fit_rows(report, terminal.verbose))
    if report.space is not None:
        rows.append(("Space", [_placed(report.space)]))
    recording = report.recording
    if recording is not None:
        rows += list(_recording_rows(recording, terminal.verbose))
        rows += [("Space", [str(use)]) for use in recording.transforms]
        if recording.ignored:
            ignored = _list(recording.ignored, terminal.verbose)
            rows.append(("Ignored", [f"{counted(len(recording.ignored), 'recorded joint')}: {ignored}"]))
    if report.zero_pose_overlaps:
        pairs = [f"{a} and {b}" for a, b in report.zero_pose_overlaps]
        rows.append(("Left out", ["pairs that overlap in the zero pose", *_some(pairs, terminal.verbose)]))
    rows += list(finding_rows(report.findings, terminal.verbose))
    for label, texts in (("Warning", report.warnings), ("Error", report.errors)):
        rows += [(label, [text.removeprefix(f"{report.log}: ")]) for text in texts]
    title = heading(Path(report.log).name, f" in {Path(report.scene).name}")
    terminal.result(title, fields(rows, colours={"Warning": "yellow", "Error": "bold red"}), _verdict(report))


def _placed(space: SpaceReport) -> str:
    """Return the pose of the recorded space in the world."""
    at, rotation = (", ".join(f"{value:.4g}" for value in values) for values in (space.position, space.orientation))
    return f"recorded with {space.up} up, in {space.unit}; its origin is at [{at}], its axes are turned by [{rotation}]"


def finding_rows(findings: Findings, all_lines: bool) -> Iterator[tuple[str, list[str]]]:
    """Yield notes on a scene other than warnings."""
    if findings.without_collision:
        names = list(findings.without_collision)
        what = f"{counted(len(names), 'link')} with a visual, but no collision geometry"
        yield "Cannot touch", [f"{what}: {_list(names, all_lines)}"]
    if findings.default_pairs:
        pairs = [
            f"{a} and {b}: friction {pair.friction:.3g}, restitution {pair.restitution:.3g}"
            for pair in findings.default_pairs
            for a, b in [pair.materials]
        ]
        yield (
            "Materials",
            ["pairs that no [[material_pair]] names, taken from each with itself", *_some(pairs, all_lines)],
        )
    if findings.notes:
        yield "Frame ids", _some(list(findings.notes), all_lines)


def _fit_rows(report: CheckReport, all_names: bool) -> Iterator[tuple[str, list[str]]]:
    """Yield what joint values are fitted to points: which points, how near they come, the bone lengths."""
    for fit in report.recording.fits if report.recording is not None else ():
        what = f"{counted(len(fit.points), 'link')} of {fit.avatar} follow points of {fit.topic}"
        yield (
            "Points",
            [f"{what}, {1000 * fit.rms_m:.1f} mm from them (rms), {1000 * fit.largest_rms_m:.1f} mm at worst"],
        )
        if fit.oriented_by:
            yield "Orientation", [f"of {fit.oriented_by}: agrees with the points, and counts for the pose of the root"]
        if fit.left_out:
            yield "No link", [f"{counted(len(fit.left_out), 'point')}: {_list(fit.left_out, all_names)}"]
        factors = report.keypoint_scale.get(fit.avatar, {})
        if factors:
            yield "Bone lengths", ["those of the URDF times " + ", ".join(f"{f:.3f} ({n})" for n, f in factors.items())]


def _joint_lines(report: CheckReport) -> Iterator[str]:
    """Yield a line for the joints of each tree that come from one topic."""
    groups: dict[tuple[str, str, str], list[str]] = {}
    for joint in report.joints:
        named = joint.joint if joint.joint == joint.recorded else f"{joint.joint} (recorded as {joint.recorded})"
        groups.setdefault((joint.tree, joint.topic, joint.unit), []).append(named)
    for (tree, topic, unit), names in groups.items():
        yield f"{len(names)} of {tree} from {topic}, {unit}: {_list(names, False)}"


def _recording_rows(recording: RecordingReport, all_names: bool) -> Iterator[tuple[str, list[str]]]:
    """Yield figures of the frames."""
    frames = f"{recording.frames:,}"
    if recording.first_ns is not None and recording.last_ns is not None:
        frames += f" in {(recording.last_ns - recording.first_ns) / 1e9:,.2f} s"
    if recording.held_frames:
        frames += f", {recording.held_frames:,} of them held: a good sample is missing"
    yield "Frames", [frames]
    gaps = [
        f"{stream.name or stream.topic}: {counted(stream.gaps, 'gap')}, the longest {stream.longest_gap_s:.3g} s"
        for stream in recording.streams
        if stream.gaps
    ]
    if gaps:
        yield "Gaps", _some(gaps, all_names)
    outside = [
        f"{joint.tree}: {joint.joint} by up to {joint.amount:.3g} in {counted(joint.frames, 'frame')}"
        + (", clamped" if joint.clamped else "")
        for joint in recording.outside_limits
    ]
    if outside:
        yield "Limits", [f"{counted(len(outside), 'joint')} recorded outside theirs", *_some(outside, all_names)]


def _verdict(report: CheckReport) -> Text:
    """Return the verdict in one line."""
    from rich.text import Text

    if report.errors:
        return Text("It cannot be replayed.", style="bold red")
    if report.warnings:
        return Text("It can be replayed; see the warnings.", style="yellow")
    return Text("It can be replayed.", style="green")


def _some(lines: list[str], all_lines: bool) -> list[str]:
    """Return the first lines, and how many more there are."""
    if all_lines or len(lines) <= NAMES_SHOWN:
        return lines
    return [*lines[:NAMES_SHOWN], f"and {len(lines) - NAMES_SHOWN} more (-v)"]


def _list(names: Iterable[str], all_names: bool) -> str:
    """Return names in a row; the first ones, if they are many."""
    names = list(names)
    if all_names or len(names) <= NAMES_SHOWN:
        return ", ".join(names)
    return f"{', '.join(names[:NAMES_SHOWN])} and {len(names) - NAMES_SHOWN} more (-v)"


def _clock(ns: int) -> str:
    """Return a time as date and time if it counts from 1970, else in seconds."""
    if ns < FROM_1990 * 10**9 or ns > 2**31 * 10**9:
        return f"at {ns / 1e9:,.3f} s of a clock of its own"
    return datetime.fromtimestamp(ns // 10**9, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
