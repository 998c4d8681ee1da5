"""Whole replays by the published method: what it solves in closed form, what it bounds, what it misses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import geomphys
from geomphys.config import Config
from geomphys.engine.pipeline import Pipeline
from geomphys.results import FLAG_NOT_CONVERGED, METHODS
from tests.driven.logs import FREE, GAP, Run, Thing, assert_free, line, play
from tests.driven.test_chains import BOX, TABLE, check_kinematics, check_limits, columns, finger, hand, names, palm
from tests.driven.test_postures import arm, cone_angles

ROOT = Path(__file__).resolve().parents[3]
PAPER = Config(method="paper")
CUBE = ("box", 0.1, 0.1, 0.1)


def still(*pose: float, frames: int = 20) -> np.ndarray:
    return np.tile(np.array(pose, float), (frames, 1))


def methods_of(run: Run) -> set[str]:
    return {METHODS[k] for r in run.results for k in r.penetrations.method}


def test_out_of_one_plane_by_its_depth_in_one_pass(tmp_path: Path) -> None:
    """PD_g of one pair of convex pieces is their penetration depth: the closed form is depth and clearance, straight up."""
    cube = Thing(name="cube", shape=CUBE, role="driven", path=still(0.1, 0.2, 0.03))
    run = play(tmp_path, [TABLE, cube], config=PAPER)
    assert run.offset("cube") == pytest.approx(np.tile([0.0, 0.0, 0.02 + GAP], (20, 1)), abs=1e-9)
    assert (run.figures("iterations") == 1).all()
    assert methods_of(run) == {"global"}
    assert_free(run)


def test_out_of_one_box_by_its_nearest_side(tmp_path: Path) -> None:
    block = Thing(name="block", shape=("box", 0.4, 0.3, 0.6))
    cube = Thing(name="cube", shape=CUBE, role="driven", path=still(0.01, 0.17, 0.05))
    run = play(tmp_path, [block, cube], config=PAPER)
    assert run.offset("cube")[-1] == pytest.approx([0.0, 0.15 + 0.05 - 0.17 + GAP, 0.0], abs=1e-9)
    assert (run.figures("iterations") == 1).all()


def test_of_two_driven_objects_each_takes_half(tmp_path: Path) -> None:
    left = Thing(name="left", shape=CUBE, role="driven", path=still(-0.04, 0, 0))
    right = Thing(name="right", shape=CUBE, role="driven", path=still(0.04, 0, 0))
    run = play(tmp_path, [left, right], config=PAPER)
    assert run.offset("left")[:, 0] == pytest.approx(-0.01 - GAP, abs=1e-9)
    assert run.offset("right")[:, 0] == pytest.approx(0.01 + GAP, abs=1e-9)
    assert_free(run)


def test_where_normals_cancel_it_is_interpolated_from_the_last_free_state(tmp_path: Path) -> None:
    """The jaws of a vice, one object: both push with the same depth, so that PD_g is zero; the cube stops at the entrance."""
    urdf = tmp_path / "vice.urdf"
    jaw = '<collision><origin xyz="{} 0 -0.2"/><geometry><box size="0.1 1 0.4"/></geometry></collision>'
    urdf.write_text(f'<robot name="v"><link name="jaws">{jaw.format(-0.09)}{jaw.format(0.09)}</link></robot>')
    vice = '[[object]]\nname="vice"\nclass="fixed"\nurdf="vice.urdf"\nmaterial="metal"\n'
    path = line((0, 0, 0.15), (0, 0, -0.02), (0, 0, 0.15), frames=[25, 25])
    run = play(tmp_path, [Thing(name="cube", shape=CUBE, role="driven", path=path)], avatars=vice, config=PAPER)
    assert "interpolated" in methods_of(run)
    inside = run.recorded[:, run.body("cube"), 2] < 0.05 - 0.011  # deeper than the jaws overlap it from the sides
    cancelled = run.figures("fallbacks") == 1
    assert cancelled[inside].sum() >= 5
    assert run.figures("iterations")[cancelled].min() == 1  # at once, without passes that lead nowhere
    assert np.abs(run.path("cube")[inside, :2]).max() <= 1e-9
    assert run.path("cube")[inside, 2].min() == pytest.approx(0.05, abs=1e-4)
    assert_free(run)


def test_what_is_left_of_overlap_is_flagged(tmp_path: Path) -> None:
    """A first frame between two walls: there is no free state to go back to."""
    walls = [Thing(name=n, shape=("box", 0.1, 1, 0.4), at=(x, 0, 0)) for n, x in (("left", -0.09), ("right", 0.09))]
    run = play(tmp_path, [*walls, Thing(name="cube", shape=CUBE, role="driven", path=still(0, 0, 0))], config=PAPER)
    assert run.residual.min() > 1e-3
    assert (run.figures("flags").astype(int) & FLAG_NOT_CONVERGED).all()


def test_without_overlap_the_recording_is_copied_bit_for_bit_and_offsets_decay(tmp_path: Path) -> None:
    path = np.vstack([line((0, 0, 0.2), (0.1, 0, 0.02), (0.2, 0, 0.2), frames=[20, 20]), still(0.2, 0, 0.2, frames=80)])
    run = play(tmp_path, [TABLE, Thing(name="cube", shape=CUBE, role="driven", path=path)], config=PAPER)
    first = int(np.argmax(run.touched()))
    assert first > 5
    assert run.corrected[-5:].tobytes() == run.recorded[-5:].tobytes()
    after = run.offset("cube")[28:, 2]
    assert after.min() >= 0.0
    assert (np.diff(after) <= 0.0).all()
    assert_free(run)


@pytest.mark.parametrize("method", ["paper", "exact"])
def test_a_fast_hand_through_a_thin_panel_is_missed_and_the_exact_method_stops_it(tmp_path: Path, method: str) -> None:
    """The published weakness: 0.1 m a frame, 5 mm of panel; no frame overlaps, so there is nothing to correct."""
    panel = Thing(name="panel", shape=("box", 0.005, 1, 1))
    path = np.column_stack([np.linspace(-0.95, 0.95, 20), np.zeros((20, 2))])
    ball = Thing(name="ball", shape=("sphere", 0.02), role="driven", path=path)
    run = play(tmp_path, [panel, ball], config=Config(method=method))
    assert run.figures("recorded_penetration_m").max() == 0.0
    if method == "paper":
        assert run.corrected.tobytes() == run.recorded.tobytes()
    else:
        assert run.path("ball")[:, 0].max() < 0.0


def pressed(folder: Path, config: Config, n: int = 100) -> Run:
    """Two fingers that straighten into a table and come back."""
    t = np.linspace(0, 1, n)
    touch = np.clip(4 * t, 0, 1) * np.clip(4 * (0.75 - t), 0, 1)
    angles = -0.4 + 0.4 * touch[:, None] * np.ones(6)
    scene = hand(folder, [finger("a", -0.04, BOX, (-1.5, 0.1)), finger("b", 0.04, BOX)], ["a", "b"])
    return play(
        folder, [TABLE], avatars=scene, roots={"/palm": palm(n, 0.175)},
        angles={"/angles": (names("a", "b"), angles)}, config=config,
    )  # fmt: skip


def test_fingers_pressed_on_a_table_move_by_their_joints_within_limits(tmp_path: Path) -> None:
    run = pressed(tmp_path, PAPER)
    assert run.figures("recorded_penetration_m").max() > 0.005
    assert_free(run, every=3)
    check_limits(run)
    check_kinematics(run, tmp_path)
    assert np.abs(run.angles - run.recorded_angles)[:, columns(run, "a", "b")].max() > 0.05
    assert run.corrected[-3:].tobytes() == run.recorded[-3:].tobytes()
    assert run.corrected[:3].tobytes() == run.recorded[:3].tobytes()


def test_a_limb_that_is_pressed_stays_in_its_reach_cone_and_limits(tmp_path: Path) -> None:
    n = 120
    t = np.linspace(0, 1, n)
    angles = np.zeros((n, 4))
    angles[:, 0] = 0.05
    angles[:, 3] = -0.6
    x = 0.45 - 0.42 * np.clip(3 * np.minimum(t, 1 - t), 0, 1)
    wall = Thing(name="wall", shape=("box", 0.02, 0.3, 0.5), path=np.column_stack([x, np.zeros(n), np.full(n, 0.3)]))
    joints = ["sy", "sx", "sz", "elbow"]
    run = play(
        tmp_path, [wall], avatars=arm(tmp_path), roots={"/root": np.zeros((n, 3))},
        angles={"/angles": (joints, angles)}, config=PAPER,
    )  # fmt: skip
    assert np.abs(run.angles - run.recorded_angles).max() > 0.05
    inside, recorded = cone_angles(run, run.angles), cone_angles(run, run.recorded_angles)
    assert (inside >= np.minimum(0.0, recorded) - 1e-9).all()
    check_limits(run)


def arms(seed: int) -> bytes:
    """Corrected poses of a second in which two arms of one body meet, so that who moves first decides."""
    log, scene = ROOT / "recordings" / "two_arms.mcap", ROOT / "assets" / "scenes" / "two_arms.toml"
    results = geomphys.replay(log, scene, config=Config(method="paper", seed=seed, start=2.5, end=3.5))
    return np.array([r.corrected for r in results]).tobytes()


def test_the_order_of_chains_is_that_of_the_seed() -> None:
    assert arms(0) == arms(0)
    assert arms(0) != arms(7)


def test_what_no_chain_moves_is_moved_by_the_root(tmp_path: Path) -> None:
    """The palm goes into the table: the whole hand is translated, and its fingers keep their angles."""
    n = 60
    height = 0.2 - 0.2 * np.sin(np.linspace(0, np.pi, n))
    scene = hand(tmp_path, [finger("a", -0.04, BOX, (-1.6, 1.7))], ["a"])
    angles = np.tile([-1.57, 0.0, 0.0], (n, 1))
    run = play(
        tmp_path, [TABLE], avatars=scene, roots={"/palm": palm(n, height)},
        angles={"/angles": (names("a"), angles)}, config=PAPER,
    )  # fmt: skip
    assert run.offset("hand/palm")[:, 2].max() > 0.01
    assert np.abs(run.offset("hand/palm")[:, :2]).max() <= 1e-9
    assert_free(run, every=3)


def test_a_replay_has_one_method(tmp_path: Path) -> None:
    """The field of the other is None, so that numba leaves its kernels out."""
    world = play(tmp_path, [TABLE, Thing(name="cube", shape=CUBE, role="driven", path=still(0, 0, 0.2))]).world
    exact, paper = Pipeline(world, Config()).params.method, Pipeline(world, PAPER).params.method
    assert exact.paper is None
    assert paper.exact is None


def test_a_corner_of_three_objects_is_reached_one_after_the_other(tmp_path: Path) -> None:
    walls = [
        Thing(name=f"w{axis}", shape=("box", *np.where(np.arange(3) == axis, 0.1, 2.0)), at=-np.eye(3)[axis] * 0.05)
        for axis in range(3)
    ]
    path = line((0.2, 0.2, 0.2), (0.03, 0.02, 0.04), frames=[30])
    run = play(tmp_path, [*walls, Thing(name="cube", shape=CUBE, role="driven", path=path)], config=PAPER)
    assert run.path("cube")[-1, :3] == pytest.approx([0.05 + GAP] * 3, abs=1e-8)
    assert run.residual.max() <= FREE
