"""From decoded messages to streams: each channel's messages go to the roots and joints that follow its topic."""

from __future__ import annotations

import math
from bisect import insort
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from geomphys.recording.channels import Joints, Pose, kind_of
from geomphys.recording.display_names import add_names
from geomphys.recording.input_plan import JointInput, PoseInput, is_static
from geomphys.recording.pose_tuples import Seven, compose
from geomphys.recording.space_guess import MotionSamples
from geomphys.recording.stream_prescan import Known, joint_key
from geomphys.recording.streams import VALUE_LIMIT, JointStream, PoseStream, good_pose
from geomphys.recording.transform_chain import FrameChain, FrameTrack, FrameTracks

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NAME_LISTS = 256  # different lists of joint names of which the order is remembered
LONG_LIST = 10_000  # names of a list that is not worth remembering
NEVER = -(2**62)
NO_SHIFT = -0.0  # changes no number, to the bit, not even a zero's sign
MISSING: Seven = (math.nan,) * 7


class RootRoute:
    """Feeds the pose of one tree's root: recorded poses are brought to the recorded space, and from there to the world.

    A pose that is given in a frame that moves waits until the transforms around its time are there (`settle`); where
    they never come it is a bad sample. One that is static in such a frame goes along with it.
    """

    def __init__(
        self, source: PoseInput, known: Known, tracks: FrameTracks, max_gap: int, *, keeps_clock: bool
    ) -> None:
        self.input, self.space = source, tracks.space
        space = tracks.space
        facts = known.streams[source.topic, source.child]
        self.static = is_static(source.topic)
        constant = self.static or not facts.several
        self.stream = PoseStream(max_gap, constant=constant, keeps_clock=keeps_clock)
        self.delay = round(source.source.delay * 1e9)
        self.metres = any(kind.metres for c in source.channels if (kind := kind_of(c)) is not None)
        self.latest = NEVER
        self.out_of_order = self.unplaced = self.furthest_back = 0
        self.samples = MotionSamples()
        self.tracker_from_root: Seven = (*source.source.position, *source.source.orientation)
        self._tracks = tracks
        self._chains: dict[str, FrameChain | None] = {}
        self.attached: tuple[FrameChain, Seven] | None = None  # static in a frame that moves
        self._waiting: list[tuple[int, Seven, FrameChain]] = []
        self.moving = False  # whether a frame that it is given in may move
        for frame in known.frames.get((source.topic, source.child), ()):
            chain = self.chain(frame)
            self.moving |= chain is not None and chain.moving
        if facts.value is not None and not self.moving:
            first = facts.value if self.metres else space.metres(facts.value)
            chain = self.chain(facts.frame)
            self.stream.first = first if chain is None else _placed(chain, facts.first_time + self.delay, first)

    def chain(self, frame: str) -> FrameChain | None:
        """Way from a frame to the recorded space; None where it is that space. Raises LogError if there is none."""
        if frame not in self._chains:
            self._chains[frame] = self._tracks.chain(self.input.topic, frame)
        return self._chains[frame]

    def add(self, time: int, pose: Pose) -> None:
        """Take in a pose. Raises LogError if nothing leads from its frame to the recorded space."""
        if time < self.latest:
            self.out_of_order += 1
            self.furthest_back = max(self.furthest_back, self.latest - time)
        else:
            self.latest = time
        value = pose.value if self.metres else self.space.metres(pose.value)
        chain = self.chain(pose.frame)
        if chain is None:
            self._add(time, value)
        elif not chain.moving:
            self._add_placed(chain, time, value)
        elif self.static:
            if good_pose(value) is not None:
                self.attached = (chain, value)
                self.stream.constant, self.stream.keeps_clock = False, True
        else:
            insort(self._waiting, (time, value, chain), key=lambda item: item[0])

    def settle(self, time: int, until: int) -> None:
        """Bring waiting poses up to `until` to the recorded space, and what is attached to a frame for `time`."""
        if self.attached is not None:
            chain, value = self.attached
            self._add_placed(chain, time, value)
        count = 0
        for when, value, chain in self._waiting:
            if when > until:
                break
            count += 1
            self._add_placed(chain, when, value)
        del self._waiting[:count]

    def _add_placed(self, chain: FrameChain, time: int, value: Seven) -> None:
        placed = _placed(chain, time, value)
        self.unplaced += placed is None and good_pose(value) is not None
        self._add(time, MISSING if placed is None else placed)

    def _add(self, time: int, value: Seven) -> None:
        """Take in a pose in the recorded space, in metres."""
        if abs(value[0]) + abs(value[1]) + abs(value[2]) < VALUE_LIMIT:
            self.samples.take(time, value[0], value[1], value[2])
        self.stream.add(time, value)

    def world_from_root(self, value: Seven) -> Seven:
        """Pose of the root where the tracker has the pose `value` in the recorded space.

        That is world_from_space ∘ space_from_tracker ∘ tracker_from_root; what does nothing changes nothing, to the bit.
        """
        return compose(self.space.to_world(value), self.tracker_from_root)


def _placed(chain: FrameChain, time: int, value: Seven) -> Seven | None:
    """Pose in the recorded space of one in a chain's frame; None where the chain is not known."""
    if (good := good_pose(value)) is None:
        return value
    space_from_frame = chain.at(time)
    return None if space_from_frame is None else compose(space_from_frame, good)


@dataclass
class Uneven:
    """Messages of joints that have not one value a name."""

    bare: int = 0  # no values at all
    fewer: int = 0
    more: int = 0

    def add(self, message: Joints) -> None:
        """Take in a message."""
        values, names = len(message.values), len(message.names)
        if values < names:
            self.bare, self.fewer = self.bare + (values == 0), self.fewer + (values > 0)
        else:
            self.more += 1


@dataclass
class _Order:
    """Where the values of a list of joint names go."""

    source: Ints
    target: Ints


class JointRoute:
    """Feeds the joints of one tree: those with more than one sample a stream, the others a constant."""

    def __init__(
        self, source: JointInput, known: Known, max_gap: int, prismatic: NDArray[np.bool_], *, keeps_clock: bool
    ) -> None:
        """`prismatic` (Q,) says which angles of the scene are lengths."""
        scale, shift = np.ones(len(prismatic)), np.full(len(prismatic), NO_SHIFT)
        if source.degrees:
            scale[~prismatic] = np.pi / 180
        for name, factor in source.source.factors.items():
            scale[source.source.dofs[name]] *= factor
        for name, offset in source.source.offsets.items():
            shift[source.source.dofs[name]] = offset
        self.input = source
        self.delay = round(source.source.delay * 1e9)
        facts = {
            name: known.streams[source.topic, joint_key(name, source.side)]
            for name in source.recorded_names()
            if (source.topic, joint_key(name, source.side)) in known.streams
        }
        self.constants: dict[int, float] = {}  # column -> value; one without a good sample is not here
        columns: dict[int, float] = {}  # column -> first value, NaN if there is none
        for name, fact in facts.items():
            column = source.column(name)
            assert column is not None
            first = fact.value[0] * scale[column] + shift[column] if fact.value is not None else np.nan
            if fact.several or fact.value is None:
                columns[column] = first
            else:
                self.constants[column] = first
        self.columns = np.array(sorted(columns), dtype=np.int64)
        self.place = {int(c): i for i, c in enumerate(self.columns)}
        self.scale, self.shift = scale[self.columns], shift[self.columns]
        self.stream: JointStream | None = None
        if len(self.columns):
            round_the_circle = {source.source.dofs[name] for name in source.source.continuous}
            whole = np.array([int(c) in round_the_circle for c in self.columns])
            self.stream = JointStream(len(self.columns), max_gap, keeps_clock=keeps_clock, whole=whole)
            self.stream.first = np.array([columns[int(c)] for c in self.columns])
        self.latest = NEVER
        self.out_of_order = self.furthest_back = 0
        self.names: set[str] = set()
        self.uneven = Uneven()
        self._orders: dict[tuple[str, ...], _Order] = {}

    def add(self, time: int, message: Joints) -> bool:
        """Take in a message; False if it is of the other side's glove."""
        if self.input.side and message.side != self.input.side:
            return False
        if len(message.values) != len(message.names):
            self.uneven.add(message)
        if time < self.latest:
            self.out_of_order += 1
            self.furthest_back = max(self.furthest_back, self.latest - time)
        else:
            self.latest = time
        names, sample = tuple(message.names), message.sample
        order = self._orders.get(names)
        if order is None:
            order = self._order(names)
        if self.stream is None or len(sample) == 0 or len(order.source) == 0:
            return True
        row = np.full(len(self.columns), np.nan)
        values = np.array(sample, dtype=np.float64)[order.source] * self.scale[order.target]
        values += self.shift[order.target]
        good = np.abs(values) < VALUE_LIMIT
        if good.all():
            row[order.target] = values
            self.stream.add(time, row)
            return True
        row[order.target[good]] = values[good]
        bad = np.zeros(len(self.columns), dtype=bool)
        bad[order.target[~good]] = True
        self.stream.add(time, row, bad)
        return True

    def _order(self, names: tuple[str, ...]) -> _Order:
        """Work out where values go; of a name that comes twice the first counts."""
        place: dict[int, int] = {}
        for i, name in enumerate(names):
            column = self.input.column(name)
            if column is not None and column in self.place:
                place.setdefault(self.place[column], i)
        add_names(self.names, names)
        order = _Order(np.array(list(place.values()), dtype=np.int64), np.array(list(place), dtype=np.int64))
        if len(self._orders) >= NAME_LISTS:
            self._orders.clear()
        if len(names) <= LONG_LIST:
            self._orders[names] = order
        return order


@dataclass
class Route:
    """Where the messages of one channel go."""

    roots: dict[str, list[RootRoute]] = field(default_factory=dict)  # by child frame
    tracks: dict[str, FrameTrack] = field(default_factory=dict)  # by child frame, without leading slash
    parents: dict[str, str] = field(default_factory=dict)  # the one that each of these, and of the roots, may have
    static: bool = False
    joints: list[JointRoute] = field(default_factory=list)
    clock: bool = False
    clock_delay: int = 0  # ns
    clock_child: str = ""  # only poses of this child, or gloves of this side, give frames
    others: int = 0  # poses that nothing follows
