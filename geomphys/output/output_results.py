"""Reads the frames of an output back as the `FrameResult`s they were written from, for sinks and pictures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from geomphys.errors import LogError
from geomphys.output.decoders import ContactRow, PenetrationRow, Poses
from geomphys.output.output_log import CHANNELS, OutputFrame, OutputLog
from geomphys.results import METHODS, Contacts, Frame, FrameResult, Metrics, Penetrations
from geomphys.scene.world import World


def results_of_output(
    output: OutputLog, world: World, *, first: int = 0, last: int | None = None
) -> Iterator[FrameResult]:
    """The frames `first` to `last` (numbers of the replay, both included; None: to the end) of an output.

    `Frame.roots` and `Frame.angles` are those of the corrected motion: recorded joint values are not in an output.

    Raises
    ------
    LogError
        A body of the world has no pose in the output, or the output names a body that the world does not have.
    DamagedLogError
        The file is damaged.
    """
    reader = _Reader(output, world)
    for frame in output.frames(CHANNELS):
        if last is not None and frame.index > last:
            return
        result = reader.result(frame, needed=frame.index >= first)
        if result is not None:
            yield result


class _Reader:
    """Maps names of an output to bodies and joints of a world; poses of bodies at rest are kept from the first frame."""

    def __init__(self, output: OutputLog, world: World) -> None:
        self._output, self._world = output, world
        self._bodies = {name: body for body, name in enumerate(world.body_names)}
        self._frames = {name: body for body, name in enumerate(world.frame_names)}
        self._poses: np.ndarray | None = None
        self._columns: dict[tuple[str, ...], np.ndarray] = {}

    def result(self, frame: OutputFrame, *, needed: bool) -> FrameResult | None:
        """The frame; None for one that is not needed, of which the poses are noted where they are the first."""
        if self._poses is None:
            self._poses = np.full((len(self._world.frame_names), 7), np.nan)
            self._poses[self._rows(frame.tf)] = frame.tf.values
            missing = np.flatnonzero(np.isnan(self._poses).any(axis=1))
            if len(missing):
                raise LogError(f"{self._output.path}: has no pose of {self._world.body_names[missing[0]]}")
        if not needed:
            return None
        corrected = self._poses.copy()
        corrected[self._rows(frame.tf)] = frame.tf.values
        recorded = corrected.copy()
        recorded[self._rows(frame.recorded, "recorded/")] = frame.recorded.values
        angles = [values for _, (_, values) in sorted(frame.joints.items())]
        joints = np.concatenate([np.zeros(0), *angles])
        metrics = Metrics._make(frame.metrics[name] for name in Metrics._fields)
        roots = corrected[self._world.scene.trees.body_start[:-1]]
        return FrameResult(
            frame=Frame(frame.index, frame.time_ns, roots, joints, bool(metrics.held), int(metrics.flags)),
            recorded=recorded,
            corrected=corrected,
            angles=joints,
            contacts=self._contacts(frame.contacts),
            penetrations=self._penetrations(frame.penetrations),
            metrics=metrics,
            timing=tuple((name, ns, count) for name, ns, count in frame.timing),
            messages=tuple((level, text) for level, text in frame.log),
        )

    def _rows(self, poses: Poses, prefix: str = "") -> np.ndarray:
        key = poses.names
        if key not in self._columns:
            self._columns[key] = np.array([self._index(self._frames, n.removeprefix(prefix)) for n in key], np.int64)
        return self._columns[key]

    def _index(self, known: dict[str, int], name: str) -> int:
        if name not in known:
            raise LogError(f"{self._output.path}: {name!r} is no body of its scene; name the scene with --scene")
        return known[name]

    def _pairs(self, rows: Sequence[ContactRow] | Sequence[PenetrationRow]) -> tuple[np.ndarray, np.ndarray]:
        body_a = np.array([self._index(self._bodies, row.body_a) for row in rows], np.int64)
        return body_a, np.array([self._index(self._bodies, row.body_b) for row in rows], np.int64)

    def _contacts(self, rows: Sequence[ContactRow]) -> Contacts:
        body_a, body_b = self._pairs(rows)
        return Contacts(
            body_a=body_a,
            body_b=body_b,
            point=np.array([row.point for row in rows], np.float64).reshape(-1, 3),
            normal=np.array([row.normal for row in rows], np.float64).reshape(-1, 3),
            depth=np.array([row.depth for row in rows], np.float64),
            normal_impulse=np.array([row.normal_impulse for row in rows], np.float64),
            tangential_impulse=np.array([row.tangential_impulse for row in rows], np.float64),
        )

    def _penetrations(self, rows: Sequence[PenetrationRow]) -> Penetrations:
        body_a, body_b = self._pairs(rows)
        return Penetrations(
            body_a=body_a,
            body_b=body_b,
            pd=np.array([row.pd for row in rows], np.float64).reshape(-1, 3),
            convex_pairs=np.array([row.convex_pairs for row in rows], np.int64),
            largest=np.array([row.largest for row in rows], np.float64),
            method=np.array([METHODS.index(row.method) for row in rows], np.int64),
        )
