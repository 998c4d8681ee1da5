"""Rows of the solvers beyond the capacity of their table: counted, flagged, and nothing passes through anything."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import geomphys
from geomphys.driven.constraints import add_cones, add_pairs, number_unknowns, request_pairs_in_contact
from geomphys.driven.qp import make_quadratic, solve_quadratic
from geomphys.driven.state import GENERAL_MOTION, TRANSLATION
from geomphys.driven.stepping import measure_near_pairs
from geomphys.engine.coupled_contacts import add_effect, add_inequality
from geomphys.engine.state import ReplayData, make_replay_data
from geomphys.jit.packed_records import pack
from geomphys.output.summary import FLAG_NAMES
from geomphys.results import FLAG_TABLE_FULL
from tests.driven.compound import NOTCHED, shoulder

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(("capacity", "rows", "lost"), [(4, 3, 0), (3, 3, 0), (2, 2, 1), (1, 1, 2)])
def test_pairs_without_a_row_are_counted(
    table: tuple[object, object, ReplayData], capacity: int, rows: int, lost: int
) -> None:
    """Three balls that overlap a floor."""
    scene, _, data = table
    ws = data.workspace._replace(problem=make_quadratic(9, capacity))
    ws.work.mobility[:3], ws.work.ignored[:] = TRANSLATION, 0
    ws.piece_frames.frames[:3, 11] = 0.045
    packed = pack(ws)
    measure_near_pairs(scene, packed, 1e-3, np.inf)
    request_pairs_in_contact(packed)
    unknowns = number_unknowns(scene, packed)
    assert add_pairs(scene, packed, packed.work.iterate, 1e-4, 0, unknowns, False) == rows
    assert ws.problem.counts["lost"] == lost


@pytest.mark.parametrize(("capacity", "lost"), [(2, 0), (1, 2)])
def test_bounds_without_a_row_are_counted_and_hold_all_the_same(capacity: int, lost: int) -> None:
    """The one without a row is counted in both rounds: when both are found violated, and when the other holds."""
    problem = make_quadratic(2, capacity)
    problem.hessian[:], problem.gradient[:] = np.eye(2), (-1.0, -2.0)
    problem.low[:], problem.high[:] = 0.0, 0.5
    solve_quadratic(pack(problem), 2, 0)
    assert problem.x.tolist() == [0.5, 0.5]
    assert problem.counts["lost"] == lost


@pytest.mark.parametrize(("first", "lost"), [(0, 0), (1, 1)])
def test_cones_without_a_row_are_counted(tmp_path: Path, first: int, lost: int) -> None:
    scene = shoulder(tmp_path, NOTCHED).scene
    data = make_replay_data(scene)
    ws = data.workspace._replace(problem=make_quadratic(10, 1))
    ws.work.mobility[0] = GENERAL_MOTION
    packed = pack(ws)
    unknowns = number_unknowns(pack(scene), packed)
    assert add_cones(pack(scene), packed, packed.work.iterate, first, unknowns) == 1
    assert ws.problem.counts["lost"] == lost


def test_inequalities_and_effects_of_the_coupled_solve_without_a_row_are_counted(
    table: tuple[object, object, ReplayData],
) -> None:
    """Its tables hold one row each in a scene without simulated bodies."""
    coupled = table[2].coupled
    packed = pack(coupled)
    add_effect(packed, 0, 0, (1.0, 0.0, 0.0))
    add_inequality(packed, 0, 0.1, 0.0)
    assert coupled.solve["lost"] == 0
    add_effect(packed, 0, 1, (1.0, 0.0, 0.0))
    assert coupled.solve["lost"] == 1
    add_inequality(packed, 0, 0.1, 0.0)
    assert coupled.solve["lost"] == 2
    assert (coupled.solve["effects"], coupled.solve["inequalities"]) == (1, 1)


def test_frames_with_too_few_rows_are_flagged_and_free_of_overlap(monkeypatch: pytest.MonkeyPatch) -> None:
    """The hand is in the table with all fingers: more than one pair needs a row."""
    log, scene = ROOT / "recordings/gallery_hand.mcap", ROOT / "assets/scenes/gallery.toml"
    config = geomphys.Config(start=34.5, end=35.5)
    usual = list(geomphys.replay(log, scene, config=config))
    assert not any(r.metrics.flags & FLAG_TABLE_FULL for r in usual)
    monkeypatch.setattr("geomphys.driven.state.ROWS", 1)
    results = list(geomphys.replay(log, scene, config=config))
    flagged = [r for r in results if r.metrics.flags & FLAG_TABLE_FULL]
    assert flagged
    assert all(r.metrics.recorded_penetration_m > 0.0 for r in flagged)
    assert max(r.metrics.residual_penetration_m for r in results) < 2e-6
    assert [text for r in results for _, text in r.messages if "table" in text]
    assert FLAG_NAMES[FLAG_TABLE_FULL] == "table_full"
