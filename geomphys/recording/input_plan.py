"""Maps the inputs of a scene (root poses, joints, frame clock) to the channels of a log and checks their types.

A source names a topic, or ``topic#part`` where a message speaks of several things: the child frame of a transform, the
name or index of a pose, the side of a glove.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from geomphys.config import Config
from geomphys.recording.channels import kind_of, unsupported_reason
from geomphys.recording.display_names import did_you_mean, join_names
from geomphys.recording.keypoint_matching import match_points
from geomphys.recording.reader import LogChannel, LogReader
from geomphys.recording.samples import CONTENT_NAMES, JOINTS, PART_PLACEHOLDERS, POINTS, POSES, ContentType
from geomphys.scene.topic_sources import JointSource, KeypointSource, RootSource
from geomphys.scene.world import World

MIN_POINTS = 3
"""Points that a fit needs at least."""


@dataclass(frozen=True)
class PoseInput:
    """A tree's root and the channels its pose comes from."""

    source: RootSource
    topic: str
    child: str  # `Pose.child` of its poses; "" for those of messages that hold one
    channels: tuple[LogChannel, ...]
    is_point: bool = False  # a point that joint values are fitted to

    @property
    def content(self) -> ContentType | None:
        """What its messages yield."""
        return _what(self.channels[0])

    @property
    def is_only_child(self) -> bool:
        """Whether the child frame is not named by the scene and taken from the messages."""
        return not self.child and self.content == "transform"


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
class KeypointInput:
    """Points that a tree's joint values are fitted to, and the channels they come from."""

    source: KeypointSource
    topic: str
    channels: tuple[LogChannel, ...]
    points: tuple[PoseInput, ...]
    links: tuple[str, ...]  # of each point
    weights: tuple[float, ...]  # of each point
    oriented: tuple[bool, ...]  # whether the orientation of each may count
    left_out: tuple[str, ...] = ()  # points of the log or the layout without a link


@dataclass(frozen=True)
class ClockInput:
    """The topic that gives the frames."""

    topic: str
    child: str
    channels: tuple[LogChannel, ...]
    delay: float = 0.0  # s, added to its times
    points: frozenset[str] = frozenset()  # children of which any gives a frame


@dataclass
class Plan:
    """All inputs of a replay. `problems` are lines that each forbid it."""

    poses: list[PoseInput] = field(default_factory=list)
    joints: list[JointInput] = field(default_factory=list)
    keypoints: list[KeypointInput] = field(default_factory=list)  # their points are among `poses`
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
    for keypoints in sorted(world.keypoints, key=lambda s: s.tree):
        _plan_keypoints(plan, reader, world, keypoints)
    _plan_clock(plan, reader, world, config)
    return plan


def is_static(topic: str) -> bool:
    """Whether a topic holds static transforms (``tf_static``); its streams are constant."""
    return topic.rsplit("/", 1)[-1] == "tf_static"


def pose_part(channel: LogChannel, part: str) -> str:
    """`Pose.child` or side that a source means by ``#part``: joints of a hand may be named by their numbers too."""
    kind = kind_of(channel)
    if kind is not None and kind.content == "glove":
        return part.lower()
    names: tuple[str, ...] = getattr(kind.layout, "names", ()) if kind is not None else ()
    if part.isascii() and part.isdigit() and int(part[:9]) < len(names):
        return names[int(part)]
    return part.lower() if part.lower() in names else part


def split_topic(name: str, topics: Iterable[str]) -> tuple[str, str]:
    """Split ``topic#part``; a name that equals a topic has no part."""
    if name in topics:
        return name, ""
    topic, _, part = name.partition("#")
    return topic, part


def _plan_root(plan: Plan, reader: LogReader, world: World, source: RootSource) -> None:
    """Look up the topic of a root's pose."""
    user = f"the root of {world.tree_names[source.tree]!r}"
    topic, child, channels = _find_channels(plan, reader, source.topic, user, POSES, "a pose")
    if not channels:
        return
    what = _what(channels[0])
    if what in PART_PLACEHOLDERS and not child:
        plan.problems.append(
            f"{reader.path}: topic {topic!r} holds {CONTENT_NAMES[what]}; {user} must name its own as "
            f"{topic}#{PART_PLACEHOLDERS[what]} (`geomphys info` lists them)"
        )
    elif child and what == "pose":
        plan.problems.append(f"{reader.path}: topic {topic!r} holds a single pose; {user} cannot follow #{child} of it")
    else:
        plan.poses.append(PoseInput(source, topic, pose_part(channels[0], child), channels))


def _plan_joints(plan: Plan, reader: LogReader, world: World, source: JointSource) -> None:
    """Look up the topic of a tree's joints."""
    user = f"the joints of {world.tree_names[source.tree]!r}"
    topic, side, channels = _find_channels(plan, reader, source.topic, user, JOINTS, "joint values")
    if not channels:
        return
    glove = _what(channels[0]) == "glove"
    if side and not glove:
        plan.problems.append(f"{reader.path}: topic {topic!r} has no sides; {user} cannot follow #{side} of it")
        return
    degrees = source.unit == "deg" or (source.unit is None and glove)
    plan.joints.append(JointInput(source, topic, side.lower(), channels, degrees))


def _plan_keypoints(plan: Plan, reader: LogReader, world: World, source: KeypointSource) -> None:
    """Look up the points that a tree's joint values are fitted to."""
    user = f"the keypoints of {world.tree_names[source.tree]!r}"
    topic, side, channels = _find_channels(plan, reader, source.topic, user, POINTS, "points")
    if not channels:
        return
    if _what(channels[0]) == "glove" and any(j.topic == topic for j in plan.joints):
        plan.problems.append(f"{reader.path}: topic {topic!r} feeds both joints and keypoints: use one of them")
        return
    rows = slice(*world.scene.trees.body_start[source.tree : source.tree + 2])
    links = [name.split("/", 1)[1] for name in world.body_names[rows]]
    matches = match_points(reader, channels, source, side.lower(), links, world.tree_names[source.tree])
    if len(matches.links) < MIN_POINTS:
        what = f"{len(matches.links)} of its points have a link of {world.tree_names[source.tree]!r}"
        plan.problems.append(
            f"{reader.path}: topic {topic!r}: {what}, at least {MIN_POINTS} are needed: "
            f'say which by links = {{ point = "link" }}; its points are {join_names(matches.left_out)}'
        )
        return
    names = list(matches.links)
    root = RootSource(
        tree=source.tree, topic=topic, position=(0.0, 0.0, 0.0), orientation=(0.0, 0.0, 0.0, 1.0), delay=source.delay
    )
    points = tuple(PoseInput(root, topic, name, channels, is_point=True) for name in names)
    plan.poses += points
    plan.keypoints.append(
        KeypointInput(
            source,
            topic,
            channels,
            points,
            tuple(matches.links.values()),
            matches.weights,
            matches.oriented,
            tuple(matches.left_out),
        )
    )


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
    delays += [(s.topic, s.delay) for s in world.keypoints]
    delay = dict(reversed(delays)).get(name, 0.0)
    tracked = next((k for k in plan.keypoints if k.source.topic == name), None)
    if tracked is not None:
        children = [point.child for point in tracked.points]
        plan.clock = ClockInput(topic, children[0], tracked.channels, delay, frozenset(children))
        return
    plan.clock = ClockInput(topic, pose_part(channels[0], child), channels, delay)


def default_clock(world: World) -> str | None:
    """Name the topic that gives the frames if the user does not.

    That is the first avatar's root, else its points or joints; without an avatar that follows a topic, the first object's pose,
    else the first object's joints.
    """
    roots = sorted((s.tree, s.topic) for s in world.roots)
    joints = sorted([*((s.tree, s.topic) for s in world.joints), *((s.tree, s.topic) for s in world.keypoints)])
    for avatar in range(world.avatar_count):
        for tree, topic in (*roots, *joints):
            if tree == avatar:
                return topic
    return next((topic for _, topic in (*roots, *joints)), None)


def _what(channel: LogChannel) -> ContentType | None:
    kind = kind_of(channel)
    return kind.content if kind is not None else None


def _missing(reader: LogReader, topic: str, user: str) -> str:
    """Say that a topic is missing, and list those that exist."""
    topics = reader.topics
    if not topics:
        return f"{reader.path}: topic {topic!r} for {user} is not in the log, which has no topics at all"
    hint = did_you_mean(topic, topics)
    return f"{reader.path}: topic {topic!r} for {user} is not in the log{hint}; it has {join_names(topics)}"


def _find_channels(
    plan: Plan, reader: LogReader, name: str, user: str, accepted: tuple[ContentType, ...], holds: str
) -> tuple[str, str, tuple[LogChannel, ...]]:
    """Topic and part of a source's `name`, and the channels with `accepted` content; () and a problem added if none."""
    topic, part = split_topic(name, reader.topics)
    channels = reader.of_topic(topic)
    if not channels:
        plan.problems.append(_missing(reader, topic, user))
        return topic, part, ()
    fitting = tuple(c for c in channels if _what(c) in accepted)
    if not fitting:
        others = sorted({o.topic for o in reader.channels.values() if _what(o) in accepted and o.messages})
        known = f"; of this log {join_names(others)} {'has' if len(others) == 1 else 'have'} {holds}" if others else ""
        reason = unsupported_reason(channels[0], accepted, holds)
        plan.problems.append(f"{reader.path}: topic {topic!r} for {user} {reason}{known}")
        return topic, part, ()
    fitting = tuple(c for c in fitting if _what(c) == _what(fitting[0]))
    if sum(c.messages for c in fitting) == 0:
        plan.problems.append(f"{reader.path}: topic {topic!r} for {user} has no message")
        return topic, part, ()
    return topic, part, fitting
