"""Both motions in one rerun recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import geomphys
from geomphys.analysis.diff.rerun_overlay import write_overlay
from geomphys.output.output_log import open_output
from tests.made import Results


def test_an_overlay_holds_both_motions(pressed: Results, tmp_path: Path) -> None:
    import rerun as rr

    path = tmp_path / "overlay.rrd"
    difference = geomphys.compare_outputs(pressed.out, pressed.raised)
    write_overlay(difference, path)
    heights: dict[str, list[float]] = {"a": [], "b": []}
    distances: list[float] = []
    for chunk in rr.chunk.RrdReader(path).stream():
        batch = chunk.to_record_batch()
        for side in heights:
            if chunk.entity_path == f"/world/{side}/finger" and not chunk.is_static:
                heights[side] += [row[0][2] for row in batch.column("Transform3D:translation").to_pylist() if row]
        if chunk.entity_path == "/plots/distance_mm" and not chunk.is_static:
            distances += [row[0] for row in batch.column("Scalars:scalars").to_pylist() if row]
    for side, out in (("a", pressed.out), ("b", pressed.raised)):
        truth = [f.tf.values[f.tf.names.index("finger"), 2] for f in open_output(out).frames(["/tf"])]
        assert np.allclose(heights[side], truth, atol=1e-6)
    assert max(distances) / 1e3 == pytest.approx(difference.as_dict()["channels"]["/tf"]["max_m"], rel=1e-12)
