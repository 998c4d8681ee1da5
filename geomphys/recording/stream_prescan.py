"""Reads the beginning of a log for what must be known before the first frame: first values, constant streams, unset stamps.

The log is read from its beginning until all of it is known, usually within a second or two. Only a name that never occurs,
or occurs once, needs the whole log; messages without it are then not decoded.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from geomphys.config import Config
from geomphys.recording.channels import Content, JointSample, kind_of, make_message_reader
from geomphys.recording.decoders import BadMessageError
from geomphys.recording.display_names import add_names
from geomphys.recording.fixed_layout import FixedLayoutReader, JointShape
from geomphys.recording.input_plan import Plan
from geomphys.recording.message_layouts import PoseLayout
from geomphys.recording.message_times import EARLY_CLOCK, MessageTimes
from geomphys.recording.point_reader import make_point_reader
from geomphys.recording.pose_tuples import PoseTuple
from geomphys.recording.raw_messages import Messages, RawMessage
from geomphys.recording.reader import LogChannel, LogReader
from geomphys.recording.reading_ahead import batches
from geomphys.recording.streams import VALUE_LIMIT, validated_pose

OFFSET_MESSAGES = 8  # messages of a channel whose stamp offsets are recorded
MAX_FRAME_IDS = 64  # frame ids recorded per stream
MAX_ZERO_STAMPS = 1024  # messages with a stamp of zero after which a channel counts as not stamped
MAX_ZERO_STAMP_BYTES = 16 * 2**20  # or bytes of such messages
ZERO_STAMP_TOLERANCE = 25 * 10**7
"""ns; tolerance between log times and stamps of a clock that begins at zero."""


@dataclass
class StreamInfo:
    """First samples of one stream: a child frame, a joint, or the single pose of a topic."""

    first_time: int = 0  # of the earliest good sample
    value: PoseTuple | None = None  # the earliest good sample
    time: int | None = None  # of the first sample, good or bad
    varies: bool = False  # whether it has samples of more than one time
    frame: str = ""  # frame id of the earliest good sample

    def add(self, time: int, value: PoseTuple | None, frame: str = "") -> None:
        """Add a sample; None is a bad one."""
        if self.time is None:
            self.time = time
        elif time != self.time:
            self.varies = True
        if value is not None and (self.value is None or time < self.first_time):
            self.first_time, self.value, self.frame = time, value, frame


class StampOffset(NamedTuple):
    """Time of a message, and its offset from the log time; ns."""

    time: int
    offset: int


@dataclass
class Prescan:
    """The result of the prescan. Streams are keyed by topic and name: child frame, joint as recorded, or ""."""

    streams: dict[tuple[str, str], StreamInfo] = field(default_factory=dict)
    names: dict[str, set[str]] = field(default_factory=dict)  # topic -> joint and frame names
    frame_ids: dict[tuple[str, str], dict[str, None]] = field(
        default_factory=dict
    )  # stream -> frame ids it is given in
    readers: dict[int, Callable[[bytes], Content]] = field(default_factory=dict)
    sides: dict[str, set[str]] = field(default_factory=dict)  # topic -> sides of gloves
    stamp_offsets: dict[tuple[str, str], list[StampOffset]] = field(
        default_factory=dict
    )  # topic, child -> of its first messages
    implied_children: dict[str, str] = field(
        default_factory=dict
    )  # topic followed without a child frame -> the first it names
    unreadable: dict[str, str] = field(default_factory=dict)  # topic -> error of its first bad message
    warnings: list[str] = field(default_factory=list)


@dataclass
class _ChannelProbe:
    """The state of the prescan of one channel."""

    channel: LogChannel
    awaited: dict[str, bytes]  # names -> bytes to search for in a message
    zero_stamps_resolved: bool  # whether the meaning of a zero stamp is known
    is_child_implied: bool = False  # whether it is followed without naming the child frame
    timed_children: frozenset[str] = frozenset()  # children whose stamp offsets are recorded
    messages_read: int = 0
    bytes: int = 0  # of the pending messages
    latest: int = -(2**62)
    complete_from: int | None = None  # the latest first time of what is awaited, once all of it is known
    names: Sequence[str] | None = None  # joints of the message that was recorded last
    frames: Sequence[tuple[str, str]] | None = None  # its poses: child and frame id
    pending: list[tuple[RawMessage, Content]] = field(default_factory=list)  # until `zero_stamps_resolved`


def prescan_streams(reader: LogReader, plan: Plan, config: Config, times: MessageTimes) -> Prescan:
    """Read the log's beginning; fills `times.zero_stamp_times` and `times.offsets` as well.

    Raises LogError if a schema cannot be read, if a pose has no good sample, or if the topics' clocks are not the same.
    """
    prescan = Prescan()
    probes = _probes(plan, prescan, zero_stamps_resolved=config.time != "header")
    keys = set(probes)
    delay = round(config.max_delay * 1e9)
    for batch in batches(reader.read_runs(keys), keys):
        if config.time == "header" and _repeats(batch, probes, prescan, times):
            keys -= {key for key in keys if _is_channel_complete(probes[key], prescan, delay)}
            if not keys:
                break
            continue
        for raw in batch:
            if raw.key not in keys:
                continue
            probe = probes[raw.key]
            probe.messages_read += 1
            last = probe.messages_read == probe.channel.messages
            if last or _is_informative(probe, prescan, raw):
                for message, content in _decode_resolved(probe, prescan, times, raw, last):
                    _record(probe, prescan, times, message, content)
            if last or (probe.zero_stamps_resolved and _is_channel_complete(probe, prescan, delay)):
                keys.discard(raw.key)
                if not keys:
                    return prescan
    return prescan


def _repeats(batch: Messages, probes: dict[int, _ChannelProbe], prescan: Prescan, times: MessageTimes) -> bool:
    """Whether messages that go by their stamps repeat what is known, later; then they are added to their probes."""
    latest: dict[int, int] = {}
    of_channel = batch.by_channel()
    for key, positions in of_channel.items():
        messages = [batch.data[p] for p in positions.tolist()]
        probe, read = probes[key], prescan.readers[key]
        if probe.complete_from is None or not isinstance(read, FixedLayoutReader) or key in times.zero_stamps:
            return False
        columns = read.columns(messages) if probe.messages_read + len(messages) < probe.channel.messages else None
        if columns is None or columns.stamps.min() < max(probe.complete_from, 1):
            return False
        shape = columns.shape
        if not (shape.names is probe.names if isinstance(shape, JointShape) else [shape[:2]] == probe.frames):
            return False
        latest[key] = int(columns.stamps.max())
    for key, time in latest.items():
        probes[key].messages_read += len(of_channel[key])
        probes[key].latest = max(probes[key].latest, time)
    return True


def _probes(plan: Plan, prescan: Prescan, *, zero_stamps_resolved: bool) -> dict[int, _ChannelProbe]:
    """One probe per input channel; makes the channels' readers."""
    awaited: dict[int, set[str]] = {}
    channels: dict[int, LogChannel] = {}
    for pose in plan.poses:
        for c in pose.channels:
            channels[c.key] = c
            awaited.setdefault(c.key, set()).add(pose.child)
    for joints in plan.joints:
        for c in joints.channels:
            channels[c.key] = c
            awaited.setdefault(c.key, set()).update(_joint_keys(joints.recorded_names(), joints.side))
    for c in plan.clock.channels if plan.clock is not None else ():
        channels[c.key] = c
        awaited.setdefault(c.key, set())
    clock_keys = {c.key for c in plan.clock.channels} if plan.clock is not None else set()
    implied_keys = {c.key for pose in plan.poses if pose.is_only_child for c in pose.channels}
    point_keys = {c.key for keypoints in plan.keypoints for c in keypoints.channels}
    followed: dict[int, set[str]] = {}  # children that are no points
    for pose in plan.poses:
        for c in () if pose.is_point else pose.channels:
            followed.setdefault(c.key, set()).add(pose.child)
    probes = {}
    for key, c in channels.items():
        kind = kind_of(c)
        if kind is None:
            continue
        of_points = key in point_keys
        prescan.readers[key] = (
            make_point_reader(c, whole=followed.get(key, set())) if of_points else make_message_reader(c, kind)
        )
        layout = kind.points if of_points and kind.points is not None else kind.layout
        has_literal_names = not isinstance(layout, PoseLayout) or layout.has_literal_names
        names = {n: n.rsplit("\0", 1)[-1].encode() if has_literal_names else b"" for n in sorted(awaited[key])}
        timed_children = set(awaited[key])
        if plan.clock is not None and key in clock_keys:
            timed_children.add(plan.clock.child)
        probes[key] = _ChannelProbe(
            c, names, zero_stamps_resolved or not kind.has_stamp, key in implied_keys, frozenset(timed_children)
        )
    return probes


def _joint_keys(names: dict[str, int], side: str) -> list[str]:
    """Names of joint streams; each side of a glove has its own."""
    return [joint_key(n, side) for n in names]


def joint_key(name: str, side: str) -> str:
    """Key of a joint in `Prescan.streams`, for one side ("" for any)."""
    return f"{side}\0{name}" if side else name


def _is_informative(probe: _ChannelProbe, prescan: Prescan, raw: RawMessage) -> bool:
    """Whether a message may hold anything new; only then it is decoded."""
    if probe.messages_read <= OFFSET_MESSAGES or not probe.zero_stamps_resolved:
        return True
    if probe.complete_from is not None:
        return True
    topic = probe.channel.topic
    incomplete = [n for n in probe.awaited if not _is_complete(prescan.streams.get((topic, n)))]
    if not incomplete:
        return True  # all known; earlier samples may still arrive late
    ascii_only = probe.channel.encoding != "json" or all(n.isascii() for n in incomplete)
    return not ascii_only or any(probe.awaited[n] in raw.data for n in incomplete)


def _is_complete(facts: StreamInfo | None) -> bool:
    return facts is not None and facts.varies and facts.value is not None


def _is_channel_complete(probe: _ChannelProbe, prescan: Prescan, delay: int) -> bool:
    """Whether everything about a channel is known."""
    if probe.messages_read < 2:
        return False
    if not probe.awaited:
        return True
    if probe.complete_from is None:
        first_times = []
        for name in probe.awaited:
            facts = prescan.streams.get((probe.channel.topic, name))
            if facts is None or not _is_complete(facts):
                return False
            first_times.append(facts.first_time)
        probe.complete_from = max(first_times)
    return probe.latest >= probe.complete_from + delay


def _decode_resolved(
    probe: _ChannelProbe, prescan: Prescan, times: MessageTimes, raw: RawMessage, last: bool
) -> list[tuple[RawMessage, Content]]:
    """Decode a message; returns it with the pending ones once the meaning of a zero stamp on the channel is known.

    A stamp of zero is a time if it is that of a single message which comes as long before the next one as the stamps say.
    """
    try:
        probe.pending.append((raw, prescan.readers[raw.key](raw.data)))
        probe.bytes += len(raw.data)
    except BadMessageError as problem:
        prescan.unreadable.setdefault(probe.channel.topic, str(problem))
        if not last:
            return []
    if not probe.zero_stamps_resolved and probe.pending:
        message, content = probe.pending[-1]
        stamps = [content.stamp] if isinstance(content, JointSample) else [p.stamp for p in content]
        other = next((s for s in stamps if s), None)
        if other is not None:
            times.offsets[raw.key] = other - message.log_time
            unset_times = {m.log_time for m, _ in probe.pending[:-1]}
            begin = next(iter(unset_times), None)
            distance = other - (message.log_time - begin) if begin is not None else other
            if len(unset_times) < 2 and distance < (ZERO_STAMP_TOLERANCE if begin is not None else EARLY_CLOCK):
                times.zero_stamp_times[raw.key] = begin
        is_full = len(probe.pending) >= MAX_ZERO_STAMPS or probe.bytes >= MAX_ZERO_STAMP_BYTES
        probe.zero_stamps_resolved = other is not None or last or is_full or stamps[:1] == [None]
    resolved = probe.pending if probe.zero_stamps_resolved else []
    if resolved:
        probe.pending = []
    return resolved


def _record(probe: _ChannelProbe, prescan: Prescan, times: MessageTimes, raw: RawMessage, content: Content) -> None:
    """Record the content of a message."""
    key, topic = raw.key, probe.channel.topic
    names = prescan.names.setdefault(topic, set())
    items: list[tuple[int, str, PoseTuple | None, str]] = []
    if isinstance(content, JointSample):
        time = times.time_of(key, content.stamp, raw.log_time, raw.publish_time)
        if probe.complete_from is not None and time >= probe.complete_from and content.names is probe.names:
            probe.latest = max(probe.latest, time)  # it says nothing new
            return
        has_offsets = len(prescan.stamp_offsets.get((topic, ""), ())) >= OFFSET_MESSAGES
        probe.names = content.names if has_offsets and not content.side else None
        add_names(names, content.names)
        if content.side:
            add_names(prescan.sides.setdefault(topic, set()), [content.side])
        for name, value in zip(content.names, content.usable_values, strict=False):
            good: PoseTuple | None = (value,) if abs(value) < VALUE_LIMIT else None
            items.append((time, name, good, ""))
            if content.side:
                items.append((time, joint_key(name, content.side), good, ""))
        stamp_offsets = {"": [time]}
    else:
        stamp_offsets = {}
        pose_times = [times.time_of(key, pose.stamp, raw.log_time, raw.publish_time) for pose in content]
        frames = [(pose.child, pose.frame) for pose in content]
        if probe.complete_from is not None and frames == probe.frames and min(pose_times) >= probe.complete_from:
            probe.latest = max(probe.latest, *pose_times)  # it says nothing new
            return
        probe.frames = frames or None
        for pose, time in zip(content, pose_times, strict=True):
            add_names(names, [pose.child])
            sample = validated_pose(pose.value)
            items.append((time, pose.child, sample, pose.frame))
            followed = {pose.child}
            if (
                pose.child
                and probe.is_child_implied
                and prescan.implied_children.setdefault(topic, pose.child) == pose.child
            ):
                items.append((time, "", sample, pose.frame))
                followed.add("")
            for child in followed & probe.awaited.keys():
                frame_ids = prescan.frame_ids.setdefault((topic, child), {})
                if len(frame_ids) < MAX_FRAME_IDS:
                    frame_ids[pose.frame] = None
            stamp_offsets.setdefault(pose.child if pose.child in probe.timed_children else "", []).append(time)
    for time, name, taken, frame in items:
        if name in probe.awaited:
            prescan.streams.setdefault((topic, name), StreamInfo()).add(time, taken, frame)
    recorded_times = [t for at in stamp_offsets.values() for t in at]
    probe.latest = max([probe.latest, *recorded_times])
    if probe.complete_from is not None and min(recorded_times, default=probe.complete_from) < probe.complete_from:
        probe.complete_from = None  # a first time may be an earlier one now
    for part, at in stamp_offsets.items():
        if isinstance(content, JointSample) or part in probe.timed_children:
            noted = prescan.stamp_offsets.setdefault((topic, part), [])
            if len(noted) < OFFSET_MESSAGES and probe.channel.messages > 1:
                noted.extend(StampOffset(t, t - raw.log_time) for t in at)
                probe.frames = None  # there may be more to note
