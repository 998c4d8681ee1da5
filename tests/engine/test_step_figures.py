"""Figures and bounds of a frame, each from the kernel that makes it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from geomphys.driven.groups import INTERPOLATED, LEAST_DISTANCE, Outcome, combine, store_method
from geomphys.engine.frame_buffer import FIGURES, is_full, make_block, write_depths
from geomphys.engine.state import make_replay_data
from geomphys.engine.step import measure_correction
from geomphys.errors import GeomphysError
from geomphys.jit.packed_records import pack
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Sphere
from tests.driven import logs
from tests.simulated.scenes import Thing, floor, make_scene

BALLS = [Thing(shape=Sphere(0.05), role=s.DRIVEN, at=(0.2 * k, 0, 0.06)) for k in range(3)]


@pytest.mark.parametrize(("sign", "angle"), [(1, 0.0), (-1, 0.0), (1, 0.3), (-1, 0.3), (-1, math.pi)])
def test_a_rotation_and_its_negative_quaternion_are_one(sign: int, angle: float) -> None:
    scene = make_scene([*BALLS, floor()])
    data = make_replay_data(scene)
    data.recorded[0, 3:] = (0.0, 0.0, 0.0, 1.0)
    data.corrected[0, 3:] = sign * np.array([0.0, math.sin(angle / 2), 0.0, math.cos(angle / 2)])
    data.corrected[1, 0] += 0.02
    figures = np.zeros(1, FIGURES)[0]
    measure_correction(pack(scene), pack(data), figures)
    assert figures["rotation"] == pytest.approx(angle, abs=1e-12)
    assert figures["correction"] == pytest.approx(0.02, abs=1e-15)


def test_each_pair_of_bodies_has_the_method_that_freed_its_own_trees() -> None:
    scene = make_scene([*BALLS, floor()])
    data, block = make_replay_data(scene), make_block(np.arange(3), np.zeros((4, 7)), 0, frames=2)
    state = pack(data.driven)
    store_method(state, 1, 0)
    store_method(state, 2, 1)
    store_method(state, 2, 0)  # a later substep
    data.depths.body_a[:4], data.depths.body_b[:4] = (0, 1, 2, 1), (3, 3, 3, 2)
    write_depths(pack(scene), pack(block), 0, pack(data.depths), 4, data.driven.method)
    methods = [0, LEAST_DISTANCE, INTERPOLATED, INTERPOLATED]
    assert block.depths["method"][: block.depth_end[1]].tolist() == methods


def test_a_bound_hit_in_any_substep_is_one_of_the_frame() -> None:
    good, bad = Outcome(2, 0, True, False), Outcome(3, 1, False, True)
    for parts in ((good, bad), (bad, good)):
        assert tuple(combine(*parts)) == (5, 1, False, True)
    assert tuple(combine(good, good)) == (4, 0, True, False)


@pytest.mark.parametrize("table", ["contact", "depth"])
def test_a_table_that_is_filled_to_the_last_row_counts_as_full(table: str) -> None:
    block = make_block(np.arange(3), np.zeros((4, 7)), 0, frames=2)
    ends, rows = getattr(block, f"{table}_end"), len(getattr(block, f"{table}s"))
    for end in (0, rows - 1, rows):
        ends[1] = end
        assert is_full(pack(block), 0) == (end == rows)
    assert not is_full(pack(block), 1)


def test_a_replay_with_more_near_pairs_than_the_table_has_ends_with_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is called free by a search that has not seen all pairs."""
    monkeypatch.setattr("geomphys.engine.state.NEAR_PAIRS", 2)
    cube = ("box", 0.1, 0.1, 0.1)
    posts = [logs.Thing(name=f"post_{k}", shape=cube, at=(0.09 * k, 0, 0)) for k in (-1, 0, 1)]
    path = np.tile([0.0, 0.0, 0.095], (3, 1))
    with pytest.raises(GeomphysError, match="decompose the meshes into fewer"):
        logs.play(tmp_path, [*posts, logs.Thing(name="cube", shape=cube, role="driven", path=path)])
