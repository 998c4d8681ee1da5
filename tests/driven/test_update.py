"""The driven loop: starts inside, wedged places, flags."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.config import Config
from geomphys.driven.coupling import relax
from geomphys.driven.state import NEVER_FREE, STARTED_FREE
from geomphys.driven.update import separate_driven, update_driven
from geomphys.engine.state import make_replay_data
from geomphys.engine.step import measure_recorded, pose_recording
from geomphys.jit.packed_records import pack
from geomphys.results import FLAG_NOT_CONVERGED, FLAG_STARTED_INSIDE
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box
from tests.driven.logs import FREE, Thing, assert_free, line, play
from tests.simulated import scenes

CUBE = ("box", 0.1, 0.1, 0.1)
TABLE = Thing(name="table", shape=("box", 2, 2, 0.1), at=(0, 0, -0.05))


def still(*pose: float, frames: int = 20) -> np.ndarray:
    return np.tile(np.array(pose, float), (frames, 1))


def test_a_start_inside_is_freed_the_shortest_way_and_flagged(tmp_path: Path) -> None:
    turn = Rotation.from_euler("xyz", [0.3, 0.2, 0.1])
    low = np.abs(turn.as_matrix()[2]).sum() * 0.05  # the lowest corner's depth under the centre
    run = play(
        tmp_path, [TABLE, Thing(name="cube", shape=CUBE, role="driven", path=still(0.1, 0.2, 0.02, *turn.as_quat()))]
    )
    flags = run.figures("flags").astype(int)
    assert flags[0] & FLAG_STARTED_INSIDE
    assert not (flags[1:] & FLAG_STARTED_INSIDE).any()
    assert run.offset("cube")[:, 2] == pytest.approx(low - 0.02, abs=5e-6)
    assert np.abs(run.offset("cube")[:, :2]).max() <= 1e-9
    assert "starts inside" in run.results[0].messages[0][1]
    assert_free(run)


def test_a_free_start_is_not_flagged(tmp_path: Path) -> None:
    run = play(tmp_path, [TABLE, Thing(name="cube", shape=CUBE, role="driven", path=still(0, 0, 0.2))])
    assert not run.figures("flags").any()
    assert not any(r.messages for r in run.results)


def test_a_start_between_two_walls_too_near_is_freed_along_them(tmp_path: Path) -> None:
    """The normals cancel; the way out is up, 6 cm, where the walls end."""
    walls = [Thing(name=n, shape=("box", 0.1, 1, 0.4), at=(x, 0, -0.2)) for n, x in (("left", -0.09), ("right", 0.09))]
    path = still(0.0, 0.0, -0.01)
    run = play(tmp_path, [*walls, Thing(name="cube", shape=CUBE, role="driven", path=path)])
    assert np.linalg.norm(run.offset("cube")[0]) <= 1.1 * 0.06
    assert_free(run)


def test_a_start_inside_is_freed_even_behind_what_stands_in_the_way_out(tmp_path: Path) -> None:
    """The way out of a block leads into a plate behind it; nothing was anywhere before, so it may lead through that."""
    things = [
        Thing(name="block", shape=("box", 0.06, 0.4, 0.4)),
        Thing(name="plate", shape=("box", 0.004, 0.4, 0.4), at=(0.034, 0, 0)),
        Thing(name="cube", shape=("box", 0.02, 0.02, 0.02), role="driven", path=still(0.005, 0, 0)),
    ]
    run = play(tmp_path, things)
    assert run.path("cube")[0, 0] == pytest.approx(0.046, abs=5e-6)
    assert_free(run)


def test_recorded_inside_a_closed_box_it_holds_its_last_place(tmp_path: Path) -> None:
    """Six walls with no room inside: the hand stays outside, and is the recording again once that is outside."""
    h, t = 0.15, 0.02
    walls = [
        Thing(
            name=f"w{axis}{sign}",
            shape=("box", *np.where(np.arange(3) == axis, t, 2 * h)),
            at=np.eye(3)[axis] * sign * h,
        )
        for axis in range(3)
        for sign in (-1, 1)
    ]
    path = np.vstack([line((0.5, 0.01, 0), (0.0, 0.0, 0), (0.5, 0, 0), frames=[20, 20]), still(0.5, 0, 0, frames=60)])
    run = play(tmp_path, [*walls, Thing(name="cube", shape=CUBE, role="driven", path=path)])
    assert run.path("cube")[:, 0].min() >= h + t / 2 + 0.05 - FREE
    assert run.path("cube")[-1].tobytes() == run.recorded[-1, run.body("cube")].tobytes()
    assert_free(run)


def test_one_round_is_enough_for_one_plane_and_is_reported_if_not(tmp_path: Path) -> None:
    path = line((0, 0, 0.2), (0, 0, 0.0), frames=[20])
    run = play(
        tmp_path, [TABLE, Thing(name="cube", shape=CUBE, role="driven", path=path)], config=Config(max_iterations=1)
    )
    flagged = run.figures("flags").astype(int) & FLAG_NOT_CONVERGED
    over = run.residual > FREE
    assert not (over & (flagged == 0)).any()


def test_a_rigid_coupling_returns_at_once(tmp_path: Path) -> None:
    urdf = tmp_path / "ball.urdf"
    urdf.write_text(
        '<robot name="m"><link name="ball"><collision><geometry><sphere radius="0.05"/></geometry></collision></link></robot>'
    )
    avatar = '[[avatar]]\nname="hand"\nurdf="ball.urdf"\nmaterial="human"\ncoupling="rigid"\nroot={topic="/wrist"}\n'
    path = np.vstack([line((0, 0, 0.2), (0, 0, 0.02), frames=[10]), still(0, 0, 0.02), still(0, 0, 0.2)])
    run = play(tmp_path, [TABLE], avatars=avatar, roots={"/wrist": path})
    assert run.offset("hand/ball")[20, 2] == pytest.approx(0.03, abs=5e-6)
    assert run.corrected[31:].tobytes() == run.recorded[31:].tobytes()
    assert_free(run)


def test_what_goes_round_a_corner_of_a_body_between_two_frames_pushes_it(tmp_path: Path) -> None:
    """A block is beside a cube in one frame and before it in the next; straight between them it cuts the cube's corner."""
    away = np.array([[0.101, 0.04, 0.0]] * 5 + [[0.05, 0.101, 0.0]] * 100)
    things = [
        Thing(name="block", shape=CUBE, path=away),
        Thing(name="cube", shape=CUBE, role="driven", path=np.zeros_like(away)),
    ]
    run = play(tmp_path, things)
    offset = np.linalg.norm(run.offset("cube"), axis=1)
    assert run.figures("recorded_penetration_m").max() == 0.0
    assert (offset[:5] == 0.0).all()
    assert offset[5] > 1e-3
    assert (offset[-10:] == 0.0).all()


GAP, DT, HALF = 2e-6, 1 / 60, 0.05
BOX = Box((HALF, HALF, HALF))


class Loop:
    """The driven loop of cubes, called frame by frame without a log."""

    def __init__(self, *things: scenes.Thing) -> None:
        self.made = scenes.make_scene(things)
        self.data = make_replay_data(self.made)
        self.scene, self.packed = pack(self.made), pack(self.data)
        self.roots, self.angles = self.made.trees.rest.copy(), np.zeros(0)

    def update(self, dt: float = DT, **at: tuple[float, ...]) -> tuple[int, int, bool, bool]:
        """A frame in which trees ("t0", "t1", …) are recorded at positions; returns the outcome."""
        for name, position in at.items():
            self.roots[int(name[1:]), :3] = position
        pose_recording(self.scene, self.packed, self.roots, self.angles)
        measure_recorded(self.scene, self.packed)
        m = self.packed
        return tuple(  # type: ignore[return-value]
            update_driven(self.scene, m.driven, m.workspace, self.roots, self.angles, m.recorded, dt, GAP)
        )

    def position(self, tree: int) -> np.ndarray:
        return np.asarray(self.data.driven.last.poses[tree, :3])


def cube(*at: float, role: int = s.DRIVEN, moving: bool = False) -> scenes.Thing:
    return scenes.Thing(shape=BOX, role=role, at=at, moving=moving)


def test_a_frame_is_taken_as_it_is_where_it_is_free_and_reachable() -> None:
    loop = Loop(cube(0, 0, 0.2), scenes.floor())
    for position in ((0.1, 0.2, 0.3), (0.123, 0.2, 0.07), (-0.4, 0.2, 0.05 + 1e-5)):
        assert loop.update(t0=position) == (0, 0, True, False)
        assert loop.position(0).tolist() == list(position)
        assert not loop.data.driven.offset.any()
    assert loop.data.driven.progress["start"] == STARTED_FREE
    assert loop.data.driven.progress["updates"] == 3


def test_a_pressed_cube_stands_on_the_floor_and_follows_across_it() -> None:
    loop = Loop(cube(0, 0, 0.2), scenes.floor())
    loop.update(t0=(0, 0, 0.2))
    for _ in range(3):
        loop.update(t0=(0, 0, HALF - 0.01))
    for k in range(5):
        _, fallbacks, converged, _ = loop.update(t0=(0.01 * k, 0, HALF - 0.01))
        assert (fallbacks, converged) == (0, True)
        assert loop.position(0)[:2] == pytest.approx([0.01 * k, 0], abs=2e-5)
        assert loop.position(0)[2] == pytest.approx(HALF + GAP, abs=1e-6)
        assert loop.data.driven.offset[0, 2] == pytest.approx(0.01 + GAP, abs=1e-6)


def test_an_offset_relaxes_by_the_coupling_when_the_recording_is_free_again() -> None:
    loop = Loop(cube(0, 0, 0.2), scenes.floor())
    loop.update(t0=(0, 0, 0.2))
    loop.update(t0=(0, 0, HALF - 0.01))
    state = loop.data.driven
    x, v = float(state.offset[0, 2]), float(state.offset_velocity[0, 2])
    loop.update(t0=(0, 0, 0.3))
    expected, _ = relax(x, v, 0.4, 1000.0, 40.0, DT)
    assert loop.position(0)[2] - 0.3 == pytest.approx(expected, abs=1e-12)
    for _ in range(60):
        loop.update(t0=(0.1, 0, 0.3))
    assert loop.position(0).tolist() == [0.1, 0, 0.3]


def test_two_driven_cubes_that_meet_yield_alike_and_a_third_does_not() -> None:
    loop = Loop(cube(-0.2, 0, 0.5), cube(0.2, 0, 0.5), cube(0, 1, 0.5))
    loop.update()
    loop.update(t0=(-0.04, 0, 0.5), t1=(0.04, 0, 0.5), t2=(0, 0.9, 0.5))
    left, right = loop.position(0)[0], loop.position(1)[0]
    assert right - left == pytest.approx(2 * HALF + GAP, abs=1e-6)
    assert left + right == pytest.approx(0.0, abs=1e-4)
    assert loop.position(2).tolist() == [0, 0.9, 0.5]


def test_a_cube_stays_on_its_side_of_a_thin_wall() -> None:
    wall = scenes.Thing(shape=Box((0.001, 1.0, 1.0)), role=s.FIXED)
    loop = Loop(cube(-0.3, 0, 0), wall)
    loop.update()
    loop.update(t0=(0.5, 0, 0))
    assert loop.position(0)[0] == pytest.approx(-0.001 - HALF - GAP, abs=1e-6)


def test_a_first_frame_that_is_never_free_says_so_and_the_next_is_again_a_first() -> None:
    """Six plates round the cube, thicker than any depenetration goes."""
    plates = [
        scenes.Thing(shape=Box((2.0, 2.0, 2.0)), role=s.FIXED, at=tuple(sign * 2.04 * np.eye(3)[axis]))
        for axis in range(3)
        for sign in (1.0, -1.0)
    ]
    loop = Loop(cube(0, 0, 0), *plates)
    converged = loop.update()[2]
    assert not converged
    assert loop.data.driven.progress["start"] == NEVER_FREE
    loop.data.driven.offset_velocity[0] = 1.0
    loop.update()
    assert not loop.data.driven.offset_velocity[0].any()


def test_a_step_divided_for_one_cube_is_a_whole_one_for_the_next(tmp_path: Path) -> None:
    """Two plates close on a cube, nearer than it is wide; far off, in the same frame, a thin wall comes from behind another."""
    moved = np.repeat([0.0, 1.0], [5, 10])[:, None]
    plates = {
        "west": ((0.02, 0.4, 0.4), (-0.07, 0.0, 0.0), (0.03, 0.0, 0.0)),
        "east": ((0.02, 0.4, 0.4), (0.07, 0.0, 0.0), (-0.03, 0.0, 0.0)),
        "wall": ((0.004, 0.4, 0.4), (4.92, 0.0, 0.0), (0.4, 0.0, 0.0)),
    }
    things = [
        Thing(name="first", shape=CUBE, role="driven", path=still(0, 0, 0, frames=15)),
        Thing(name="second", shape=CUBE, role="driven", path=still(5, 0, 0, frames=15)),
        *(Thing(name=n, shape=("box", *size), path=at + moved * by) for n, (size, at, by) in plates.items()),
    ]
    run = play(tmp_path, things)
    assert_free(run)
    assert run.figures("fallbacks")[5] >= 2
    assert run.path("second")[5, 0] == pytest.approx(5.372, abs=1e-4)


@pytest.mark.parametrize("axis", range(3))
def test_a_cube_is_moved_out_of_what_has_moved_into_it_by_the_depth(axis: int) -> None:
    loop = Loop(cube(0, 0, 0), cube(*(-0.2 * np.eye(3)[axis]), role=s.FIXED, moving=True))
    loop.update()
    m = loop.data
    m.recorded[1, axis] = -2 * HALF + 0.006
    assert separate_driven(loop.scene, loop.packed.driven, loop.packed.workspace, loop.packed.recorded, GAP) > 0
    assert loop.position(0) == pytest.approx((0.006 + GAP) * np.eye(3)[axis], abs=1e-6)
    assert m.driven.offset[0] == pytest.approx((0.006 + GAP) * np.eye(3)[axis], abs=1e-6)
    before = loop.position(0).copy()
    assert separate_driven(loop.scene, loop.packed.driven, loop.packed.workspace, loop.packed.recorded, GAP) == 0
    assert np.array_equal(loop.position(0), before)


def test_a_cube_on_which_two_plates_have_closed_since_is_put_where_it_is_free() -> None:
    """They leave it no room between them; the way out is along them."""
    plates = [
        scenes.Thing(shape=Box((HALF, 2 * HALF, 2 * HALF)), role=s.FIXED, at=(x, 0, 0), moving=True)
        for x in (-2.2 * HALF, 2.2 * HALF)
    ]
    loop = Loop(cube(0, 0, 0), *plates)
    loop.update()
    loop.data.recorded[1:3, 0] = -1.8 * HALF, 1.8 * HALF
    assert separate_driven(loop.scene, loop.packed.driven, loop.packed.workspace, loop.packed.recorded, GAP) > 0
    out = np.abs(loop.position(0)).max()
    assert 3 * HALF <= out <= 3 * HALF + 1e-4
