"""Near pairs: complete against brute force, in a fixed order, and remembered directions change nothing."""

from __future__ import annotations

import pytest

from geomphys.engine.state import make_machine
from geomphys.engine.step import measure_recorded, pose_recording
from geomphys.jit.packed_records import pack
from geomphys.scene.arrays import FIXED
from tests.driven.logs import Engine, Run, play
from tests.laws.test_driven_random import random_scene


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return play(tmp_path_factory.mktemp("detect"), random_scene(21, 40, driven=4))


def near_of(run: Run, machine: object, frame: int) -> dict[tuple[int, int], float]:
    """Overlapping pairs of pieces in a recorded frame and their separations [m]."""
    packed, f = pack(machine), run.results[frame].frame
    pose_recording(pack(run.world.scene), packed, f.roots, f.angles)
    measure_recorded(pack(run.world.scene), packed)
    near = machine.workspace.near
    return {(int(near.a[k]), int(near.b[k])): float(near.separation[k]) for k in range(near.counts["filled"])}


def test_no_overlap_is_missed_and_none_invented(run: Run) -> None:
    engine, machine = Engine(run.world), make_machine(run.world.scene)
    total = 0
    for frame in range(len(run.results)):
        found = {tuple(sorted(pair)): s for pair, s in near_of(run, machine, frame).items()}
        frames = engine.frames(run.recorded[frame])
        for i, j in engine.pairs:
            gap = engine.gap(i, j, frames)
            if gap < -1e-6:
                assert found[i, j] == pytest.approx(gap, abs=2e-6)
                total += 1
            elif gap > 1e-6:
                assert (i, j) not in found
    assert total > 50


def test_pairs_of_fixed_things_are_not_looked_at(run: Run) -> None:
    machine = make_machine(run.world.scene)
    role = run.world.scene.bodies.role[run.world.scene.pieces.body]
    for frame in range(0, 40, 4):
        assert not any(role[a] == FIXED and role[b] == FIXED for a, b in near_of(run, machine, frame))


def test_losing_remembered_directions_costs_no_answer(run: Run) -> None:
    warm = make_machine(run.world.scene)
    for frame in range(40):
        with_memory = near_of(run, warm, frame)
        without = near_of(run, make_machine(run.world.scene), frame)
        assert list(with_memory) == list(without)  # the same order too
        assert list(with_memory.values()) == pytest.approx(list(without.values()), abs=1e-9)
