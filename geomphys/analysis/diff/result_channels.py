"""Compares the channels of results: contacts and penetrations as sets of pairs, metrics, and log lines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from geomphys.analysis.diff.channels import ChannelDifference, SetDifference, Tolerance, earliest
from geomphys.analysis.diff.measures import DifferenceTable
from geomphys.output.decoders import METRICS, ContactRow, PenetrationRow
from geomphys.output.output_log import OutputFrame

Floats = NDArray[np.float64]
Pair = tuple[str, str]


class ContactChannel:
    """``/contacts`` as a set of pairs of bodies; of common pairs, the distances of points and depths.

    The distance of two sets of points is the largest distance of a point to the nearest of the other set.
    """

    def __init__(self, tolerance: Tolerance) -> None:
        self._tolerance = tolerance
        self._metres, self._impulses = DifferenceTable(tolerance.m), DifferenceTable(0.0)
        self._sets = PairSets()
        self.changed = 0  # pairs gained and lost in the last frame

    def add(self, a: OutputFrame, b: OutputFrame) -> float:
        """See `Channel.add`."""
        self.changed = 0
        if a.contacts == b.contacts:
            pairs = dict.fromkeys(_name(row.body_a, row.body_b) for row in a.contacts)
            for table in (self._metres, self._impulses):
                table.add(table.rows(list(pairs)), np.zeros(len(pairs)), a.index)
            return 0.0
        one, other = by_pair(a.contacts), by_pair(b.contacts)
        largest = 0.0
        for pair in sorted(one.keys() | other.keys()):
            in_a, in_b = one.get(pair), other.get(pair)
            if in_a is None or in_b is None:
                self._sets.add(pair, gained=in_a is None, frame=a.index)
                self.changed += 1
                continue
            distance = max(point_set_distance(in_a, in_b), abs(max(r.depth for r in in_a) - max(r.depth for r in in_b)))
            name = _name(*pair)
            self._metres.add(self._metres.rows([name]), np.array([distance]), a.index)
            impulse = abs(sum(r.normal_impulse for r in in_a) - sum(r.normal_impulse for r in in_b))
            self._impulses.add(self._impulses.rows([name]), np.array([impulse]), a.index)
            largest = max(largest, distance)
        return largest

    def result(self) -> ChannelDifference:
        """See `Channel.result`."""
        metres, impulses = self._metres.overall(), self._impulses.overall()
        first = metres.first_frame
        if self._tolerance.exact:
            first = earliest(first, self._sets.first, impulses.first_frame)
        return ChannelDifference(
            channel="/contacts",
            kind="pairs",
            equal=first is None,
            first_frame=first,
            metres=self._metres.each(),
            others=self._impulses.each(),
            overall_m=metres,
            sets=self._sets.each(),
        )


class PenetrationChannel:
    """``/penetration``: pairs gained and lost, and the length of the difference of PD_g, m."""

    def __init__(self, tolerance: Tolerance) -> None:
        self._tolerance = tolerance
        self._metres = DifferenceTable(tolerance.m)
        self._sets = PairSets()

    def add(self, a: OutputFrame, b: OutputFrame) -> float:
        """See `Channel.add`."""
        if a.penetrations == b.penetrations:
            pairs = dict.fromkeys(_name(row.body_a, row.body_b) for row in a.penetrations)
            self._metres.add(self._metres.rows(list(pairs)), np.zeros(len(pairs)), a.index)
            return 0.0
        one, other = _depths(a.penetrations), _depths(b.penetrations)
        largest = 0.0
        for pair in sorted(one.keys() | other.keys()):
            in_a, in_b = one.get(pair), other.get(pair)
            if in_a is None or in_b is None:
                self._sets.add(pair, gained=in_a is None, frame=a.index)
                continue
            distance = max(float(np.linalg.norm(in_a[0] - in_b[0])), abs(in_a[1] - in_b[1]))
            self._metres.add(self._metres.rows([_name(*pair)]), np.array([distance]), a.index)
            largest = max(largest, distance)
        return largest

    def result(self) -> ChannelDifference:
        """See `Channel.result`."""
        metres = self._metres.overall()
        first = earliest(metres.first_frame, self._sets.first if self._tolerance.exact else None)
        return ChannelDifference(
            channel="/penetration",
            kind="pairs",
            equal=first is None,
            first_frame=first,
            metres=self._metres.each(),
            overall_m=metres,
            sets=self._sets.each(),
        )


class MetricsChannel:
    """``/metrics``: every field of a frame."""

    def __init__(self, tolerance: Tolerance) -> None:
        self._tolerance = tolerance
        self._tables = (DifferenceTable(tolerance.m), DifferenceTable(tolerance.rad), DifferenceTable(0.0))
        names: tuple[list[str], list[str], list[str]] = ([], [], [])
        for name in METRICS:
            if name != "frame":
                names[0 if name.endswith("_m") else 1 if name.endswith("_rad") else 2].append(name)
        self._names = names
        self._rows = tuple(table.rows(part) for table, part in zip(self._tables, names, strict=True))

    def add(self, a: OutputFrame, b: OutputFrame) -> float:
        """See `Channel.add`; returns 0, as its lengths repeat those of other channels."""
        for table, names, rows in zip(self._tables, self._names, self._rows, strict=True):
            values = np.array([abs(float(a.metrics.get(n, 0)) - float(b.metrics.get(n, 0))) for n in names])
            table.add(rows, values, a.index)
        return 0.0

    def result(self) -> ChannelDifference:
        """See `Channel.result`."""
        metres, radians, others = self._tables
        first_frames = [metres.overall().first_frame, radians.overall().first_frame]
        if self._tolerance.exact:
            first_frames.append(others.overall().first_frame)
        first = earliest(*first_frames)
        return ChannelDifference(
            channel="/metrics",
            kind="fields",
            equal=first is None,
            first_frame=first,
            metres=metres.each(),
            radians=radians.each(),
            others=others.each(),
            overall_m=metres.overall(),
            overall_rad=radians.overall(),
        )


class LogChannel:
    """``/log``: lines gained and lost."""

    def __init__(self, tolerance: Tolerance) -> None:
        self._tolerance = tolerance
        self._gained = self._lost = 0
        self._first: int | None = None

    def add(self, a: OutputFrame, b: OutputFrame) -> float:
        """See `Channel.add`."""
        if a.log != b.log:
            gained, lost = set(b.log) - set(a.log), set(a.log) - set(b.log)
            self._gained += len(gained)
            self._lost += len(lost)
            self._first = a.index if self._first is None else self._first
        return 0.0

    def result(self) -> ChannelDifference:
        """See `Channel.result`."""
        sets = SetDifference(gained=self._gained, lost=self._lost, first_frame=self._first)
        return ChannelDifference(
            channel="/log",
            kind="lines",
            equal=self._first is None or not self._tolerance.exact,
            first_frame=self._first,
            sets={"lines": sets} if self._first is not None else {},
        )


class PairSets:
    """Pairs gained and lost, counted by pair."""

    def __init__(self) -> None:
        self._pairs: dict[Pair, SetDifference] = {}
        self.first: int | None = None
        """First frame of any."""

    def add(self, pair: Pair, *, gained: bool, frame: int) -> None:
        """Count a pair that only one output has."""
        old = self._pairs.get(pair, SetDifference(first_frame=frame))
        self._pairs[pair] = SetDifference(
            gained=old.gained + gained, lost=old.lost + (not gained), first_frame=old.first_frame
        )
        self.first = frame if self.first is None else self.first

    def each(self) -> dict[str, SetDifference]:
        """Name of a pair -> its counts."""
        return {_name(*pair): self._pairs[pair] for pair in sorted(self._pairs)}


def by_pair(rows: Sequence[ContactRow]) -> dict[Pair, list[ContactRow]]:
    """Contacts by their bodies, whichever of the two comes first."""
    found: dict[Pair, list[ContactRow]] = {}
    for row in rows:
        pair = (row.body_a, row.body_b) if row.body_a <= row.body_b else (row.body_b, row.body_a)
        found.setdefault(pair, []).append(row)
    return found


def point_set_distance(a: Sequence[ContactRow], b: Sequence[ContactRow]) -> float:
    """Hausdorff distance of two sets of contact points, m."""
    one, other = np.array([row.point for row in a]), np.array([row.point for row in b])
    distances = np.linalg.norm(one[:, None] - other[None], axis=2)
    return float(max(distances.min(axis=1).max(), distances.min(axis=0).max()))


def _depths(rows: Sequence[PenetrationRow]) -> dict[Pair, tuple[Floats, float]]:
    """Pair -> PD_g of the body that comes first by name, and the deepest pair of pieces."""
    found: dict[Pair, tuple[Floats, float]] = {}
    for row in rows:
        pd = np.array(row.pd)
        if row.body_a <= row.body_b:
            found[row.body_a, row.body_b] = (pd, row.largest)
        else:
            found[row.body_b, row.body_a] = (-pd, row.largest)
    return found


def _name(a: str, b: str) -> str:
    """What a pair of bodies is called, whichever comes first."""
    return f"{min(a, b)} | {max(a, b)}"
