"""Converts a block of frames in the buffer to results: columns of all frames at once, then one record a frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.engine.frame_buffer import Block
from geomphys.engine.step import WHOLE
from geomphys.jit.stage_clock import STAGES, ns_per_cycle
from geomphys.results import Contacts, Frame, FrameResult, Metrics, Penetrations

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_FIGURES = {
    "recorded": "recorded_penetration_m",
    "residual": "residual_penetration_m",
    "correction": "correction_m",
    "rotation": "correction_rad",
    "fingertip_error": "fingertip_error_m",
    "contact_precision": "contact_precision_m",
    "contact_alignment": "contact_alignment_rad",
}
"""Figure of the buffer -> field of the metrics, where they have two names."""


class MotionMeasures(NamedTuple):
    """Motion of the driven bodies in n frames; see `geomphys.results.Metrics`."""

    recorded_speed_m_s: Floats  # (n,)
    correction_speed_m_s: Floats  # (n,)
    recorded_jerk_m_s3: Floats  # (n,)
    correction_jerk_m_s3: Floats  # (n,)
    shape_change_rad: Floats  # (n,)


class BlockResults(NamedTuple):
    """The results of n frames. The arrays are copies, whose rows the records of frames share."""

    recorded: Floats  # (n, B, 7) poses of all bodies
    corrected: Floats  # (n, B, 7)
    angles: Floats  # (n, Q)
    contacts: Contacts  # of all frames, one after another
    contact_end: list[int]  # (n + 1,) rows of the contacts after each frame; [0] is 0
    penetrations: Penetrations
    depth_end: list[int]  # (n + 1,)
    metrics: list[Metrics]  # (n,)
    stages: list[tuple[tuple[str, int, int], ...]]  # (n,) names, ns, counts of the step and its stages

    def result(self, frame: Frame, row: int, decode_ns: int, encode_ns: int) -> FrameResult:
        """The record of frame `row`, without messages."""
        touched = slice(self.contact_end[row], self.contact_end[row + 1])
        overlapping = slice(self.depth_end[row], self.depth_end[row + 1])
        return FrameResult(
            frame=frame,
            recorded=self.recorded[row],
            corrected=self.corrected[row],
            angles=self.angles[row],
            contacts=Contacts._make(column[touched] for column in self.contacts),
            penetrations=Penetrations._make(column[overlapping] for column in self.penetrations),
            metrics=self.metrics[row],
            timing=(("decode", decode_ns, 1), *self.stages[row], ("encode", encode_ns, 1)),
        )


def results_of(block: Block, frames: Sequence[Frame], flags: Sequence[int], motion: MotionMeasures) -> BlockResults:
    """Results of the first n frames of a block; `flags` (n,) beside those of frames and step."""
    count = len(frames)
    contacts, depths = block.contact_end[count], block.depth_end[count]
    return BlockResults(
        recorded=_all_poses(block, block.recorded[:count]),
        corrected=_all_poses(block, block.corrected[:count]),
        angles=block.angles[:count].copy(),
        contacts=Contacts._make(block.contacts[name][:contacts].copy() for name in Contacts._fields),
        contact_end=block.contact_end[: count + 1].tolist(),
        penetrations=Penetrations._make(block.depths[name][:depths].copy() for name in Penetrations._fields),
        depth_end=block.depth_end[: count + 1].tolist(),
        metrics=_metrics(block, frames, flags, motion),
        stages=_stages(block, count),
    )


def _all_poses(block: Block, rows: Floats) -> Floats:
    """All bodies' poses (n, B, 7), from rows (n, M, 7) of those that move."""
    poses = np.tile(block.rest, (len(rows), 1, 1))
    poses[:, block.moving] = rows
    return poses


def _metrics(block: Block, frames: Sequence[Frame], flags: Sequence[int], motion: MotionMeasures) -> list[Metrics]:
    figures = block.figures[: len(frames)]
    columns = {_FIGURES.get(name, name): figures[name].tolist() for name in figures.dtype.names or ()}
    columns |= {name: column.tolist() for name, column in motion._asdict().items()}
    columns["contacts"] = np.diff(block.contact_end[: len(frames) + 1]).tolist()
    columns["held"] = [frame.held for frame in frames]
    own = zip(columns["flags"], frames, flags, strict=True)
    columns["flags"] = [figure | frame.flags | flag for figure, frame, flag in own]
    return [Metrics(*row) for row in zip(*(columns[name] for name in Metrics._fields), strict=True)]


def _stages(block: Block, count: int) -> list[tuple[tuple[str, int, int], ...]]:
    columns = [WHOLE, *range(len(STAGES))]
    ns = (block.cycles[:count, columns] * ns_per_cycle()).astype(np.int64).tolist()
    counts = block.counts[:count, columns]
    counts[:, 0] = 1
    names = ("step", *STAGES)
    return [tuple(zip(names, *row, strict=True)) for row in zip(ns, counts.tolist(), strict=True)]
