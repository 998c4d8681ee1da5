"""What must be known of a log's streams before its first frame: first values, constant streams, unset stamps.

The log is read from its beginning until all of it is known, which is a second or two of it as a rule. Only a name that
never comes, or comes once, takes the whole log; messages in which it does not occur are then not decoded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.recording.channels import Content, Joints, kind_of, make_reader
from geomphys.recording.decoders import BadMessageError
from geomphys.recording.display_names import add_names, listed, plain, similar
from geomphys.recording.input_plan import ClockInput, JointInput, Plan, PoseInput, is_static
from geomphys.recording.message_layouts import PoseLayout
from geomphys.recording.message_times import EARLY_CLOCK, MessageTimes
from geomphys.recording.name_words import side_of
from geomphys.recording.reader import LogChannel, LogReader, RawMessage
from geomphys.recording.streams import VALUE_LIMIT, Seven, good_pose

OFFSETS = 8  # messages of a channel whose stamps are compared with their log times
FRAME_IDS = 64  # frame ids of a stream that are noted
ZEROS = 1024  # messages with a stamp of zero after which a channel counts as not stamped
ZERO_BYTES = 16 * 2**20  # or bytes of such messages
CLOCKS_APART = 3600 * 10**9
"""ns; topics whose stamps differ by more than this from what their log times say are of different clocks."""
SOON = 25 * 10**7
"""ns by which the log times may differ from the stamps where a clock begins at zero."""
APART = 10**9
"""ns; topics whose stamps differ by more than this from what their log times say are warned of."""


@dataclass
class Facts:
    """Of one stream: a frame of transforms, a joint, or the one pose of a topic."""

    first_time: int = 0  # of the earliest good sample
    value: Seven | None = None  # the earliest good sample
    time: int | None = None  # of the first sample met, good or bad
    several: bool = False  # whether it has samples of more than one time
    frame: str = ""  # frame id of the earliest good sample

    def take(self, time: int, value: Seven | None, frame: str = "") -> None:
        """Take in a sample; None is a bad one."""
        if self.time is None:
            self.time = time
        elif time != self.time:
            self.several = True
        if value is not None and (self.value is None or time < self.first_time):
            self.first_time, self.value, self.frame = time, value, frame


class Moment(NamedTuple):
    """Time of a message, and that less its log time; ns."""

    time: int
    offset: int


@dataclass
class Known:
    """What was learnt. Streams are keyed by topic and name: child frame, joint as recorded, or ""."""

    streams: dict[tuple[str, str], Facts] = field(default_factory=dict)
    names: dict[str, set[str]] = field(default_factory=dict)  # topic -> joints and frames met
    frames: dict[tuple[str, str], dict[str, None]] = field(default_factory=dict)  # stream -> frame ids it is given in
    readers: dict[int, Callable[[bytes], Content]] = field(default_factory=dict)
    sides: dict[str, set[str]] = field(default_factory=dict)  # topic -> sides of gloves met
    moments: dict[tuple[str, str], list[Moment]] = field(default_factory=dict)  # topic, child -> of its first messages
    only: dict[str, str] = field(default_factory=dict)  # topic followed without a child frame -> the first it names
    unreadable: dict[str, str] = field(default_factory=dict)  # topic -> what is wrong with the first bad message
    warnings: list[str] = field(default_factory=list)


@dataclass
class _Probe:
    """What is still to be learnt from a channel."""

    channel: LogChannel
    wanted: dict[str, bytes]  # names and how they look in a message
    decided: bool  # whether it is known what a stamp of zero means on it
    only_child: bool = False  # whether it is followed without naming the child frame
    timed: frozenset[str] = frozenset()  # children whose times are noted
    met: int = 0
    bytes: int = 0  # of the messages that wait
    latest: int = -(2**62)
    waiting: list[tuple[RawMessage, Content]] = field(default_factory=list)  # until that is decided


def learn(reader: LogReader, plan: Plan, config: Config, times: MessageTimes) -> Known:
    """Read the log's beginning; fills `times.zero_counts` as well.

    Raises LogError if a schema cannot be read, if a pose has no good sample, or if the topics' clocks are not the same.
    """
    known = Known()
    probes = _probes(plan, known, decided=config.time != "header")
    keys = set(probes)
    delay = round(config.max_delay * 1e9)
    for raw in reader.read(keys):
        probe = probes[raw.key]
        probe.met += 1
        last = probe.met == probe.channel.messages
        if last or _may_tell(probe, known, raw):
            for message, content in _decided(probe, known, times, raw, last):
                _take(probe, known, times, message, content)
        if last or (probe.decided and _done(probe, known, delay)):
            keys.discard(raw.key)
            if not keys:
                break
    if config.time != "log":
        _check_clocks(reader, plan, known, config)
    return known


def _probes(plan: Plan, known: Known, *, decided: bool) -> dict[int, _Probe]:
    """One probe a channel that feeds something; makes the channels' readers."""
    wanted: dict[int, set[str]] = {}
    channels: dict[int, LogChannel] = {}
    for pose in plan.poses:
        for c in pose.channels:
            channels[c.key] = c
            wanted.setdefault(c.key, set()).add(pose.child)
    for joints in plan.joints:
        for c in joints.channels:
            channels[c.key] = c
            wanted.setdefault(c.key, set()).update(_joint_keys(joints.recorded_names(), joints.side))
    for c in plan.clock.channels if plan.clock is not None else ():
        channels[c.key] = c
        wanted.setdefault(c.key, set())
    probes = {}
    for key, c in channels.items():
        kind = kind_of(c)
        if kind is None:
            continue
        known.readers[key] = make_reader(c, kind)
        spelled_out = not isinstance(kind.layout, PoseLayout) or kind.layout.spelled_out
        names = {n: n.rsplit("\0", 1)[-1].encode() if spelled_out else b"" for n in sorted(wanted[key])}
        only_child = any(p.is_only_child and c in p.channels for p in plan.poses)
        timed = set(wanted[key])
        if plan.clock is not None and c in plan.clock.channels:
            timed.add(plan.clock.child)
        probes[key] = _Probe(c, names, decided or not kind.stamped, only_child, frozenset(timed))
    return probes


def _joint_keys(names: dict[str, int], side: str) -> list[str]:
    """Names of joint streams: with a side, each side is apart."""
    return [joint_key(n, side) for n in names]


def joint_key(name: str, side: str) -> str:
    """Name under which `Known.streams` has a joint of a topic read for one side ("" for any)."""
    return f"{side}\0{name}" if side else name


def _may_tell(probe: _Probe, known: Known, raw: RawMessage) -> bool:
    """Whether a message can tell anything new: only then it is decoded."""
    if probe.met <= OFFSETS or not probe.decided:
        return True
    topic = probe.channel.topic
    open_names = [n for n in probe.wanted if not _settled(known.streams.get((topic, n)))]
    if not open_names:
        return True  # all are known but for what may still come late
    ascii_only = probe.channel.encoding != "json" or all(n.isascii() for n in open_names)
    return not ascii_only or any(probe.wanted[n] in raw.data for n in open_names)


def _settled(facts: Facts | None) -> bool:
    return facts is not None and facts.several and facts.value is not None


def _done(probe: _Probe, known: Known, delay: int) -> bool:
    """Whether a channel has told all."""
    if probe.met < 2:
        return False
    for name in probe.wanted:
        facts = known.streams.get((probe.channel.topic, name))
        if facts is None or not _settled(facts) or probe.latest < facts.first_time + delay:
            return False
    return True


def _decided(
    probe: _Probe, known: Known, times: MessageTimes, raw: RawMessage, last: bool
) -> list[tuple[RawMessage, Content]]:
    """Decode a message; returns it, and those before it, once it is decided what a stamp of zero means on the channel.

    A stamp of zero is a time if it is that of a single message which comes as long before the next one as the stamps say.
    """
    try:
        probe.waiting.append((raw, known.readers[raw.key](raw.data)))
        probe.bytes += len(raw.data)
    except BadMessageError as problem:
        known.unreadable.setdefault(probe.channel.topic, str(problem))
        if not last:
            return []
    if not probe.decided and probe.waiting:
        message, content = probe.waiting[-1]
        stamps = [content.stamp] if isinstance(content, Joints) else [p.stamp for p in content]
        other = next((s for s in stamps if s), None)
        if other is not None:
            times.offsets[raw.key] = other - message.log_time
            unset = {m.log_time for m, _ in probe.waiting[:-1]}
            begin = next(iter(unset), None)
            apart = other - (message.log_time - begin) if begin is not None else other
            if len(unset) < 2 and apart < (SOON if begin is not None else EARLY_CLOCK):
                times.zero_counts[raw.key] = begin
        full = len(probe.waiting) >= ZEROS or probe.bytes >= ZERO_BYTES
        probe.decided = other is not None or last or full or stamps[:1] == [None]
    ready = probe.waiting if probe.decided else []
    if ready:
        probe.waiting = []
    return ready


def _take(probe: _Probe, known: Known, times: MessageTimes, raw: RawMessage, content: Content) -> None:
    """Note what a message tells."""
    key, topic = raw.key, probe.channel.topic
    names = known.names.setdefault(topic, set())
    items: list[tuple[int, str, Seven | None, str]] = []
    if isinstance(content, Joints):
        time = times.of(key, content.stamp, raw.log_time, raw.publish_time)
        add_names(names, content.names)
        if content.side:
            add_names(known.sides.setdefault(topic, set()), [content.side])
        for name, value in zip(content.names, content.sample, strict=False):
            good: Seven | None = (value,) if abs(value) < VALUE_LIMIT else None
            items.append((time, name, good, ""))
            if content.side:
                items.append((time, joint_key(name, content.side), good, ""))
        moments = {"": [time]}
    else:
        moments = {}
        for pose in content:
            time = times.of(key, pose.stamp, raw.log_time, raw.publish_time)
            add_names(names, [pose.child])
            sample = good_pose(pose.value)
            items.append((time, pose.child, sample, pose.frame))
            followed = {pose.child}
            if pose.child and probe.only_child and known.only.setdefault(topic, pose.child) == pose.child:
                items.append((time, "", sample, pose.frame))
                followed.add("")
            for child in followed & probe.wanted.keys():
                frames = known.frames.setdefault((topic, child), {})
                if len(frames) < FRAME_IDS:
                    frames[pose.frame] = None
            moments.setdefault(pose.child if pose.child in probe.timed else "", []).append(time)
    for time, name, taken, frame in items:
        if name in probe.wanted:
            known.streams.setdefault((topic, name), Facts()).take(time, taken, frame)
    probe.latest = max([probe.latest, *(t for at in moments.values() for t in at)])
    for part, at in moments.items():
        if isinstance(content, Joints) or part in probe.timed:
            noted = known.moments.setdefault((topic, part), [])
            if len(noted) < OFFSETS and probe.channel.messages > 1:
                noted.extend(Moment(t, t - raw.log_time) for t in at)


def _check_clocks(reader: LogReader, plan: Plan, known: Known, config: Config) -> None:
    """Raise LogError if a topic's stamps are of another clock than the frame clock's; warn where they may be.

    They are if they lie far apart both as they stand and measured from the log times, or if by its stamps the topic ends
    before the clock begins, or the other way round, where by the log times it does not.
    """
    if plan.clock is None:
        return
    delays = {pose.topic: round(pose.source.delay * 1e9) for pose in plan.poses}
    delays |= {joints.topic: round(joints.source.delay * 1e9) for joints in plan.joints}
    shifted = {
        (topic, part): [Moment(m.time + delays.get(topic, 0), m.offset + delays.get(topic, 0)) for m in moments]
        for (topic, part), moments in known.moments.items()
    }
    clock = shifted.get((plan.clock.topic, plan.clock.child)) or shifted.get((plan.clock.topic, ""))
    if not clock:
        return
    spans = _spans(reader, [*plan.poses, *plan.joints, plan.clock])
    told = {plan.clock.topic} if plan.clock.child == "" else set()
    for (topic, part), moments in sorted(shifted.items()):
        if is_static(topic) or topic in told or not moments or moments is clock:
            continue
        pairs = [(a, b) for a in moments for b in clock]
        apart = min(min(abs(a.time - b.time), abs(a.offset - b.offset)) for a, b in pairs)
        if apart > CLOCKS_APART:
            raise LogError(
                f"{reader.path}: the times of topic {topic!r} and of the frame clock {plan.clock.topic!r} are of "
                f"different clocks, {apart / 1e9:.0f} s apart; --time log goes by when the log received the messages"
            )
        offset, own = max(m.offset for m in moments), max(m.offset for m in clock)
        if abs(offset - own) <= APART or (apart <= APART and not (_is_live(moments) and _is_live(clock))):
            continue
        told.add(topic)
        name = f"{topic}#{part}" if part else topic
        side = "before" if offset < own else "after"
        what = (
            f"the time stamps of topic {plain(name)!r} lie {abs(offset - own) / 1e9:.3f} s {side} those of the frame "
        )
        what += f"clock {plain(plan.clock.topic)!r} by when the log received them"
        first, last = spans[topic]
        begin, end = spans[plan.clock.topic]
        gap = max((begin + own) - (last + offset), (first + offset) - (end + own))
        if gap > config.max_gap * 1e9 and last > first and end > begin and min(end, last) > max(begin, first):
            raise LogError(
                f"{reader.path}: {what}: all of them come {gap / 1e9:.3f} s {side} its {'first' if offset < own else 'last'} "
                "frame, so every frame would be held; --time log goes by when the log received the messages"
            )
        known.warnings.append(f"{what}: are their clocks apart? --time log goes by when the log received the messages")


def _is_live(moments: list[Moment]) -> bool:
    """Whether messages were logged as they came: the log times go about as fast as the stamps."""
    times = [m.time for m in moments]
    logged = [m.time - m.offset for m in moments]
    span, log_span = max(times) - min(times), max(logged) - min(logged)
    return 0 < span <= 4 * log_span <= 16 * span


def _spans(reader: LogReader, inputs: Iterable[PoseInput | JointInput | ClockInput]) -> dict[str, tuple[int, int]]:
    """Topic -> log times of its first and its last message."""
    spans = {}
    for source in inputs:
        channels = [c for c in source.channels if c.messages]
        if channels:
            spans[source.topic] = (min(c.first_ns for c in channels), max(c.last_ns for c in channels))
    return spans


def log_times_agree(known: Known, delay: int) -> bool:
    """Whether the log times put the topics in the order of their messages' times, to within `delay` [ns].

    They do not where a writer left the log times of a topic unset.
    """
    offsets = [
        [m.offset for m in moments] for (topic, _), moments in known.moments.items() if moments and not is_static(topic)
    ]
    return not offsets or max(min(o) for o in offsets) - min(max(o) for o in offsets) <= delay


def stream_problems(reader: LogReader, plan: Plan, known: Known) -> Iterator[str]:
    """Say which poses never come, or never well, and which topics have no joint of the tree that follows them."""
    for pose in plan.poses:
        facts = known.streams.get((pose.topic, pose.child))
        names = sorted(known.names.get(pose.topic, ()), key=lambda n: (len(n) if n.isdigit() else 0, n))
        if facts is None:
            what = "no readable pose"
            if not names and pose.topic in known.unreadable:
                what += f": a message {known.unreadable[pose.topic]}"
            elif pose.child:
                told = {"poses": "with the index", "named_poses": "named"}.get(str(pose.what), "of the frame")
                what = f"no pose {told} {pose.child!r}{similar(pose.child, names)}; it has {listed(names)}"
            yield f"{reader.path}: topic {pose.topic!r} has {what}"
        elif pose.is_only_child and len(names) > 1:
            yield (
                f"{reader.path}: topic {pose.topic!r} has poses of several frames, {listed(names)}: name the one to follow "
                f"as {pose.topic}#{plain(names[0])}"
            )
        elif facts.value is None:
            name = f"{pose.topic}#{pose.child}" if pose.child else pose.topic
            yield f"{reader.path}: topic {name!r} has no good pose: all are NaN or have no unit quaternion"
    for joints in plan.joints:
        wanted = joints.recorded_names()
        if not wanted or any((joints.topic, joint_key(n, joints.side)) in known.streams for n in wanted):
            continue
        sides = known.sides.get(joints.topic, set())
        if joints.side and joints.side not in sides:
            has = listed(sorted(sides))
            yield f"{reader.path}: topic {joints.topic!r} has no glove of the side {joints.side!r}; it has {has}"
            continue
        names = sorted(known.names.get(joints.topic, ()))
        if not names and joints.topic in known.unreadable:
            yield f"{reader.path}: topic {joints.topic!r} has no readable joints: a message {known.unreadable[joints.topic]}"
            continue
        yield (
            f"{reader.path}: topic {joints.topic!r} has none of the joints {listed(sorted(wanted))}; it has "
            f"{listed(names)}; {_way_out(names, wanted)}"
        )


def _way_out(recorded: Iterable[str], wanted: Iterable[str]) -> str:
    """What to do where no recorded joint is one of the scene: hands that were swapped are told from other names."""
    has, needs = ({side_of(name) for name in names} - {""} for names in (recorded, wanted))
    if len(has) == len(needs) == 1 and has != needs:
        sides = f"the recorded ones are of the {has.pop()} side, those of the scene of the {needs.pop()} one"
        return f"{sides}: choose the topic or the URDF of the same side"
    return "map them by `rename`"
