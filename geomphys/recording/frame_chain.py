"""Transforms over time: the poses of frames in other frames, and chains of them, at any time of a window that moves on.

The rules are those of streams, but for a frame that has not moved: it is known for all times, however seldom it is told.
What is static has the value of the last transform at or before a time, else of the first.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass

from geomphys.errors import LogError
from geomphys.recording.frame_plan import FramePlan
from geomphys.recording.frame_tree import Edge
from geomphys.recording.poses import IDENTITY, Seven, compose, invert
from geomphys.recording.space import RecordedSpace
from geomphys.recording.streams import blend_poses, good_pose


class FrameTrack:
    """The pose of a frame in its parent over time. Times are ns; positions are in metres."""

    def __init__(self, max_gap: int, *, static: bool, first: Seven | None = None) -> None:
        """`first` stands in for a static one until a message comes."""
        self.max_gap, self.static, self.first = max_gap, static, first
        self.moved = False
        self.times: list[int] = []
        self.values: list[Seven] = []  # good ones

    def add(self, time: int, value: Seven) -> None:
        """Take in a transform of any time; one that is not good counts as none, and of one time the first counts."""
        good = good_pose(value)
        if good is None:
            return
        at = bisect_left(self.times, time)
        if at < len(self.times) and self.times[at] == time:
            return
        self.moved |= bool(self.values) and good != self.values[at - 1]
        self.times.insert(at, time)
        self.values.insert(at, good)

    def forget(self, time: int) -> None:
        """Forget what is only needed for times before this one."""
        passed = bisect_right(self.times, time) - 1
        if passed > 0:
            del self.times[:passed], self.values[:passed]

    def at(self, time: int) -> Seven | None:
        """parent_from_child at a time; None where no transform is near enough."""
        if not self.times:
            return self.first
        after = bisect_right(self.times, time)
        if self.static or not self.moved:
            return self.values[max(after - 1, 0)]
        if after == 0:
            return None
        before, value = self.times[after - 1], self.values[after - 1]
        if before == time:
            return value
        if after == len(self.times):
            return None
        gap, other = self.times[after] - before, self.values[after]
        if value == other:
            return value
        return blend_poses(value, other, (time - before) / gap) if gap <= self.max_gap else None


@dataclass(frozen=True)
class ChainLink:
    """A frame on the way to the recorded space; `inverse`: the way leads from the parent to the child."""

    track: FrameTrack
    inverse: bool


class FrameChain:
    """The way from a frame to the recorded space."""

    def __init__(self, links: tuple[ChainLink, ...]) -> None:
        self.links = links
        self.moving = not all(link.track.static for link in links)

    def at(self, time: int) -> Seven | None:
        """space_from_frame at a time; None where a transform of the way is not known."""
        result = IDENTITY
        for track, inverse in ((link.track, link.inverse) for link in self.links):
            value = track.at(time)
            if value is None:
                return None
            result = compose(invert(value) if inverse else value, result)
        return result


class FrameTracks:
    """Transforms of all the frames on the ways of a plan, in metres."""

    def __init__(self, plan: FramePlan, space: RecordedSpace, max_gap: int) -> None:
        self.plan, self.space, self.max_gap = plan, space, max_gap
        self.tracks: dict[Edge, FrameTrack] = {}
        for edge in sorted(plan.edges):
            self._track(edge)

    @property
    def moving(self) -> bool:
        """Whether one of the frames may move."""
        return not all(track.static for track in self.tracks.values())

    def chain(self, topic: str, frame: str) -> FrameChain | None:
        """Way to the recorded space from a frame of a topic's poses; None where it is that space.

        Raises LogError if there is none.
        """
        way = self.plan.way(topic, frame)
        if any(s.edge not in self.tracks and not self.plan.tree.link(s.edge).static for s in way):
            raise LogError(
                f"{self.plan.path}: topic {topic!r} gives poses in {frame!r}, a frame that moves, only after the log's "
                "beginning, where it names another: cut the log where the frame id changes"
            )
        return FrameChain(tuple(ChainLink(self._track(s.edge), s.inverse) for s in way)) if way else None

    def forget(self, time: int) -> None:
        """Forget what is only needed for times before this one."""
        for track in self.tracks.values():
            track.forget(time)

    def _track(self, edge: Edge) -> FrameTrack:
        if edge not in self.tracks:
            link = self.plan.tree.link(edge)
            first = None if link.first is None or not link.static else self.space.metres(link.first)
            self.tracks[edge] = FrameTrack(self.max_gap, static=link.static, first=first)
        return self.tracks[edge]
