"""The transform (tf) tree of a log: parents of each frame of reference, and paths between frames."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from geomphys.errors import LogError
from geomphys.recording.channels import kind_of, make_message_reader
from geomphys.recording.decoders import BadMessageError
from geomphys.recording.display_names import printable
from geomphys.recording.input_plan import is_static
from geomphys.recording.message_kinds import canonical_type_name
from geomphys.recording.pose_tuples import PoseTuple
from geomphys.recording.reader import LogChannel, LogReader
from geomphys.recording.samples import Content, JointSample
from geomphys.recording.streams import validated_pose

TRANSFORM_TYPES = (
    "tf2_msgs/msg/TFMessage",
    "tf/msg/tfMessage",
    "geometry_msgs/msg/TransformStamped",
    "foxglove.FrameTransform",
    "foxglove.FrameTransforms",
    "foxglove_msgs/msg/FrameTransform",
    "foxglove_msgs/msg/FrameTransforms",
)
"""Message types that make up the tree. Other poses have a frame id too, but their child is no frame of reference."""
TREE_SCAN_NS = 10 * 10**9
"""ns of a log that are read for its tree; more only if a required frame has not occurred by then."""
MAX_FRAMES = 10_000
"""Maximum number of frames in a tree."""
MAX_STEPS = 200
"""Maximum number of edges from a frame to an ancestor: every pose is taken through all of them."""


class Edge(NamedTuple):
    """Child frame and the frame that it is given in."""

    parent: str
    child: str


class PathStep(NamedTuple):
    """An edge on the path from one frame to another; `inverse`: from the parent to the child."""

    edge: Edge
    inverse: bool


@dataclass
class Link:
    """The source of an edge: topics, channels, static or not."""

    topics: list[str] = field(default_factory=list)  # without repeats
    keys: set[int] = field(default_factory=set)  # of channels
    static: bool = True  # from static transforms only
    first: PoseTuple | None = None  # its first good transform, parent_from_child, as recorded


class FrameError(Exception):
    """The reason why one frame cannot be transformed to another."""


@dataclass
class TransformTree:
    """Frames by name, without a leading slash."""

    parents: dict[str, dict[str, Link]] = field(default_factory=dict)  # child -> parent -> link
    frames: set[str] = field(default_factory=set)  # all of them

    def add(self, parent: str, child: str, channel: LogChannel, value: PoseTuple) -> None:
        """Add a transform."""
        if not parent or not child or parent == child or len(self.parents) >= MAX_FRAMES:
            return
        link = self.parents.setdefault(child, {}).setdefault(parent, Link())
        self.frames.update((parent, child))
        if channel.topic not in link.topics:
            link.topics.append(channel.topic)
        link.keys.add(channel.key)
        link.static &= is_static(channel.topic)
        if link.first is None:
            link.first = validated_pose(value)

    @property
    def roots(self) -> list[str]:
        """Frames without a parent, sorted."""
        return sorted(self.frames - set(self.parents))

    def link(self, edge: Edge) -> Link:
        """The source of an edge: topics, channels, static or not."""
        return self.parents[edge.child][edge.parent]

    def parent_of(self, frame: str, topic: str | None = None) -> str | None:
        """Parent of a frame, None for a root; with `topic`, by that topic alone.

        Raises FrameError if it has two.
        """
        links = self.parents.get(frame, {}).items()
        found = [(name, link.topics[0]) for name, link in links if topic is None or topic in link.topics]
        if len(found) > 1:
            (a, one), (b, other), *_ = found
            raise FrameError(two_parents_message(frame, a, topic or one, b, topic or other))
        return found[0][0] if found else None

    def path_to_root(self, frame: str, scan_end: str) -> list[Edge]:
        """Edges from a frame up to an ancestor, or to its root.

        Raises FrameError if a frame on the path has two parents, or if the path is a cycle or longer than `MAX_STEPS`.
        """
        edges: list[Edge] = []
        passed: set[str] = set()
        while frame != scan_end and (parent := self.parent_of(frame)) is not None:
            edges.append(Edge(parent, frame))
            passed.add(frame)
            if parent in passed:
                names = ", ".join(repr(printable(e.child)) for e in edges)
                raise FrameError(f"the frames {names} are given in one another, in a circle")
            if len(edges) > MAX_STEPS:
                first = printable(edges[0].child)
                raise FrameError(f"the frame {first!r} lies more than {MAX_STEPS} transforms below its root")
            frame = parent
        return edges

    def path(self, frame: str, space: str) -> tuple[PathStep, ...] | None:
        """Steps from a frame to the space; None if there are none.

        Raises FrameError as `path_to_root`.
        """
        up = self.path_to_root(frame, space)
        reached = [frame, *(e.parent for e in up)]
        if reached[-1] == space:
            return tuple(PathStep(e, False) for e in up)
        down: list[Edge] = []
        for edge in self.path_to_root(space, frame):
            down.append(edge)
            if edge.parent in reached:
                ascent = up[: reached.index(edge.parent)]
                return (*(PathStep(e, False) for e in ascent), *(PathStep(e, True) for e in reversed(down)))
        return None


def two_parents_message(frame: str, a: str, a_topic: str, b: str, b_topic: str) -> str:
    """The message on a frame with two parents."""
    return (
        f"the frame {printable(frame)!r} has two parents, {printable(a)!r} (topic {printable(a_topic)!r}) and {printable(b)!r} "
        f"(topic {printable(b_topic)!r}), and a frame can have one: leave one of the two publishers out of the log"
    )


def normalized_frame_id(name: str) -> str:
    """Normalise a frame id: strips spaces and the leading slash of tf1 (``/world`` is ``world``)."""
    return name.strip().lstrip("/")


def is_transform_channel(channel: LogChannel) -> bool:
    """Whether a channel's messages are transforms from frame to frame."""
    return canonical_type_name(channel.schema_name) in TRANSFORM_TYPES and kind_of(channel) is not None


def read_transform_trees(reader: LogReader, names: Iterable[str]) -> Iterator[TransformTree]:
    """Read a log's tree; `names` are required frames.

    Yields what the first `TREE_SCAN_NS` ns of the log and the first message of every topic tell, with what speaks of the
    names, which may come at any time; then, if iterated further, the tree of the whole log.
    """
    tree = TransformTree()
    channels = {c.key: c for c in reader.channels.values() if c.messages and is_transform_channel(c)}
    readers = {key: read for key, c in channels.items() if (read := _reader(c)) is not None}
    unread_topics, missing = set(readers), set(names)
    scan_end = reader.start_ns + TREE_SCAN_NS
    for read_all in (False, True):
        for raw in reader.read(set(readers)):
            if not read_all and raw.log_time > scan_end and raw.key not in unread_topics:
                if not unread_topics and not missing:
                    break
                if not any(name.encode() in raw.data or not name.isascii() for name in missing):
                    continue
            unread_topics.discard(raw.key)
            _add_message(tree, channels[raw.key], readers[raw.key], raw.data)
            missing = missing - tree.frames  # goes through the few that are missing
        yield tree


def _add_message(tree: TransformTree, channel: LogChannel, read: Callable[[bytes], Content], data: bytes) -> None:
    """Add the transforms of a message to the tree."""
    try:
        content = read(data)
    except BadMessageError:
        return
    if not isinstance(content, JointSample):
        for pose in content:
            tree.add(normalized_frame_id(pose.frame), normalized_frame_id(pose.child), channel, pose.value)


def _reader(channel: LogChannel) -> Callable[[bytes], Content] | None:
    """Make the reader of a channel; None where its schema cannot be read (reported for the inputs that use it)."""
    kind = kind_of(channel)
    try:
        return None if kind is None else make_message_reader(channel, kind)
    except LogError:
        return None
