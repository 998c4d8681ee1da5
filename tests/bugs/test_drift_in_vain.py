"""Where no drift spared a hand the jump of a wedge, the frames after the chunk went on from the last drift that was tried."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.laws.turning_cells import play_cube, turning_frame

CHUNK = 128  # frames


def test_what_comes_after_drifts_in_vain_goes_on_from_what_was_kept(tmp_path: Path) -> None:
    """The cube has come back to its recording well before the chunk ends, and stays there."""
    angles = np.concatenate([2 * np.pi * np.sin(np.linspace(0, np.pi, 120)) ** 2, np.zeros(40)])
    run = play_cube(tmp_path, turning_frame(angles, (0.3, -0.1, 0.2)), True)
    offset = np.linalg.norm(run.offset("cube"), axis=1)
    assert offset[CHUNK - 1] < 1e-5
    assert (np.diff(offset[CHUNK - 1 :]) <= 0.0).all()
