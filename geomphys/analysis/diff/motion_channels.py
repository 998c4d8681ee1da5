"""Compares the motion channels: poses of bodies and values of joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from geomphys.analysis.diff.channels import ChannelDifference, Tolerance, earliest
from geomphys.analysis.diff.measures import DifferenceTable
from geomphys.numerics.transforms import angle_between
from geomphys.output.decoders import Poses
from geomphys.output.output_log import OutputFrame

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class PoseChannel:
    """``/tf`` or ``/recorded/tf``: distance of the origins [m] and angle between the orientations [rad]."""

    def __init__(self, channel: str, tolerance: Tolerance, first_a: OutputFrame, first_b: OutputFrame) -> None:
        self._channel, self._first = channel, (first_a, first_b)
        self._metres, self._radians = DifferenceTable(tolerance.m), DifferenceTable(tolerance.rad)
        self._layout: tuple[tuple[str, ...], tuple[str, ...], Ints, Ints, Ints] | None = None
        self._names: tuple[set[str], set[str]] = (set(), set())
        self.differences: Floats = np.zeros(0)  # m, of the last frame
        self.compared: tuple[str, ...] = ()  # names of `differences`
        self.angle = 0.0  # largest angle of the last frame, rad

    def add(self, a: OutputFrame, b: OutputFrame) -> float:
        """See `Channel.add`."""
        return self._add(self._poses(a), self._poses(b), a.index)

    def result(self) -> ChannelDifference:
        """See `Channel.result`. Bodies that only the first frames have are compared between these."""
        a, b = (self._poses(frame) for frame in self._first)
        all_names = (self._names[0] | set(a.names), self._names[1] | set(b.names))
        remaining = [name for name in a.names if name in b.names and not self._metres.has(name)]
        if remaining:
            self._add(_subset(a, remaining), _subset(b, remaining), self._first[0].index)
        metres, radians = self._metres.overall(), self._radians.overall()
        only_a, only_b = tuple(sorted(all_names[0] - all_names[1])), tuple(sorted(all_names[1] - all_names[0]))
        first = earliest(metres.first_frame, radians.first_frame)
        if only_a or only_b:
            first = self._first[0].index
        return ChannelDifference(
            channel=self._channel,
            kind="bodies",
            equal=first is None,
            first_frame=first,
            metres=self._metres.each(),
            radians=self._radians.each(),
            overall_m=metres,
            overall_rad=radians,
            only_a=only_a,
            only_b=only_b,
        )

    def _poses(self, frame: OutputFrame) -> Poses:
        return frame.tf if self._channel == "/tf" else frame.recorded

    def _add(self, a: Poses, b: Poses, frame: int) -> float:
        layout = self._layout
        if layout is None or layout[0] != a.names or layout[1] != b.names:
            layout = self._layout = self._match(a.names, b.names)
        _, _, rows_a, rows_b, rows = layout
        values_a, values_b = a.values[rows_a], b.values[rows_b]
        if np.array_equal(values_a, values_b):
            self.differences = radians = np.zeros(len(rows))
        else:
            self.differences = np.linalg.norm(values_a[:, :3] - values_b[:, :3], axis=1)
            radians = angle_between(values_a[:, 3:], values_b[:, 3:])
        self.angle = float(radians.max(initial=0.0))
        self._metres.add(rows, self.differences, frame)
        self._radians.add(rows, radians, frame)
        return float(self.differences.max(initial=0.0))

    def _match(
        self, a: tuple[str, ...], b: tuple[str, ...]
    ) -> tuple[tuple[str, ...], tuple[str, ...], Ints, Ints, Ints]:
        self._names[0].update(a)
        self._names[1].update(b)
        row_of = {name: row for row, name in enumerate(b)}
        self.compared = tuple(name for name in a if name in row_of)
        rows_a = np.array([row for row, name in enumerate(a) if name in row_of], np.int64)
        rows_b = np.array([row_of[name] for name in self.compared], np.int64)
        self._radians.rows(self.compared)
        return a, b, rows_a, rows_b, self._metres.rows(self.compared)


class JointChannel:
    """Joint values of one topic; `sliding` names the joints whose values are lengths, `continuous` those without limits.

    Values of the latter are compared modulo 2 pi, unless everything has to be equal bit for bit.
    """

    def __init__(
        self, topic: str, tolerance: Tolerance, sliding: frozenset[str], continuous: frozenset[str] = frozenset()
    ) -> None:
        self._topic, self._sliding = topic, sliding
        self._continuous = frozenset[str]() if tolerance.exact else continuous
        self._metres, self._radians = DifferenceTable(tolerance.m), DifferenceTable(tolerance.rad)
        self._only: tuple[set[str], set[str]] = (set(), set())
        self._first_only: int | None = None
        self._layout: tuple[tuple[str, ...], tuple[str, ...]] | None = None
        self.angle = 0.0  # largest difference of an angle in the last frame, rad
        self._rows: tuple[Ints, Ints, NDArray[np.bool_], Ints, Ints]
        self._is_continuous: NDArray[np.bool_]

    def add(self, a: OutputFrame, b: OutputFrame) -> float:
        """See `Channel.add`."""
        self.angle = 0.0
        values_a, values_b = a.joints.get(self._topic), b.joints.get(self._topic)
        if values_a is None or values_b is None:
            if values_a is not values_b:
                self._first_only = self._first_only if self._first_only is not None else a.index
                present = values_a or values_b
                assert present is not None
                self._only[0 if values_b is None else 1].update(present.names)
            return 0.0
        if self._layout != (values_a.names, values_b.names):
            self._layout = (values_a.names, values_b.names)
            self._match(values_a.names, values_b.names, a.index)
        rows_a, rows_b, is_sliding, metres, radians = self._rows
        difference = np.abs(values_a.values[rows_a] - values_b.values[rows_b])
        if self._is_continuous.any():
            remaining = np.remainder(difference, 2 * np.pi)
            difference = np.where(self._is_continuous, np.minimum(remaining, 2 * np.pi - remaining), difference)
        self._metres.add(metres, difference[is_sliding], a.index)
        self._radians.add(radians, difference[~is_sliding], a.index)
        self.angle = float(difference[~is_sliding].max(initial=0.0))
        return float(difference[is_sliding].max(initial=0.0))

    def result(self) -> ChannelDifference:
        """See `Channel.result`."""
        metres, radians = self._metres.overall(), self._radians.overall()
        first = earliest(metres.first_frame, radians.first_frame, self._first_only)
        return ChannelDifference(
            channel=self._topic,
            kind="joints",
            equal=first is None,
            first_frame=first,
            metres=self._metres.each(),
            radians=self._radians.each(),
            overall_m=metres if self._metres.each() else None,
            overall_rad=radians,
            only_a=tuple(sorted(self._only[0])),
            only_b=tuple(sorted(self._only[1])),
        )

    def _match(self, a: tuple[str, ...], b: tuple[str, ...], frame: int) -> None:
        row_of = {name: row for row, name in enumerate(b)}
        common = [name for name in a if name in row_of]
        self._only[0].update(set(a) - set(b))
        self._only[1].update(set(b) - set(a))
        if set(a) != set(b) and self._first_only is None:
            self._first_only = frame
        self._is_continuous = np.array([name in self._continuous for name in common], bool)
        self._rows = (
            np.array([row for row, name in enumerate(a) if name in row_of], np.int64),
            np.array([row_of[name] for name in common], np.int64),
            np.array([name in self._sliding for name in common], bool),
            self._metres.rows([name for name in common if name in self._sliding]),
            self._radians.rows([name for name in common if name not in self._sliding]),
        )


def _subset(poses: Poses, names: Sequence[str]) -> Poses:
    rows = [poses.names.index(name) for name in names]
    return Poses(tuple(names), poses.values[rows])
