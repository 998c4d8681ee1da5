"""What of a log feeds what of a world: topics are looked up and their kinds checked before anything is read.

A source names a topic, or ``topic#part`` where a message speaks of several things: the child frame of a transform, the
name or index of a pose, the side of a glove.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from geomphys.config import Config
from geomphys.recording.channels import kind_of, not_understood
from geomphys.recording.naming import listed, similar
from geomphys.recording.reader import LogChannel, LogReader
from geomphys.recording.samples import JOINTS, PARTS, POSES, USES, What
from geomphys.scene.arrays import World
from geomphys.scene.topic_sources import JointSource, RootSource


@dataclass(frozen=True)
class PoseInput:
    """A tree's root and the channels its pose comes from."""

    source: RootSource
    topic: str
    child: str  # `Pose.child` of its poses; "" for those of messages that hold one
    channels: tuple[LogChannel, ...]

    @property
    def what(self) -> What | None:
        """What its messages yield."""
        return _what(self.channels[0])

    @property
    def is_only_child(self) -> bool:
        """Whether it follows what its topic is the pose of, without naming it: the messages do."""
        return not self.child and self.what == "transform"


@dataclass(frozen=True)
class JointInput:
    """A tree's joints and the channels their values come from."""

    source: JointSource
    topic: str
    side: str  # of the glove; "" for any
    channels: tuple[LogChannel, ...]
    degrees: bool

    def column(self, recorded: str) -> int | None:
        """Column of the angles that a recorded joint feeds; None for one that is not of this tree.

        `rename` goes first: a name it maps elsewhere, or a joint it feeds from another name, is not matched by itself.
        What `ignore` leaves out feeds nothing.
        """
        rename, dofs = self.source.rename, self.source.dofs
        if self.source.ignores(recorded):
            return None
        if recorded in rename:
            return dofs.get(rename[recorded])
        return None if recorded in rename.values() else dofs.get(recorded)

    def recorded_names(self) -> dict[str, int]:
        """Names under which this tree's joints may be recorded, and their columns."""
        names = [*self.source.rename, *self.source.dofs]
        return {n: c for n in names if (c := self.column(n)) is not None}


@dataclass(frozen=True)
class ClockInput:
    """The topic that gives the frames."""

    topic: str
    child: str
    channels: tuple[LogChannel, ...]
    delay: float = 0.0  # s, added to its times


@dataclass
class Plan:
    """All inputs of a replay. `problems` are lines that each forbid it."""

    poses: list[PoseInput] = field(default_factory=list)
    joints: list[JointInput] = field(default_factory=list)
    clock: ClockInput | None = None  # None: the span of the log itself
    problems: list[str] = field(default_factory=list)

    @property
    def keys(self) -> set[int]:
        """Channels that must be read."""
        inputs: list[PoseInput | JointInput | ClockInput] = [*self.poses, *self.joints]
        if self.clock is not None:
            inputs.append(self.clock)
        return {c.key for i in inputs for c in i.channels}


def make_plan(reader: LogReader, world: World, config: Config) -> Plan:
    """Look up every source of `world` in the log, and the frame clock. What is wrong becomes `problems`."""
    plan = Plan()
    for root in sorted(world.roots, key=lambda s: s.tree):
        _plan_root(plan, reader, world, root)
    for joints in sorted(world.joints, key=lambda s: s.tree):
        _plan_joints(plan, reader, world, joints)
    _plan_clock(plan, reader, world, config)
    return plan


def is_static(topic: str) -> bool:
    """Whether a topic is one of static transforms, whose streams are constant."""
    return topic.rsplit("/", 1)[-1] == "tf_static"


def pose_part(channel: LogChannel, part: str) -> str:
    """`Pose.child` or side that a source means by ``#part``: joints of a hand may be named by their numbers too."""
    kind = kind_of(channel)
    if kind is not None and kind.what == "glove":
        return part.lower()
    names: tuple[str, ...] = getattr(kind.layout, "names", ()) if kind is not None else ()
    if part.isascii() and part.isdigit() and int(part[:9]) < len(names):
        return names[int(part)]
    return part.lower() if part.lower() in names else part


def split_topic(name: str, topics: Iterable[str]) -> tuple[str, str]:
    """Split ``topic#part``; a name that is a topic as it stands has no part."""
    if name in topics:
        return name, ""
    topic, _, part = name.partition("#")
    return topic, part


def _plan_root(plan: Plan, reader: LogReader, world: World, source: RootSource) -> None:
    """Look up the topic of a root's pose."""
    topic, child = split_topic(source.topic, reader.topics)
    user = f"the root of {world.tree_names[source.tree]!r}"
    channels = _understood(plan, reader, topic, user, POSES, "a pose")
    if not channels:
        return
    what = _what(channels[0])
    if what in PARTS and not child:
        plan.problems.append(
            f"{reader.path}: topic {topic!r} holds {USES[what]}; {user} must name its own as "
            f"{topic}#{PARTS[what]} (`geomphys info` lists them)"
        )
    elif child and what == "pose":
        plan.problems.append(f"{reader.path}: topic {topic!r} holds a single pose; {user} cannot follow #{child} of it")
    else:
        plan.poses.append(PoseInput(source, topic, pose_part(channels[0], child), channels))


def _plan_joints(plan: Plan, reader: LogReader, world: World, source: JointSource) -> None:
    """Look up the topic of a tree's joints."""
    topic, side = split_topic(source.topic, reader.topics)
    user = f"the joints of {world.tree_names[source.tree]!r}"
    channels = _understood(plan, reader, topic, user, JOINTS, "joint values")
    if not channels:
        return
    glove = _what(channels[0]) == "glove"
    if side and not glove:
        plan.problems.append(f"{reader.path}: topic {topic!r} has no sides; {user} cannot follow #{side} of it")
        return
    degrees = source.unit == "deg" or (source.unit is None and glove)
    plan.joints.append(JointInput(source, topic, side.lower(), channels, degrees))


def _plan_clock(plan: Plan, reader: LogReader, world: World, config: Config) -> None:
    """Choose the frame clock."""
    name = config.clock if config.clock is not None else default_clock(world)
    if name is None:
        if config.rate is None:
            plan.problems.append(
                f"{reader.path}: nothing in the scene {world.path} follows a topic, so it gives no frames; "
                "say how many a second with --rate HZ or which topic gives them with --clock TOPIC"
            )
        elif reader.messages == 0:
            plan.problems.append(f"{reader.path}: holds no message, so there is no time span to replay")
        return
    topic, child = split_topic(name, reader.topics)
    channels = reader.of_topic(topic)
    channels = tuple(c for c in channels if kind_of(c) is not None) or channels
    if not channels:
        if config.clock is not None:
            plan.problems.append(_missing(reader, topic, "the frame clock"))
        return
    if sum(c.messages for c in channels) == 0:
        if config.clock is not None:
            plan.problems.append(f"{reader.path}: topic {topic!r}, the frame clock, has no message")
        return
    delays = [*((s.topic, s.delay) for s in world.roots), *((s.topic, s.delay) for s in world.joints)]
    delay = dict(reversed(delays)).get(name, 0.0)
    plan.clock = ClockInput(topic, pose_part(channels[0], child), channels, delay)


def default_clock(world: World) -> str | None:
    """Name the topic that gives the frames if the user does not.

    That is the first avatar's root, else its joints; without an avatar that follows a topic, the first object's pose,
    else the first object's joints.
    """
    roots = sorted((s.tree, s.topic) for s in world.roots)
    joints = sorted((s.tree, s.topic) for s in world.joints)
    for avatar in range(world.avatar_count):
        for tree, topic in (*roots, *joints):
            if tree == avatar:
                return topic
    return next((topic for _, topic in (*roots, *joints)), None)


def _what(channel: LogChannel) -> What | None:
    kind = kind_of(channel)
    return kind.what if kind is not None else None


def _missing(reader: LogReader, topic: str, user: str) -> str:
    """Say that a topic is not there, and what is."""
    topics = reader.topics
    if not topics:
        return f"{reader.path}: topic {topic!r} for {user} is not in the log, which has no topics at all"
    return (
        f"{reader.path}: topic {topic!r} for {user} is not in the log{similar(topic, topics)}; it has {listed(topics)}"
    )


def _understood(
    plan: Plan, reader: LogReader, topic: str, user: str, wanted: tuple[What, ...], holds: str
) -> tuple[LogChannel, ...]:
    """Channels of a topic that hold what is wanted; none, and a problem, if there are none."""
    channels = reader.of_topic(topic)
    if not channels:
        plan.problems.append(_missing(reader, topic, user))
        return ()
    fitting = tuple(c for c in channels if _what(c) in wanted)
    if not fitting:
        others = sorted({o.topic for o in reader.channels.values() if _what(o) in wanted and o.messages})
        known = f"; of this log {listed(others)} {'has' if len(others) == 1 else 'have'} {holds}" if others else ""
        why = not_understood(channels[0], wanted, holds)
        plan.problems.append(f"{reader.path}: topic {topic!r} for {user} {why}{known}")
        return ()
    fitting = tuple(c for c in fitting if _what(c) == _what(fitting[0]))
    if sum(c.messages for c in fitting) == 0:
        plan.problems.append(f"{reader.path}: topic {topic!r} for {user} has no message")
        return ()
    return fitting
