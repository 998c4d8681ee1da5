"""Converts a block of frames in the buffer to results."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.engine.frame_buffer import Block
from geomphys.engine.step import WHOLE
from geomphys.jit.stage_clock import STAGES, ns_per_cycle
from geomphys.results import Contacts, Frame, Metrics, Penetrations, ResultColumns

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

_STAGES = ("decode", "step", *STAGES, "encode")


class MotionMeasures(NamedTuple):
    """Motion of the driven bodies in n frames; see `geomphys.results.Metrics`."""

    recorded_speed_m_s: Floats  # (n,)
    correction_speed_m_s: Floats  # (n,)
    recorded_jerk_m_s3: Floats  # (n,)
    correction_jerk_m_s3: Floats  # (n,)
    shape_change_rad: Floats  # (n,)


def results_of(
    block: Block, frames: Sequence[Frame], flags: Ints, motion: MotionMeasures, decode_ns: int
) -> ResultColumns:
    """Results of the first n frames of a block, without messages.

    `flags` (n,) beside those of frames and step; `decode_ns`: time that a frame took to decode. The arrays are copies.
    """
    count = len(frames)
    contacts, depths = block.contact_end[count], block.depth_end[count]
    stage_ns, stage_counts = _stages(block, count, decode_ns)
    return ResultColumns(
        frames=frames,
        recorded=_all_poses(block, block.recorded[:count]),
        corrected=_all_poses(block, block.corrected[:count]),
        angles=block.angles[:count].copy(),
        contacts=Contacts._make(block.contacts[name][:contacts].copy() for name in Contacts._fields),
        contact_end=block.contact_end[: count + 1].copy(),
        penetrations=Penetrations._make(block.depths[name][:depths].copy() for name in Penetrations._fields),
        penetration_end=block.depth_end[: count + 1].copy(),
        metrics=_metrics(block, frames, flags, motion),
        stages=_STAGES,
        stage_ns=stage_ns,
        stage_counts=stage_counts,
        messages={},
        moments={},
        grasps={},
    )


def _all_poses(block: Block, rows: Floats) -> Floats:
    """All bodies' poses (n, B, 7), from rows (n, M, 7) of those that move."""
    poses = np.tile(block.rest, (len(rows), 1, 1))
    poses[:, block.moving] = rows
    return poses


def _metrics(block: Block, frames: Sequence[Frame], flags: Ints, motion: MotionMeasures) -> dict[str, NDArray[Any]]:
    figures = block.figures[: len(frames)]
    columns: dict[str, NDArray[Any]] = {_FIGURES.get(name, name): figures[name] for name in figures.dtype.names or ()}
    columns |= motion._asdict()
    columns["contacts"] = np.diff(block.contact_end[: len(frames) + 1])
    columns["held"] = np.array([frame.held for frame in frames], bool)
    columns["flags"] = columns["flags"] | np.array([frame.flags for frame in frames], np.int64) | flags
    return {name: columns[name].copy() for name in Metrics._fields}


def _stages(block: Block, count: int, decode_ns: int) -> tuple[Ints, Ints]:
    """Times (n, s) [ns] and counts (n, s) of `_STAGES`; that of the sinks is not known yet."""
    kernel_columns = [WHOLE, *range(len(STAGES))]
    ns, counts = np.zeros((count, len(_STAGES)), np.int64), np.ones((count, len(_STAGES)), np.int64)
    ns[:, 0] = decode_ns
    ns[:, 1:-1] = block.cycles[:count, kernel_columns] * ns_per_cycle()
    counts[:, 2:-1] = block.counts[:count, : len(STAGES)]
    return ns, counts
