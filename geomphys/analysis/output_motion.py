"""Measures of the motion in an output log, frame by frame in bounded memory; those of a frame come from ``/metrics``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geomphys.analysis.joint_angles import LinkTrees, Unwrapper, link_trees
from geomphys.analysis.motion_quality import MotionFigures, MotionQuality
from geomphys.output.output_log import OutputFrame, OutputLog
from geomphys.scene.frame_ids import RECORDED_PREFIX

Floats = NDArray[np.float64]

BATCH_FRAMES = 256
"""Frames that are taken together."""


@dataclass(frozen=True, kw_only=True)
class OutputMotion(MotionFigures):
    """Measures of the motion of an output: of the whole sequence, and of contacts by their counts over all frames."""

    spike_frame: int | None
    """Frame of the largest spike."""
    contacts_recorded: int
    """Recorded contacts of fingertips, over all frames."""
    contacts_kept: int
    """Those of them that are there in the corrected motion."""
    grasps_recorded: int
    grasps_kept: int
    intersection_volume_m3: float | None
    """Volume common to the two bodies of the deepest recorded overlap; None if the replay did not end, or a surface is open."""


class OutputMotionMeter:
    """Takes the frames of an output, in order, and gives the measures of its motion.

    Frames need the channels ``/tf``, ``/recorded/tf`` and ``/metrics``.
    """

    def __init__(self, output: OutputLog) -> None:
        self._output = output
        self._names: tuple[tuple[str, ...], tuple[str, ...]] | None = None
        self._rows = np.zeros(0, np.int64)
        self._trees: LinkTrees | None = None
        self._quality: MotionQuality | None = None
        self._unwrap = Unwrapper(), Unwrapper()
        self._batch: list[tuple[int, float, Floats, Floats]] = []
        self._indices: list[int] = []
        self._counts = [0, 0, 0, 0]
        self._deepest_m = 0.0
        self._spike_row, self._taken = -1, 0
        self._spike_frame: int | None = None

    def add(self, frame: OutputFrame) -> None:
        """Take the next frame."""
        names = (frame.recorded.names, frame.tf.names)
        if self._names != names:
            self._set_names(*names)
        metrics = frame.metrics
        for k, name in enumerate(("contacts_recorded", "contacts_kept", "grasps_recorded", "grasps_kept")):
            self._counts[k] += int(metrics[name])
        self._deepest_m = max(self._deepest_m, metrics["recorded_penetration_m"])
        corrected = frame.tf.values[self._rows]
        self._batch.append((frame.time_ns, metrics["recorded_penetration_m"], frame.recorded.values, corrected))
        self._indices.append(frame.index)
        if len(self._batch) == BATCH_FRAMES:
            self._take_batch()

    def motion(self) -> OutputMotion:
        """The measures of all frames so far."""
        self._take_batch()
        quality = self._quality or MotionQuality(np.zeros(0, np.int64))
        contacts, retained, grasps, grasps_retained = self._counts
        return OutputMotion(
            **vars(quality.figures()),
            spike_frame=self._spike_frame,
            contacts_recorded=contacts,
            contacts_kept=retained,
            grasps_recorded=grasps,
            grasps_kept=grasps_retained,
            intersection_volume_m3=self._output.intersection_volume_m3 if self._deepest_m > 0.0 else 0.0,
        )

    def _set_names(self, recorded: tuple[str, ...], corrected: tuple[str, ...]) -> None:
        """Look up links by name: they differ between the first frame, which has the bodies at rest too, and the others."""
        links = tuple(name.removeprefix(RECORDED_PREFIX) for name in recorded)
        if self._names is None or self._names[0] != recorded:
            self._take_batch()
            self._trees = link_trees(self._output, links)
            self._quality = MotionQuality(self._trees.trees)
        rows = {name: row for row, name in enumerate(corrected)}
        self._rows = np.array([rows[link] for link in links], np.int64)
        self._names = (recorded, corrected)

    def _take_batch(self) -> None:
        if not self._batch or self._quality is None or self._trees is None:
            return
        times, depths, recorded, corrected = (np.array(column) for column in zip(*self._batch, strict=True))
        angles = [
            unwrap.add(self._trees.angles(poses))
            for unwrap, poses in zip(self._unwrap, (recorded, corrected), strict=True)
        ]
        self._quality.add(
            times, recorded, corrected, depths=depths, recorded_angles=angles[0], corrected_angles=angles[1]
        )
        row = self._quality.figures().spike_row
        if row is not None and row != self._spike_row:
            self._spike_row, self._spike_frame = row, self._indices[row - self._taken]
        self._taken += len(self._batch)
        self._batch, self._indices = [], []
