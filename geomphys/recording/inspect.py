"""Reads a log and summarises its topics (``geomphys info``); `check.py` relates them to a scene."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from geomphys.errors import LogError
from geomphys.recording.channels import Content, JointSample, Pose, kind_of, make_message_reader
from geomphys.recording.check import CheckReport, check_log
from geomphys.recording.decoders import BadMessageError
from geomphys.recording.display_names import MAX_REMEMBERED, add_names
from geomphys.recording.raw_messages import RawMessage
from geomphys.recording.reader import LogChannel, LogReader, open_log
from geomphys.recording.samples import CONTENT_NAMES
from geomphys.recording.space_guess import Corner, MotionSamples, PoseExtent, SpaceGuess, guess_space
from geomphys.recording.streams import VALUE_LIMIT, validated_pose
from geomphys.storage.remote_files import AnyPath

__all__ = ["CheckReport", "LogInfo", "TopicInfo", "check_log", "inspect_log", "log_space"]

MAX_MOTIONS = 64
"""Child frames of a topic whose motion is summarised."""


@dataclass(frozen=True)
class TopicInfo:
    """Messages of one topic and type, over all parts of a bag. Times are log times."""

    topic: str
    schema: str  # "" without one
    encoding: str
    kind: str  # content of its messages (`samples.ContentType`); "" if not supported
    use: str  # the same in words; "not understood" if not supported
    messages: int
    first_ns: int | None
    last_ns: int | None
    rate_hz: float | None  # None below two messages or without a span
    longest_gap_s: float | None
    joints: tuple[str, ...]  # named in the messages, sorted
    frames: tuple[str, ...]  # child frames, names or indices of its poses, sorted
    sides: tuple[str, ...]  # of gloves
    ranges: dict[str, tuple[float, float]]  # joint -> least and largest good value, as recorded
    boxes: dict[str, tuple[Corner, Corner]]  # child frame ("" without one) -> box of its good positions, m
    motions: dict[
        str, PoseExtent
    ]  # the same frames -> how it moved, as recorded; of the first `MAX_MOTIONS` of a topic
    bad_samples: int  # not finite, or without a unit quaternion
    bad_messages: int  # cannot be decoded
    bad_reason: str  # error of the first of them; "" without any
    problem: str  # why the channel's schema cannot be read; "" if it can


@dataclass(frozen=True)
class LogInfo:
    """A log."""

    path: str
    files: tuple[str, ...]
    size_bytes: int
    profile: str
    messages: int
    first_ns: int | None
    last_ns: int | None
    duration_s: float
    topics: tuple[TopicInfo, ...]  # sorted by topic
    metadata: dict[str, dict[str, str]]
    bytes_lost: int
    damage: str  # "" for a whole log
    notes: tuple[str, ...] = ()  # on the files of a bag

    def as_dict(self) -> dict[str, Any]:
        """All of it as plain values."""
        return dataclasses.asdict(self)


def inspect_log(path: AnyPath | str, *, recover: bool = False) -> LogInfo:
    """Read a whole log and summarise its topics.

    Parameters
    ----------
    path : Path or str
        An MCAP file or a ROS 2 bag directory, or the URL of one; of a log behind a URL only the topics that are understood
        are read, of the others its indexes tell.
    recover : bool
        Tell of a damaged log what is intact, instead of raising DamagedLogError.

    Raises
    ------
    LogError
        Not there, not readable, not an MCAP.
    DamagedLogError
        The log is damaged and `recover` is off.
    """
    with open_log(path, recover=recover) as reader:
        groups: dict[tuple[str, str, str], _TopicScan] = {}
        scans: dict[int, _TopicScan] = {}
        for key, channel in reader.channels.items():
            group = (channel.topic, channel.schema_name, channel.encoding)
            scans[key] = groups.setdefault(group, _TopicScan())
            scans[key].add(channel)
        for raw in reader.read({key for key, read_transform_trees in scans.items() if read_transform_trees.is_needed}):
            scans[raw.key].add_message(raw)
        topics = sorted((s.info() for s in groups.values()), key=lambda t: (t.topic, t.schema))
        return _info(reader, tuple(topics))


def log_space(info: LogInfo, roots: Collection[str] = ()) -> SpaceGuess:
    """Guess the space of a log, by its single poses and by those that `roots` follow (``topic`` or ``topic#child``).

    Poses in other frames than the roots', or than most, do not count.
    """
    used = [(t, c) for t in info.topics for c in t.motions if not c or t.kind == "pose" or f"{t.topic}#{c}" in roots]
    frames = Counter(t.motions[c].frame for t, c in used)
    own = [t.motions[c].frame for t, c in used if t.topic in roots or f"{t.topic}#{c}" in roots]
    frame = own[0] if own else frames.most_common(1)[0][0] if frames else ""
    names = [n for t, c in used for n in (t.topic, t.schema, c)]
    return guess_space(
        [t.motions[c] for t, c in used if t.motions[c].frame == frame],
        [*names, frame],
    )


def _info(reader: LogReader, topics: tuple[TopicInfo, ...]) -> LogInfo:
    has_messages = reader.messages > 0
    damage = reader.damage
    return LogInfo(
        path=str(reader.path),
        files=tuple(str(f) for f in reader.files),
        size_bytes=reader.size,
        profile=reader.profile,
        messages=reader.messages,
        first_ns=reader.start_ns if has_messages else None,
        last_ns=reader.end_ns if has_messages else None,
        duration_s=(reader.end_ns - reader.start_ns) / 1e9,
        topics=topics,
        metadata=dict(reader.metadata),
        bytes_lost=damage.bytes_lost if damage is not None else 0,
        damage=damage.text if damage is not None else "",
        notes=reader.notes,
    )


@dataclass
class _TopicScan:
    """Accumulates the summary of the channels of one topic and type."""

    channels: list[LogChannel] = field(default_factory=list)
    latest: int | None = None
    longest_gap: int = 0
    joints: set[str] = field(default_factory=set)
    frames: set[str] = field(default_factory=set)
    sides: set[str] = field(default_factory=set)
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    boxes: dict[str, tuple[Corner, Corner]] = field(default_factory=dict)
    samples: dict[str, MotionSamples] = field(default_factory=dict)
    bad_samples: int = 0
    bad_messages: int = 0
    bad_reason: str = ""
    problem: str = ""
    readers: dict[int, Callable[[bytes], Content]] = field(default_factory=dict)

    def add(self, channel: LogChannel) -> None:
        """Add a channel, and make its reader."""
        self.channels.append(channel)
        kind = kind_of(channel)
        if kind is not None:
            try:
                self.readers[channel.key] = make_message_reader(channel, kind)
            except LogError as problem:
                self.problem = str(problem)

    @property
    def is_needed(self) -> bool:
        """Whether the messages must be read: their content is supported, or the longest gap is unknown."""
        return bool(self.readers) or any(c.longest_gap_ns is None for c in self.channels)

    def add_message(self, raw: RawMessage) -> None:
        """Add a message."""
        if self.latest is not None:
            self.longest_gap = max(self.longest_gap, raw.log_time - self.latest)
        self.latest = raw.log_time if self.latest is None else max(self.latest, raw.log_time)
        read = self.readers.get(raw.key)
        if read is None:
            return
        try:
            content = read(raw.data)
        except BadMessageError as problem:
            self.bad_messages += 1
            self.bad_reason = self.bad_reason or str(problem)
            return
        if isinstance(content, JointSample):
            add_names(self.joints, content.names)
            if content.side:
                add_names(self.sides, [content.side])
            for name, value in zip(content.names, content.usable_values, strict=False):
                self._add_value(name, value)
        else:
            add_names(self.frames, [p.child for p in content if p.child])
            for pose in content:
                self._add_pose(pose, raw.log_time)

    def _add_value(self, name: str, value: float) -> None:
        if not abs(value) < VALUE_LIMIT:
            self.bad_samples += 1
            return
        least, most = self.ranges.get(name, (value, value))
        if name in self.ranges or len(self.ranges) < MAX_REMEMBERED:
            self.ranges[name] = (min(least, value), max(most, value))

    def _add_pose(self, pose: Pose, time: int) -> None:
        if validated_pose(pose.value) is None:
            self.bad_samples += 1
            return
        x, y, z = pose.value[:3]
        (a, b, c), (d, e, f) = self.boxes.get(pose.child, ((x, y, z), (x, y, z)))
        if pose.child in self.boxes or len(self.boxes) < MAX_REMEMBERED:
            low, high = (min(a, x), min(b, y), min(c, z)), (max(d, x), max(e, y), max(f, z))
            self.boxes[pose.child] = (low, high)
        if pose.child in self.samples or len(self.samples) < MAX_MOTIONS:
            self.samples.setdefault(pose.child, MotionSamples(frame=pose.frame)).add(time, x, y, z)

    def info(self) -> TopicInfo:
        """Make the summary."""
        c, kind = self.channels[0], kind_of(self.channels[0])
        nonempty = sorted(
            (c for c in self.channels if c.messages),
            key=lambda c: c.first_ns,
        )
        messages = sum(c.messages for c in nonempty)
        first, last = (
            min((c.first_ns for c in nonempty), default=0),
            max((c.last_ns for c in nonempty), default=0),
        )
        gap = self.longest_gap
        if not self.is_needed:
            pauses = [after.first_ns - before.last_ns for before, after in pairwise(nonempty)]
            gap = max([0, *pauses, *(c.longest_gap_ns or 0 for c in nonempty)])
        return TopicInfo(
            topic=c.topic,
            schema=c.schema_name,
            encoding=c.encoding,
            kind=kind.content if kind is not None else "",
            use=CONTENT_NAMES[kind.content] if kind is not None else "not understood",
            messages=messages,
            first_ns=first if messages else None,
            last_ns=last if messages else None,
            rate_hz=(messages - 1) / ((last - first) / 1e9) if last > first else None,
            longest_gap_s=gap / 1e9 if messages > 1 else None,
            joints=tuple(sorted(self.joints)),
            frames=tuple(sorted(self.frames)),
            sides=tuple(sorted(self.sides)),
            ranges=dict(sorted(self.ranges.items())),
            boxes=dict(sorted(self.boxes.items())),
            motions={k: m for k, s in sorted(self.samples.items()) if (m := s.motion()) is not None},
            bad_samples=self.bad_samples,
            bad_messages=self.bad_messages,
            bad_reason=self.bad_reason,
            problem=self.problem,
        )
