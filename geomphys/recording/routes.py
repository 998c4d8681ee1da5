"""From decoded messages to streams: each channel's messages go to the roots and joints that follow its topic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from geomphys.recording.channels import Joints, Pose
from geomphys.recording.facts import Known, joint_key
from geomphys.recording.naming import add_names
from geomphys.recording.plan import JointInput, PoseInput, is_static
from geomphys.recording.streams import VALUE_LIMIT, JointStream, PoseStream

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NAME_LISTS = 256  # different lists of joint names of which the order is remembered
LONG_LIST = 10_000  # names of a list that is not worth remembering
NEVER = -(2**62)


class RootRoute:
    """Feeds the pose of one tree's root."""

    def __init__(self, source: PoseInput, known: Known, max_gap: int, *, keeps_clock: bool) -> None:
        self.input = source
        facts = known.streams[source.topic, source.child]
        constant = is_static(source.topic) or not facts.several
        self.stream = PoseStream(max_gap, constant=constant, keeps_clock=keeps_clock)
        self.stream.first = facts.value
        self.latest = NEVER
        self.out_of_order = self.furthest_back = 0
        position, orientation = source.source.position, source.source.orientation
        self.offset = tuple(float(x) for x in position)
        self.turn = tuple(float(x) for x in orientation)
        self.moved = any(x != 0 for x in self.offset)
        self.turned = self.turn != (0.0, 0.0, 0.0, 1.0)

    def add(self, time: int, pose: Pose) -> None:
        """Take in a pose."""
        if time < self.latest:
            self.out_of_order += 1
            self.furthest_back = max(self.furthest_back, self.latest - time)
        else:
            self.latest = time
        self.stream.add(time, pose.value)

    def world_from_root(self, value: Sequence[float]) -> Sequence[float]:
        """Pose of the root where the tracker has the pose `value`: world_from_tracker ∘ tracker_from_root.

        What the offset does not change is returned as it is, to the bit.
        """
        if not (self.moved or self.turned):
            return value
        px, py, pz, x, y, z, w = value
        if self.moved:
            ox, oy, oz = self.offset
            # p + v + 2 w (q x v) + 2 q x (q x v), with q the vector part of the quaternion
            cx, cy, cz = 2 * (y * oz - z * oy), 2 * (z * ox - x * oz), 2 * (x * oy - y * ox)
            px += ox + w * cx + y * cz - z * cy
            py += oy + w * cy + z * cx - x * cz
            pz += oz + w * cz + x * cy - y * cx
        if self.turned:
            a, b, c, d = self.turn
            x, y, z, w = (
                w * a + x * d + y * c - z * b,
                w * b - x * c + y * d + z * a,
                w * c + x * b - y * a + z * d,
                w * d - x * a - y * b - z * c,
            )
        return (px, py, pz, x, y, z, w)


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

    def __init__(self, source: JointInput, known: Known, max_gap: int, scale: Floats, *, keeps_clock: bool) -> None:
        """`scale` (Q,) takes recorded values to rad or m."""
        self.input = source
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
            first = fact.value[0] * scale[column] if fact.value is not None else np.nan
            if fact.several or fact.value is None:
                columns[column] = first
            else:
                self.constants[column] = first
        self.columns = np.array(sorted(columns), dtype=np.int64)
        self.place = {int(c): i for i, c in enumerate(self.columns)}
        self.scale = scale[self.columns]
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
    joints: list[JointRoute] = field(default_factory=list)
    clock: bool = False
    clock_child: str = ""  # only poses of this child, or gloves of this side, give frames
