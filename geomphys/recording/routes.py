"""Routes decoded messages to streams: each channel feeds the roots and joints that follow its topic."""

from __future__ import annotations

import math
from bisect import insort
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geomphys.recording.channels import JointSample, Pose, kind_of
from geomphys.recording.display_names import add_names
from geomphys.recording.input_plan import JointInput, PoseInput, is_static
from geomphys.recording.pose_tuples import PoseTuple, compose
from geomphys.recording.space_guess import MotionSamples
from geomphys.recording.stamps import NEVER
from geomphys.recording.stream_prescan import Prescan, joint_key
from geomphys.recording.streams import UNIT_NORM_TOLERANCE, VALUE_LIMIT, JointStream, PoseStream, validated_pose
from geomphys.recording.transform_chain import TransformBuffer, TransformChain, TransformTrack

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MAX_COLUMN_MAPS = 256  # cached column maps, one per list of joint names
MAX_CACHED_NAMES = 10_000  # longer lists of names are not cached
NO_OFFSET = -0.0  # adding it changes no float, not even the sign of a zero
MISSING: PoseTuple = (math.nan,) * 7


class RootRoute:
    """Feeds the pose of one tree's root: recorded poses are transformed to the recorded space and to the world.

    A pose that is given in a frame that moves waits until the transforms around its time are there (`resolve`); where
    they never come it is a bad sample. One that is static in such a frame goes along with it.
    """

    def __init__(
        self, source: PoseInput, prescan: Prescan, tracks: TransformBuffer, max_gap: int, *, holds_bad_samples: bool
    ) -> None:
        self.input, self.space = source, tracks.space
        space = tracks.space
        infos = prescan.streams[source.topic, source.child]
        self.static = is_static(source.topic)
        constant = self.static or not infos.varies
        self.stream = PoseStream(max_gap, constant=constant, holds_bad_samples=holds_bad_samples)
        self.delay = round(source.source.delay * 1e9)
        self.is_metric = any(kind.in_metres for c in source.channels if (kind := kind_of(c)) is not None)
        self.latest = NEVER
        self.out_of_order = self.untransformed = self.max_disorder = 0
        self.samples = MotionSamples()
        self.tracker_from_root: PoseTuple = (*source.source.position, *source.source.orientation)
        self._tracks = tracks
        self._chains: dict[str, TransformChain | None] = {}
        self.attached: tuple[TransformChain, PoseTuple] | None = None  # a static pose in a moving frame
        self._pending: list[tuple[int, PoseTuple, TransformChain]] = []
        self.moving = False  # whether a frame it is given in moves
        for frame in prescan.frame_ids.get((source.topic, source.child), ()):
            chain = self.chain(frame)
            self.moving |= chain is not None and chain.moving
        if infos.value is not None and not self.moving:
            first = infos.value if self.is_metric else space.to_metres(infos.value)
            chain = self.chain(infos.frame)
            self.stream.first = first if chain is None else _to_space(chain, infos.first_time + self.delay, first)

    def chain(self, frame: str) -> TransformChain | None:
        """Transform chain from a frame to the recorded space; None where it is that space. Raises LogError if there is none."""
        if frame not in self._chains:
            self._chains[frame] = self._tracks.chain(self.input.topic, frame)
        return self._chains[frame]

    def add(self, time: int, pose: Pose) -> None:
        """Add a pose. Raises LogError if nothing leads from its frame to the recorded space."""
        if time < self.latest:
            self.out_of_order += 1
            self.max_disorder = max(self.max_disorder, self.latest - time)
        else:
            self.latest = time
        value = pose.value if self.is_metric else self.space.to_metres(pose.value)
        chain = self.chain(pose.frame)
        if chain is None:
            self._add(time, value)
        elif not chain.moving:
            self._add_transformed(chain, time, value)
        elif self.static:
            if validated_pose(value) is not None:
                self.attached = (chain, value)
                self.stream.constant, self.stream.holds_bad_samples = False, True
        else:
            insort(self._pending, (time, value, chain), key=lambda item: item[0])

    def plain_values(self, time: int, values: Floats, frame: str) -> Floats | None:
        """Poses (n, 7) in a frame, the first at a time [ns], in metres; None unless they are good, and go on in that space."""
        if (
            self.static
            or self._chains.get(frame, self) is not None
            or time <= self.latest
            or not self.stream.goes_on(time)
        ):
            return None
        if not self.is_metric and self.space.units_per_metre != 1.0:
            values = np.concatenate([values[:, :3] / self.space.units_per_metre, values[:, 3:]], axis=1)
        return values if _are_valid(values) else None

    def extend(self, times: list[int], values: Floats) -> None:
        """Add poses of increasing times that are `plain_values`."""
        self.latest, poses = times[-1], list(map(tuple, values.tolist()))
        self.samples.extend(times, values[:, :3])
        self.stream.extend(times, poses)

    def resolve(self, time: int, until: int) -> None:
        """Transform pending poses up to `until` [ns] to the recorded space, and an attached static pose at `time`."""
        if self.attached is not None:
            chain, value = self.attached
            self._add_transformed(chain, time, value)
        count = 0
        for sample_time, value, chain in self._pending:
            if sample_time > until:
                break
            count += 1
            self._add_transformed(chain, sample_time, value)
        del self._pending[:count]

    def _add_transformed(self, chain: TransformChain, time: int, value: PoseTuple) -> None:
        transformed = _to_space(chain, time, value)
        self.untransformed += transformed is None and validated_pose(value) is not None
        self._add(time, MISSING if transformed is None else transformed)

    def _add(self, time: int, value: PoseTuple) -> None:
        """Add a pose in the recorded space, in metres."""
        if abs(value[0]) + abs(value[1]) + abs(value[2]) < VALUE_LIMIT:
            self.samples.add(time, value[0], value[1], value[2])
        self.stream.add(time, value)

    def world_from_root(self, value: PoseTuple) -> PoseTuple:
        """Pose of the root where the tracker has the pose `value` in the recorded space.

        That is world_from_space ∘ space_from_tracker ∘ tracker_from_root; identity parts change nothing, to the bit.
        """
        return compose(self.space.to_world(value), self.tracker_from_root)

    def world_from_roots(self, values: Sequence[PoseTuple]) -> Floats:
        """`world_from_root` of many poses, (n, 7)."""
        return _compose_all(np.array([self.space.to_world(value) for value in values]), self.tracker_from_root)


def _compose_all(poses: Floats, b_from_c: PoseTuple) -> Floats:
    """`compose` of poses (n, 7) with one, to the bit."""
    columns: tuple[Any, ...] = tuple(poses.T)
    return np.stack(compose(columns, b_from_c), axis=1)


def _to_space(chain: TransformChain, time: int, value: PoseTuple) -> PoseTuple | None:
    """Transform a pose from a chain's frame to the recorded space; None where the chain is not known."""
    if (good := validated_pose(value)) is None:
        return value
    space_from_frame = chain.at(time)
    return None if space_from_frame is None else compose(space_from_frame, good)


def _are_valid(values: Floats) -> bool:
    """Whether `validated_pose` would return all of the poses (n, 7) as they are."""
    x, y, z, a, b, c, d = values.T
    with np.errstate(all="ignore"):
        norm = np.sqrt(a * a + b * b + c * c + d * d)
        good = (np.abs(norm - 1) <= UNIT_NORM_TOLERANCE) & (np.abs(x) + np.abs(y) + np.abs(z) < VALUE_LIMIT)
    return bool(good.all())


@dataclass
class LengthMismatches:
    """Counts of joint messages with unequal numbers of names and values."""

    empty: int = 0  # without values
    shorter: int = 0
    longer: int = 0

    def add(self, message: JointSample) -> None:
        """Add a message."""
        values, names = len(message.values), len(message.names)
        if values < names:
            self.empty, self.shorter = self.empty + (values == 0), self.shorter + (values > 0)
        else:
            self.longer += 1


@dataclass
class _ColumnMap:
    """Indices of message values and of the stream's columns they are written to."""

    source: Ints
    target: Ints
    is_whole: bool  # every column is written
    takes_all: bool  # from the first value on, in their order


class JointRoute:
    """Feeds the joints of one tree: a stream for joints with several samples, constants for the others."""

    def __init__(
        self,
        source: JointInput,
        prescan: Prescan,
        max_gap: int,
        prismatic: NDArray[np.bool_],
        *,
        holds_bad_samples: bool,
    ) -> None:
        """`prismatic` (Q,) marks degrees of freedom that are lengths."""
        scale, offsets = np.ones(len(prismatic)), np.full(len(prismatic), NO_OFFSET)
        if source.degrees:
            scale[~prismatic] = np.pi / 180
        for name, factor in source.source.factors.items():
            scale[source.source.dofs[name]] *= factor
        for name, offset in source.source.offsets.items():
            offsets[source.source.dofs[name]] = offset
        self.input = source
        self.delay = round(source.source.delay * 1e9)
        infos = {
            name: prescan.streams[source.topic, joint_key(name, source.side)]
            for name in source.recorded_names()
            if (source.topic, joint_key(name, source.side)) in prescan.streams
        }
        self.constants: dict[int, float] = {}  # column -> value
        columns: dict[int, float] = {}  # column -> first value, NaN if there is none
        for name, info in infos.items():
            column = source.column(name)
            assert column is not None
            first = info.value[0] * scale[column] + offsets[column] if info.value is not None else np.nan
            if info.varies or info.value is None:
                columns[column] = first
            else:
                self.constants[column] = first
        self.columns = np.array(sorted(columns), dtype=np.int64)
        self.target: Ints | slice = self.columns  # the same, as a slice where they are next to each other
        if len(self.columns) and self.columns[-1] - self.columns[0] == len(self.columns) - 1:
            self.target = slice(int(self.columns[0]), int(self.columns[-1]) + 1)
        self.index_of_column = {int(c): i for i, c in enumerate(self.columns)}
        self.scale, self.offsets = scale[self.columns], offsets[self.columns]
        self.stream: JointStream | None = None
        if len(self.columns):
            continuous = {source.source.dofs[name] for name in source.source.continuous}
            wraps = np.array([int(c) in continuous for c in self.columns])
            self.stream = JointStream(len(self.columns), max_gap, holds_bad_samples=holds_bad_samples, wraps=wraps)
            self.stream.first = np.array([columns[int(c)] for c in self.columns])
        self._converts = bool((self.scale != 1.0).any()) or not bool(
            (np.signbit(self.offsets) & (self.offsets == 0)).all()
        )
        self.latest = NEVER
        self.out_of_order = self.max_disorder = 0
        self.names: set[str] = set()
        self.length_mismatches = LengthMismatches()
        self._column_maps: dict[tuple[str, ...], _ColumnMap] = {}
        self._last_names: tuple[str, ...] = ()  # of the message before, and their map
        self._last_map = self._make_column_map(())

    def add(self, time: int, message: JointSample) -> bool:
        """Add a message; False if it is of the other side's glove."""
        if self.input.side and message.side != self.input.side:
            return False
        if len(message.values) != len(message.names):
            self.length_mismatches.add(message)
        if time < self.latest:
            self.out_of_order += 1
            self.max_disorder = max(self.max_disorder, self.latest - time)
        else:
            self.latest = time
        names, sample = message.names, message.usable_values
        if names is self._last_names:
            column_map = self._last_map
        else:
            names = tuple(names)
            found = self._column_maps.get(names)
            column_map = self._make_column_map(names) if found is None else found
            self._last_names, self._last_map = names, column_map
        if self.stream is None or len(sample) == 0 or len(column_map.source) == 0:
            return True
        values = np.array(sample, dtype=np.float64)
        if not column_map.takes_all or len(values) != len(column_map.source):
            values = values[column_map.source]
        if column_map.is_whole:
            if self._converts:
                values *= self.scale
                values += self.offsets
            if np.maximum.reduce(np.abs(values)) < VALUE_LIMIT:  # none is NaN either
                self.stream.add(time, values, full=True)
                return True
            good = np.abs(values) < VALUE_LIMIT
        else:
            values *= self.scale[column_map.target]
            values += self.offsets[column_map.target]
            good = np.abs(values) < VALUE_LIMIT
        row = np.full(len(self.columns), np.nan)
        if good.all():
            row[column_map.target] = values
            self.stream.add(time, row)
            return True
        row[column_map.target[good]] = values[good]
        bad = np.zeros(len(self.columns), dtype=bool)
        bad[column_map.target[~good]] = True
        self.stream.add(time, row, bad)
        return True

    def plain_values(self, time: int, names: tuple[str, ...], values: Floats) -> Floats | None:
        """Rows (n, m) of messages (n, k), the first at a time [ns]; None unless they are good, of all joints, and go on."""
        columns = self._column_maps.get(names)
        is_other = self.input.side or columns is None or not columns.is_whole or len(names) != values.shape[1]
        if is_other or self.stream is None or time <= self.latest or not self.stream.goes_on(time):
            return None
        assert columns is not None
        rows = values[:, columns.source]
        if self._converts:
            with np.errstate(all="ignore"):
                rows *= self.scale
                rows += self.offsets
        return rows if bool((np.abs(rows) < VALUE_LIMIT).all()) else None

    def extend(self, times: list[int], rows: Floats) -> None:
        """Add messages of increasing times whose rows are `plain_values`."""
        assert self.stream is not None
        self.latest = times[-1]
        self.stream.extend(times, rows)

    def _make_column_map(self, names: tuple[str, ...]) -> _ColumnMap:
        """Make the column map of a list of names; of duplicate names the first is used."""
        index_of_column: dict[int, int] = {}
        for i, name in enumerate(names):
            column = self.input.column(name)
            if column is not None and column in self.index_of_column:
                index_of_column.setdefault(self.index_of_column[column], i)
        add_names(self.names, names)
        target, source = np.array(sorted(index_of_column.items()), dtype=np.int64).reshape(-1, 2).T.copy()
        column_map = _ColumnMap(
            source, target, len(target) == len(self.columns), np.array_equal(source, np.arange(len(source)))
        )
        if len(self._column_maps) >= MAX_COLUMN_MAPS:
            self._column_maps.clear()
        if len(names) <= MAX_CACHED_NAMES:
            self._column_maps[names] = column_map
        return column_map


@dataclass
class ChannelRoutes:
    """The consumers of the messages of one channel."""

    roots: dict[str, list[RootRoute]] = field(default_factory=dict)  # by child frame
    tracks: dict[str, TransformTrack] = field(default_factory=dict)  # by child frame, without leading slash
    expected_parents: dict[str, str] = field(default_factory=dict)  # child frame -> the only parent it may have
    static: bool = False
    joints: list[JointRoute] = field(default_factory=list)
    clock: bool = False
    clock_delay: int = 0  # ns
    clock_child: str = ""  # frames are made only at poses of this child or gloves of this side
    clock_points: frozenset[str] = frozenset()  # or at poses of any of these children
    unused_poses: int = 0  # poses without a consumer
