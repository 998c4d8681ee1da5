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
from geomphys.recording.name_words import side_of
from geomphys.recording.naming import add_names, listed, similar
from geomphys.recording.plan import Plan, is_static
from geomphys.recording.reader import LogChannel, LogReader, RawMessage
from geomphys.recording.streams import VALUE_LIMIT, Seven, good_pose
from geomphys.recording.times import EARLY_CLOCK, MessageTimes

OFFSETS = 8  # messages of a channel whose stamps are compared with their log times
FRAME_IDS = 64  # frame ids of a stream that are noted
ZEROS = 64  # messages with a stamp of zero after which a channel counts as not stamped
CLOCKS_APART = 3600 * 10**9
"""ns; topics whose stamps differ by more than this from what their log times say are of different clocks."""


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
    moments: dict[str, list[Moment]] = field(default_factory=dict)  # topic -> times of its first messages


@dataclass
class _Probe:
    """What is still to be learnt from a channel."""

    channel: LogChannel
    wanted: dict[str, bytes]  # names and how they look in a message
    decided: bool  # whether it is known what a stamp of zero means on it
    met: int = 0
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
    _check_clocks(reader, plan, known)
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
        names = {n: n.rsplit("\0", 1)[-1].encode() for n in sorted(wanted[key])}
        probes[key] = _Probe(c, names, decided or not kind.stamped)
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

    Stamps of zero are times if the first stamp that is not zero is a small one.
    """
    try:
        probe.waiting.append((raw, known.readers[raw.key](raw.data)))
    except BadMessageError:
        if not last:
            return []
    if not probe.decided and probe.waiting:
        content = probe.waiting[-1][1]
        stamps = [content.stamp] if isinstance(content, Joints) else [p.stamp for p in content]
        other = next((s for s in stamps if s), None)
        if other is not None and other < EARLY_CLOCK:
            times.zero_counts.add(raw.key)
        probe.decided = other is not None or last or len(probe.waiting) >= ZEROS or stamps[:1] == [None]
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
        for name, value in zip(content.names, content.values, strict=False):
            good = (value,) if abs(value) < VALUE_LIMIT else None
            items.append((time, name, good, ""))
            if content.side:
                items.append((time, joint_key(name, content.side), good, ""))
        moments = [time]
    else:
        for pose in content:
            time = times.of(key, pose.stamp, raw.log_time, raw.publish_time)
            add_names(names, [pose.child])
            items.append((time, pose.child, good_pose(pose.value), pose.frame))
            frames = known.frames.setdefault((topic, pose.child), {}) if pose.child in probe.wanted else {}
            if len(frames) < FRAME_IDS:
                frames[pose.frame] = None
        moments = [time for time, *_ in items]
    for time, name, sample, frame in items:
        if name in probe.wanted:
            known.streams.setdefault((topic, name), Facts()).take(time, sample, frame)
    if moments:
        probe.latest = max(probe.latest, *moments)
    known_moments = known.moments.setdefault(topic, [])
    if len(known_moments) < OFFSETS and probe.channel.messages > 1:
        known_moments.extend(Moment(t, t - raw.log_time) for t in moments)


def _check_clocks(reader: LogReader, plan: Plan, known: Known) -> None:
    """Raise LogError if a topic's stamps are of another clock than the frame clock's.

    They are if they lie far apart both as they stand and measured from the log times.
    """
    if plan.clock is None or not known.moments.get(plan.clock.topic):
        return
    clock = known.moments[plan.clock.topic]
    for topic, moments in sorted(known.moments.items()):
        pairs = [(a, b) for a in moments for b in clock]
        apart = min((min(abs(a.time - b.time), abs(a.offset - b.offset)) for a, b in pairs), default=0)
        if apart > CLOCKS_APART and not is_static(topic):
            raise LogError(
                f"{reader.path}: the times of topic {topic!r} and of the frame clock {plan.clock.topic!r} are of "
                f"different clocks, {apart / 1e9:.0f} s apart; --time log goes by when the log received the messages"
            )


def log_times_agree(known: Known, delay: int) -> bool:
    """Whether the log times put the topics in the order of their messages' times, to within `delay` [ns].

    They do not where a writer left the log times of a topic unset.
    """
    offsets = [
        [m.offset for m in moments] for topic, moments in known.moments.items() if moments and not is_static(topic)
    ]
    return not offsets or max(min(o) for o in offsets) - min(max(o) for o in offsets) <= delay


def stream_problems(reader: LogReader, plan: Plan, known: Known) -> Iterator[str]:
    """Say which poses never come, or never well, and which topics have no joint of the tree that follows them."""
    for pose in plan.poses:
        facts = known.streams.get((pose.topic, pose.child))
        if facts is None:
            names = sorted(known.names.get(pose.topic, ()))
            what = "no readable pose"
            if pose.child:
                what = f"no pose of the frame {pose.child!r}{similar(pose.child, names)}; it has {listed(names)}"
            yield f"{reader.path}: topic {pose.topic!r} has {what}"
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
