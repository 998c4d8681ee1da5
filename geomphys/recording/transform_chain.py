"""Buffers transforms over time and composes chains of them, from a frame of reference to the recorded space (like tf2).

Interpolation follows the rules of streams, except that a frame that has not moved is known at all times.
What is static has the value of the last transform at or before a time, else of the first.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass

from geomphys.errors import LogError
from geomphys.recording.pose_tuples import IDENTITY, PoseTuple, compose, interpolate_poses, invert
from geomphys.recording.recorded_space import RecordedSpace
from geomphys.recording.streams import validated_pose
from geomphys.recording.transform_plan import TransformPlan
from geomphys.recording.transform_tree import Edge


class TransformTrack:
    """The pose of a frame in its parent over time. Times are ns; positions are in metres."""

    def __init__(self, max_gap: int, *, static: bool, first: PoseTuple | None = None) -> None:
        """`first` is the value of a static transform until a message comes."""
        self.max_gap, self.static, self.first = max_gap, static, first
        self.moved = False
        self.times: list[int] = []
        self.values: list[PoseTuple] = []  # good ones

    def add(self, time: int, value: PoseTuple) -> None:
        """Add a transform at any time; invalid ones are ignored, and of several at one time the first is used."""
        good = validated_pose(value)
        if good is None:
            return
        at = bisect_left(self.times, time)
        if at < len(self.times) and self.times[at] == time:
            return
        self.moved |= bool(self.values) and good != self.values[at - 1]
        self.times.insert(at, time)
        self.values.insert(at, good)

    def discard_before(self, time: int) -> None:
        """Discard transforms that are only needed before this time [ns]."""
        expired = bisect_right(self.times, time) - 1
        if expired > 0:
            del self.times[:expired], self.values[:expired]

    def at(self, time: int) -> PoseTuple | None:
        """parent_from_child at a time; None without a transform within `max_gap`."""
        if not self.times:
            return self.first
        next_index = bisect_right(self.times, time)
        if self.static or not self.moved:
            return self.values[max(next_index - 1, 0)]
        if next_index == 0:
            return None
        before, value = self.times[next_index - 1], self.values[next_index - 1]
        if before == time:
            return value
        if next_index == len(self.times):
            return None
        gap, other = self.times[next_index] - before, self.values[next_index]
        if value == other:
            return value
        return interpolate_poses(value, other, (time - before) / gap) if gap <= self.max_gap else None


@dataclass(frozen=True)
class ChainLink:
    """A transform on the path to the recorded space; `inverse`: from the parent to the child."""

    track: TransformTrack
    inverse: bool


class TransformChain:
    """The chain of transforms from a frame to the recorded space."""

    def __init__(self, links: tuple[ChainLink, ...]) -> None:
        self.links = links
        self.moving = not all(link.track.static for link in links)

    def at(self, time: int) -> PoseTuple | None:
        """space_from_frame at a time; None where a transform of the chain is not known."""
        result = IDENTITY
        for track, inverse in ((link.track, link.inverse) for link in self.links):
            value = track.at(time)
            if value is None:
                return None
            result = compose(invert(value) if inverse else value, result)
        return result


class TransformBuffer:
    """Transforms over time of all edges of a plan, in metres."""

    def __init__(self, plan: TransformPlan, space: RecordedSpace, max_gap: int) -> None:
        self.plan, self.space, self.max_gap = plan, space, max_gap
        self.tracks: dict[Edge, TransformTrack] = {}
        for edge in sorted(plan.edges):
            self._track(edge)

    @property
    def moving(self) -> bool:
        """Whether one of the frames may move."""
        return not all(track.static for track in self.tracks.values())

    def chain(self, topic: str, frame: str) -> TransformChain | None:
        """Chain to the recorded space from a frame of a topic's poses; None where it is that space.

        Raises LogError if there is none.
        """
        path = self.plan.steps(topic, frame)
        if any(s.edge not in self.tracks and not self.plan.tree.link(s.edge).static for s in path):
            raise LogError(
                f"{self.plan.path}: topic {topic!r} gives poses in {frame!r}, a frame that moves, only after the log's "
                "beginning, where it names another: cut the log where the frame id changes"
            )
        return TransformChain(tuple(ChainLink(self._track(s.edge), s.inverse) for s in path)) if path else None

    def discard_before(self, time: int) -> None:
        """Discard transforms that are only needed before this time [ns]."""
        for track in self.tracks.values():
            track.discard_before(time)

    def _track(self, edge: Edge) -> TransformTrack:
        if edge not in self.tracks:
            link = self.plan.tree.link(edge)
            first = None if link.first is None or not link.static else self.space.to_metres(link.first)
            self.tracks[edge] = TransformTrack(self.max_gap, static=link.static, first=first)
        return self.tracks[edge]
