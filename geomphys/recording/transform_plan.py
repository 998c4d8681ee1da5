"""Chooses the recorded space of a log and finds the transform paths from other frames of reference to it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from geomphys.errors import LogError
from geomphys.recording.display_names import did_you_mean, join_names, printable
from geomphys.recording.input_plan import Plan, PoseInput
from geomphys.recording.reader import LogReader
from geomphys.recording.stream_prescan import Prescan
from geomphys.recording.transform_tree import (
    Edge,
    FrameError,
    PathStep,
    TransformTree,
    is_transform_channel,
    normalized_frame_id,
    read_transform_trees,
)


@dataclass(frozen=True)
class TransformUse:
    """Poses of a topic in another frame than the recorded space, and the topics that transform them."""

    topic: str  # `topic` or `topic#child`
    frame: str
    space: str
    through: tuple[str, ...]  # topics of the transforms
    moving: bool  # whether one of the transforms changes over time

    def __str__(self) -> str:
        """In words."""
        return f"poses in {self.frame!r} ({self.topic}) are brought to {self.space!r} through {', '.join(self.through)}"


@dataclass(frozen=True)
class TransformPlan:
    """The frames that are the recorded space, and the paths from other frames to it. Frame ids have no leading slash."""

    path: str
    spaces: tuple[str, ...] = ()  # frame ids of the recorded space; empty where no pose names one
    tree: TransformTree = field(default_factory=TransformTree)
    steps_by_frame: dict[str, tuple[PathStep, ...]] = field(default_factory=dict)  # frame -> steps, where there are any
    uses: tuple[TransformUse, ...] = ()

    def steps(self, topic: str, frame: str) -> tuple[PathStep, ...]:
        """Steps from a frame to the recorded space, () for the space itself and for a pose that names no frame.

        Raises LogError if there are none.
        """
        name = normalized_frame_id(frame)
        if name not in self.steps_by_frame:
            self.steps_by_frame[name] = _find_steps(self.path, self.tree, self.spaces, topic, name)
        return self.steps_by_frame[name]

    @property
    def edges(self) -> set[Edge]:
        """Edges of all paths."""
        return {step.edge for steps in self.steps_by_frame.values() for step in steps}

    @property
    def keys(self) -> set[int]:
        """Channels of the transforms that are needed."""
        return {key for edge in self.edges for key in self.tree.link(edge).keys}


def plan_transforms(reader: LogReader, plan: Plan, prescan: Prescan, spaces: Sequence[str]) -> TransformPlan:
    """Find the recorded space and the transform paths to it.

    Parameters
    ----------
    reader, plan, known
        The log, the inputs, and the result of the prescan: the frames that poses name.
    spaces
        The frame ids that `[recording] frame` names; none: the root of the log's tree, where a pose is given in it (of
        several trees, that of the first pose in one), else the first frame that a pose names.

    Raises
    ------
    LogError
        A pose is given in a frame that does not lead to the recorded space, or a frame has two parents.
    """
    spaces = tuple(normalized_frame_id(name) for name in spaces)
    named = list(_named(plan, prescan))
    path = str(reader.path)
    if not named:
        return TransformPlan(path, spaces)
    if not any(c.messages and is_transform_channel(c) for c in reader.channels.values()):
        return _build_plan(path, TransformTree(), spaces or (named[0][1],), named)
    problem: LogError | None = None
    for tree in read_transform_trees(reader, {frame for _, frame in named} | set(spaces)):
        try:
            return _build_plan(path, tree, spaces or (_default_space(path, tree, named),), named)
        except LogError as error:
            problem = error
            if isinstance(error.__cause__, FrameError):
                break
    assert problem is not None
    raise problem


def _named(plan: Plan, prescan: Prescan) -> Iterator[tuple[PoseInput, str]]:
    """Poses with their frame ids, where they have one, in the order of the scene."""
    for pose in plan.poses:
        for frame in prescan.frame_ids.get((pose.topic, pose.child), ()):
            if name := normalized_frame_id(frame):
                yield pose, name


def _default_space(path: str, tree: TransformTree, named: Sequence[tuple[PoseInput, str]]) -> str:
    """Root of the tree of the first pose whose frame is in a tree; otherwise the first frame named."""
    found = next(((pose, frame) for pose, frame in named if frame in tree.frames), None)
    if found is None:
        return named[0][1]
    pose, frame = found
    try:
        steps = tree.path_to_root(frame, "")
    except FrameError as problem:
        raise _frame_error(path, pose.topic, frame, problem) from problem
    return steps[-1].parent if steps else frame


def _build_plan(
    path: str, tree: TransformTree, spaces: tuple[str, ...], named: Sequence[tuple[PoseInput, str]]
) -> TransformPlan:
    """The plan with the paths from all frames that poses name."""
    frames = TransformPlan(path, spaces, tree)
    uses = []
    for pose, frame in named:
        if any(is_transform_channel(c) for c in pose.channels):
            try:
                tree.parent_of(normalized_frame_id(pose.child), pose.topic)
            except FrameError as problem:
                raise LogError(f"{path}: {problem}") from problem
        steps = frames.steps(pose.topic, frame)
        if steps:
            links = [tree.link(step.edge) for step in steps]
            through = tuple(dict.fromkeys(topic for link in links for topic in link.topics))
            name = f"{pose.topic}#{pose.child}" if pose.child and not pose.is_point else pose.topic
            uses.append(TransformUse(name, frame, spaces[0], through, not all(link.static for link in links)))
    return TransformPlan(path, spaces, tree, frames.steps_by_frame, tuple(dict.fromkeys(uses)))


def _find_steps(
    path: str, tree: TransformTree, spaces: tuple[str, ...], topic: str, frame: str
) -> tuple[PathStep, ...]:
    if not frame or not spaces or frame in spaces:
        return ()
    try:
        steps_by_frame = [steps for space in spaces if (steps := tree.path(frame, space)) is not None]
    except FrameError as problem:
        raise _frame_error(path, topic, frame, problem) from problem
    if steps_by_frame:
        return min(steps_by_frame, key=len)
    space = spaces[0]
    known_frames = f"its transforms know {join_names(sorted(tree.frames))}" if tree.frames else "it has no transforms"
    frame_list = ", ".join(f'"{printable(name)}"' for name in (*spaces, frame))
    raise LogError(
        f"{path}: topic {topic!r} gives poses in {printable(frame)!r}{did_you_mean(frame, spaces)}, and nothing in the log leads "
        f"from there to {printable(space)!r}, the recorded space ({known_frames}): record /tf and /tf_static too, or, if both "
        f"are one space, say frame = [{frame_list}] under [recording]"
    )


def _frame_error(path: str, topic: str, frame: str, problem: FrameError) -> LogError:
    return LogError(f"{path}: topic {topic!r} gives poses in {printable(frame)!r}: {problem}")
