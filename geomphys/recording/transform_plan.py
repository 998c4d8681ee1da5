"""The recorded space of a log, and how the poses that are given in other frames are brought there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from geomphys.errors import LogError
from geomphys.recording.display_names import listed, plain, similar
from geomphys.recording.input_plan import Plan, PoseInput
from geomphys.recording.reader import LogReader
from geomphys.recording.stream_prescan import Known
from geomphys.recording.transform_tree import Edge, FrameError, FrameTree, Step, is_of_tree, plain_frame, survey


@dataclass(frozen=True)
class FrameUse:
    """A topic's poses, the frame they are given in, and what brings them to the recorded space."""

    topic: str  # `topic` or `topic#child`
    frame: str
    space: str
    through: tuple[str, ...]  # topics of the transforms
    moving: bool  # whether one of the transforms changes over time

    def __str__(self) -> str:
        """In words."""
        return f"poses in {self.frame!r} ({self.topic}) are brought to {self.space!r} through {', '.join(self.through)}"


@dataclass(frozen=True)
class FramePlan:
    """Which frames are the recorded space, and the ways from others to it. Names are without leading slash."""

    path: str
    spaces: tuple[str, ...] = ()  # frame ids of the recorded space; empty where no pose names one
    tree: FrameTree = field(default_factory=FrameTree)
    ways: dict[str, tuple[Step, ...]] = field(default_factory=dict)  # frame -> steps, where there are any
    uses: tuple[FrameUse, ...] = ()

    def way(self, topic: str, frame: str) -> tuple[Step, ...]:
        """Steps from a frame to the recorded space, () for the space itself and for a pose that names no frame.

        Raises LogError if there are none.
        """
        name = plain_frame(frame)
        if name not in self.ways:
            self.ways[name] = _way(self.path, self.tree, self.spaces, topic, name)
        return self.ways[name]

    @property
    def edges(self) -> set[Edge]:
        """Edges of all ways."""
        return {step.edge for way in self.ways.values() for step in way}

    @property
    def keys(self) -> set[int]:
        """Channels of the transforms that are needed."""
        return {key for edge in self.edges for key in self.tree.link(edge).keys}


def plan_frames(reader: LogReader, plan: Plan, known: Known, spaces: Sequence[str]) -> FramePlan:
    """Find the recorded space and the ways to it.

    Parameters
    ----------
    reader, plan, known
        The log, what feeds what, and what was learnt of the poses: the frames they name.
    spaces
        The frame ids that `[recording] frame` names; none: the root of the log's tree, where a pose is given in it (of
        several trees, that of the first pose in one), else the first frame that a pose names.

    Raises
    ------
    LogError
        A pose is given in a frame that does not lead to the recorded space, or a frame has two parents.
    """
    spaces = tuple(plain_frame(name) for name in spaces)
    named = list(_named(plan, known))
    path = str(reader.path)
    if not named:
        return FramePlan(path, spaces)
    if not any(c.messages and is_of_tree(c) for c in reader.channels.values()):
        return _ways(path, FrameTree(), spaces or (named[0][1],), named)
    problem: LogError | None = None
    for tree in survey(reader, {frame for _, frame in named} | set(spaces)):
        try:
            return _ways(path, tree, spaces or (_default_space(path, tree, named),), named)
        except LogError as error:
            problem = error
            if isinstance(error.__cause__, FrameError):
                break
    assert problem is not None
    raise problem


def _named(plan: Plan, known: Known) -> Iterator[tuple[PoseInput, str]]:
    """Poses and the frames they are given in, where they name one, in the order of the scene."""
    for pose in plan.poses:
        for frame in known.frames.get((pose.topic, pose.child), ()):
            if name := plain_frame(frame):
                yield pose, name


def _default_space(path: str, tree: FrameTree, named: Sequence[tuple[PoseInput, str]]) -> str:
    """Root of the tree that the first pose in a tree hangs in; without one, the first frame that is named."""
    found = next(((pose, frame) for pose, frame in named if frame in tree.frames), None)
    if found is None:
        return named[0][1]
    pose, frame = found
    try:
        way = tree.way_up(frame, "")
    except FrameError as problem:
        raise _in_tree(path, pose.topic, frame, problem) from problem
    return way[-1].parent if way else frame


def _ways(path: str, tree: FrameTree, spaces: tuple[str, ...], named: Sequence[tuple[PoseInput, str]]) -> FramePlan:
    """The plan with the ways from all the frames that poses name."""
    frames = FramePlan(path, spaces, tree)
    uses = []
    for pose, frame in named:
        if any(is_of_tree(c) for c in pose.channels):
            try:
                tree.only_parent(plain_frame(pose.child), pose.topic)
            except FrameError as problem:
                raise LogError(f"{path}: {problem}") from problem
        way = frames.way(pose.topic, frame)
        if way:
            links = [tree.link(step.edge) for step in way]
            through = tuple(dict.fromkeys(topic for link in links for topic in link.topics))
            name = f"{pose.topic}#{pose.child}" if pose.child else pose.topic
            uses.append(FrameUse(name, frame, spaces[0], through, not all(link.static for link in links)))
    return FramePlan(path, spaces, tree, frames.ways, tuple(dict.fromkeys(uses)))


def _way(path: str, tree: FrameTree, spaces: tuple[str, ...], topic: str, frame: str) -> tuple[Step, ...]:
    if not frame or not spaces or frame in spaces:
        return ()
    try:
        ways = [way for space in spaces if (way := tree.way(frame, space)) is not None]
    except FrameError as problem:
        raise _in_tree(path, topic, frame, problem) from problem
    if ways:
        return min(ways, key=len)
    space = spaces[0]
    known = f"its transforms know {listed(sorted(tree.frames))}" if tree.frames else "it has no transforms"
    both = ", ".join(f'"{plain(name)}"' for name in (*spaces, frame))
    raise LogError(
        f"{path}: topic {topic!r} gives poses in {plain(frame)!r}{similar(frame, spaces)}, and nothing in the log leads "
        f"from there to {plain(space)!r}, the recorded space ({known}): record /tf and /tf_static too, or, if both are "
        f"one space, say frame = [{both}] under [recording]"
    )


def _in_tree(path: str, topic: str, frame: str, problem: FrameError) -> LogError:
    return LogError(f"{path}: topic {topic!r} gives poses in {plain(frame)!r}: {problem}")
