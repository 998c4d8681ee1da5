"""Measures where fingertips are at any poses: how far from the recording, and which recorded contacts are kept."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.support import pose_pieces
from geomphys.collision.sweep import update_boxes
from geomphys.engine.frame_buffer import FIGURES
from geomphys.engine.motion_measures import measure_motion
from geomphys.engine.state import ReplayData, make_replay_data
from geomphys.engine.step import measure_correction
from geomphys.jit.kernel import kernel
from geomphys.jit.packed_records import Record, pack
from geomphys.scene.arrays import Scene
from geomphys.scene.world import World

Floats = NDArray[np.float64]


class TipFigures(NamedTuple):
    """Fingertips of a frame."""

    recorded: int  # fingertips that were recorded in contact
    retained: int  # of these, those that still are
    error_m: float  # mean distance of fingertips in contact from where they were recorded; of all if none was


@kernel
def _measure(scene: Scene, data: ReplayData, figures: Record) -> None:
    """`measure_motion` with the bodies at `data.corrected`, which were recorded at `data.recorded`."""
    pose_pieces(scene.pieces, data.recorded, data.workspace.piece_frames.base)
    pose_pieces(scene.pieces, data.corrected, data.workspace.piece_frames.frames)
    for tree in range(len(scene.trees.role)):
        update_boxes(scene, data.workspace.piece_frames.frames, data.detection.boxes, tree)
    measure_correction(scene, data, figures)
    measure_motion(scene, data, figures, False)


class FingertipMeter:
    """Fingertips of a world, against everything of other trees."""

    def __init__(self, world: World) -> None:
        self._machine = make_replay_data(world.scene)
        self._packed = pack(world.scene), pack(self._machine)
        self._figures = np.zeros(1, FIGURES)[0]

    def figures(self, recorded: Floats, poses: Floats) -> TipFigures:
        """Figures of a frame with the bodies at `poses` (B, 7), which were recorded at `recorded` (B, 7)."""
        self._machine.recorded[:], self._machine.corrected[:] = recorded, poses
        _measure(*self._packed, self._figures)
        contacts, retained, error = (
            self._figures[n] for n in ("contacts_recorded", "contacts_kept", "fingertip_error")
        )
        return TipFigures(int(contacts), int(retained), float(error))
