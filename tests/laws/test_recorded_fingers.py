"""Recorded fingers that overlap near their knuckles: other links share, rather than that one finger is moved far."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.load import load_world
from geomphys.replays import replay

BOUND = 4.0  # of the 95th percentile; 7.5 and 8.3 where links weigh the same however far off they are


@pytest.mark.parametrize("recording", [10, 14])
def test_no_link_is_moved_by_many_times_the_overlap(shared_dir: Path, recording: int) -> None:
    (log,) = (shared_dir / "recordings").glob(f"adroit_door_{recording:02d}_*.mcap")
    world = load_world(shared_dir / "checks" / "scenes" / "door_chains.toml")
    amplification = np.array([result.metrics.amplification for result in replay(log, world)])
    assert np.percentile(amplification[amplification > 0.0], 95) <= BOUND
