"""Laws of a driven body: free motion is the recording, nothing is passed through, and the spring (6) has a closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.results import FLAG_BLOCKED
from tests.driven.logs import FREE, GAP, Run, Thing, assert_free, chatter, line, play, wander
from tests.scene.models import joint, link, urdf

TABLE = Thing(name="table", shape=("box", 2, 2, 0.1), at=(0, 0, -0.05))
HALF = 0.05
CUBE = ("box", 2 * HALF, 2 * HALF, 2 * HALF)
RATE = 50.0  # 1/s, sqrt(K / m) of the default coupling


def test_free_motion_is_the_recording_bit_for_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    urdf(
        tmp_path / "arm.urdf",
        link("base", '<geometry><box size="0.1 0.1 0.02"/></geometry>'),
        *(
            link(n, '<origin xyz="0 0 0.05"/><geometry><cylinder radius="0.01" length="0.06"/></geometry>')
            for n in "ab"
        ),
        joint("j1", "base", "a", inside='<axis xyz="0 1 0"/>'),
        joint("j2", "a", "b", inside='<axis xyz="0.6 0 0.8"/>'),
    )
    avatar = (
        '[[avatar]]\nname="arm"\nurdf="arm.urdf"\nmode="{}"\nmaterial="human"\n'
        'root={{topic="/wrist"}}\njoints={{topic="/angles"}}\n'
    )
    wrist = wander(rng, 150, 0.3, 1.0) + np.array([0, 0, 3.0, 0, 0, 0, 0])
    free = wander(rng, 150, 0.3, 1.0) + np.array([0, 0, 1.0, 0, 0, 0, 0])
    angles = 1.3 * np.sin(np.arange(150)[:, None] * [0.1, 0.07])  # beyond the limits of ±1 too
    for mode in ("rigid", "chains"):
        run = play(
            tmp_path, [TABLE, Thing(name="mug", shape=CUBE, role="driven", path=free)], avatars=avatar.format(mode),
            roots={"/wrist": wrist}, angles={"/angles": (["j1", "j2"], angles)},
        )  # fmt: skip
        assert run.corrected.tobytes() == run.recorded.tobytes()
        assert run.angles.tobytes() == angles.tobytes()
        assert run.path("mug").tobytes() == free.tobytes()
        assert run.path("arm/base").tobytes() == wrist.tobytes()
        assert run.figures("correction_m").max() == run.figures("contacts").max() == 0.0


@pytest.mark.parametrize("rate", [30.0, 60.0, 240.0])
@pytest.mark.parametrize("mode", ["rigid", "chains"])
def test_what_is_pressed_in_fast_and_then_held_still_stays_at_rest(tmp_path: Path, mode: str, rate: float) -> None:
    """A hand comes down at 0.6 m/s and stops within a frame, 10 mm inside a table; then no link moves by 0.1 mm a frame."""
    avatar = (
        '[[avatar]]\nname="hand"\nurdf="hand.urdf"\nmode="{}"\nmaterial="human"\n'
        'root={{topic="/wrist"}}\njoints={{topic="/angles"}}\n'
    )
    urdf(
        tmp_path / "hand.urdf",
        link("palm", '<geometry><box size="0.1 0.1 0.02"/></geometry>'),
        link("finger", '<origin xyz="0.04 0 0"/><geometry><box size="0.06 0.02 0.02"/></geometry>'),
        joint("knuckle", "palm", "finger", inside='<axis xyz="0 1 0"/>', xyz="0.05 0 0"),
    )
    height = np.concatenate([np.arange(0.06, 0.0, -0.6 / rate), np.full(int(rate), 0.0)])
    run = play(
        tmp_path, [TABLE], avatars=avatar.format(mode), rate=rate,
        roots={"/wrist": np.column_stack([0.0 * height, 0.0 * height, height])},
        angles={"/angles": (["knuckle"], 0.1 + 0.0 * height[:, None])},
    )  # fmt: skip
    assert_free(run)
    at_rest = run.corrected[height == 0.0][1:]
    assert len(at_rest) > 0.9 * rate
    assert np.linalg.norm(np.diff(at_rest[:, :, :3], axis=0), axis=2).max() < 1e-4


@pytest.mark.parametrize("speed", [0.5, 3.0, 20.0])
@pytest.mark.parametrize("spin", [0.0, 9.0])
def test_nothing_passes_a_thin_panel(tmp_path: Path, speed: float, spin: float) -> None:
    """A cube is recorded through a panel of 5 mm and back; it stays on its side and rejoins the recording."""
    there = np.arange(-0.3, 0.3 + speed / 60, speed / 60)
    x = np.concatenate([np.full(4, -0.3), there, np.full(8, there[-1]), there[::-1], np.full(90, -0.3)])
    turns = Rotation.from_rotvec(np.outer(spin * np.arange(len(x)) / 60, [0.6, 0.0, 0.8])).as_quat()
    path = np.column_stack([x, 0.01 * np.sin(x), 0 * x, turns])
    panel = Thing(name="panel", shape=("box", 0.005, 2, 2))
    run = play(tmp_path, [panel, Thing(name="cube", shape=CUBE, role="driven", path=path)])
    corrected = run.path("cube")
    axes = Rotation.from_quat(corrected[:, 3:]).as_matrix()
    front = corrected[:, 0] + HALF * np.abs(axes[:, 0, :]).sum(axis=1)
    assert front.max() <= -0.0025 + FREE
    assert front.max() >= -0.0025 - 1e-4  # it does touch
    assert_free(run)
    assert run.path("cube")[-5:].tobytes() == path[-5:].tobytes()


def pressed(folder: Path, rate: float, still: float = 0.5) -> Run:
    """A cube is put 2 cm into the table, held there, and lifted at once to where it is free."""
    down = line((0.3, 0, 0.1), (0.3, 0, 0.03), frames=[round(0.2 * rate)])
    hold = np.tile([0.3, 0, 0.03], (round(still * rate), 1))
    lifted = np.tile([0.3, 0, 0.2], (round(1.0 * rate), 1))
    path = np.vstack([down, hold, lifted])
    return play(folder, [TABLE, Thing(name="cube", shape=CUBE, role="driven", path=path)], rate=rate)


def test_pressed_into_a_table_it_settles(tmp_path: Path) -> None:
    run = pressed(tmp_path, 60.0)
    z = run.path("cube")[:, 2]
    held = slice(13, 42)
    assert np.abs(z[held] - HALF - GAP).max() <= 2 * GAP
    assert np.abs(np.diff(run.path("cube")[held, :3], axis=0)).max() <= 1e-7
    assert run.figures("recorded_penetration_m")[held] == pytest.approx(0.02, rel=1e-9)
    assert_free(run)


def test_release_follows_the_damped_spring_at_every_frame_rate(tmp_path: Path) -> None:
    """Critically damped from rest: x(t) = x0 (1 + ωt) exp(-ωt): no jump, no overshoot, whatever the rate."""
    for rate in (30.0, 60.0, 120.0, 240.0):
        run = pressed(tmp_path / f"{rate:.0f}", rate)
        last = round(0.7 * rate)  # last pressed frame
        z = run.offset("cube")[last:, 2]
        t = np.arange(len(z)) / rate
        expected = (0.02 + GAP) * (1 + RATE * t) * np.exp(-RATE * t)
        assert np.abs(z - expected).max() <= 0.01 * 0.02
        assert np.abs(z - expected).max() <= 5e-6  # it is exact but for the gap
        assert (np.diff(z) <= 0.0).all()
        assert z.min() >= 0.0
        assert run.path("cube")[-2:].tobytes() == run.recorded[-2:, run.body("cube")].tobytes()


def box_clamped(path: np.ndarray, sides: int) -> np.ndarray:
    """Nearest place of the cube outside `sides` of the half-spaces x < 0, y < 0, z < 0."""
    out = path.copy()
    for axis in [2, 0, 1][:sides]:
        out[:, axis] = np.maximum(out[:, axis], HALF)
    return out


@pytest.mark.parametrize("sides", [2, 3])
def test_in_a_corner_every_plane_holds_and_nothing_chatters(tmp_path: Path, sides: int) -> None:
    walls = [
        TABLE,
        Thing(name="west", shape=("box", 0.1, 2, 2), at=(-0.05, 0, 0)),
        Thing(name="south", shape=("box", 2, 0.1, 2), at=(0, -0.05, 0)),
    ][:sides]
    goal = np.array([0.02, 0.035 if sides == 3 else 0.2, 0.01])
    path = np.vstack([line((0.3, 0.3, 0.3), goal, frames=[25]), np.tile(goal, (40, 1))])
    run = play(tmp_path, [*walls, Thing(name="cube", shape=CUBE, role="driven", path=path)])
    corrected = run.path("cube")[:, :3]
    assert np.abs(corrected[-30:] - box_clamped(path, sides)[-30:]).max() <= 5e-6
    assert np.abs(np.diff(corrected[-30:], axis=0)).max() <= 1e-7
    assert_free(run)


def test_a_slot_narrower_than_the_cube_keeps_it_out(tmp_path: Path) -> None:
    jaws = [Thing(name=n, shape=("box", 0.2, 1, 0.2), at=(x, 0, -0.1)) for n, x in (("left", -0.14), ("right", 0.14))]
    path = np.vstack([line((0.01, 0, 0.2), (0.01, 0, -0.1), frames=[12]), np.tile([0.01, 0, -0.1], (30, 1))])
    run = play(tmp_path, [*jaws, Thing(name="cube", shape=CUBE, role="driven", path=path)])
    assert run.path("cube")[-20:, 2] == pytest.approx(HALF, abs=5e-6)
    assert run.path("cube")[-20:, 0] == pytest.approx(0.01, abs=1e-9)
    assert_free(run)


@pytest.mark.parametrize("lean", [20.0, 45.0, 70.0])
def test_a_ball_between_converging_walls_goes_as_deep_as_it_fits(tmp_path: Path, lean: float) -> None:
    """In a groove of half-angle a, a ball's centre stays r / sin a above the edge."""
    a = np.radians(lean)
    walls = []
    for name, sign in (("left", -1.0), ("right", 1.0)):
        turn = Rotation.from_euler("y", sign * a)  # its inner face passes through the y axis
        walls.append(
            Thing(name=name, shape=("box", 0.2, 1, 2), at=turn.apply([sign * 0.1, 0, 0.0]), turn=turn.as_quat())
        )
    path = np.vstack([line((0.0, 0, 0.6), (0.0, 0, 0.02), frames=[30]), np.tile([0, 0, 0.02], (30, 1))])
    run = play(tmp_path, [*walls, Thing(name="ball", shape=("sphere", 0.05), role="driven", path=path)])
    depth = run.path("ball")[-20:]
    assert depth[:, 2] == pytest.approx(0.05 / np.sin(a), abs=2e-5)
    assert depth[:, 0] == pytest.approx(0.0, abs=2e-5)
    assert np.abs(np.diff(depth[:, :3], axis=0)).max() <= 1e-6
    assert_free(run)


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_a_table_cut_in_twenty_feels_like_one(tmp_path: Path, tilt: float) -> None:
    turn = Rotation.from_euler("xy", [tilt, 0.5 * tilt]).as_quat()
    n = 200
    path = np.column_stack(
        [
            np.linspace(-0.9, 0.9, n),
            0.05 * np.sin(np.arange(n) / 20),
            0.02 + 0.01 * np.cos(np.arange(n) / 15),
            np.tile(turn, (n, 1)),
        ]
    )
    cube = Thing(name="cube", shape=CUBE, role="driven", path=path)
    cut = [Thing(name=f"top{k}", shape=("box", 0.1, 2, 0.1), at=(-0.95 + 0.1 * k, 0, -0.05)) for k in range(20)]
    one, many = play(tmp_path / "one", [TABLE, cube]), play(tmp_path / "many", [*cut, cube])
    assert np.abs(one.path("cube") - many.path("cube")).max() <= 1e-5
    assert_free(many)


@pytest.mark.parametrize("shape", [("sphere", 0.1), ("cylinder", 0.1, 0.6)], ids=["sphere", "cylinder"])
def test_sliding_round_a_round_thing_does_not_chatter(tmp_path: Path, shape: tuple[str, float]) -> None:
    n, step = 160, 0.03
    angle = step * np.arange(n)
    path = np.column_stack([0.09 * np.cos(angle), 0.09 * np.sin(angle), 0 * angle])
    run = play(
        tmp_path, [Thing(name="post", shape=shape), Thing(name="tip", shape=("sphere", 0.02), role="driven", path=path)]
    )
    centre = run.path("tip")[40:, :3]
    radius = np.linalg.norm(centre, axis=1)
    assert np.abs(radius - 0.12 - GAP).max() <= 5e-6
    assert chatter(centre) <= 1.2 * 0.12 * step**2  # what the circle itself needs, and a bit
    assert_free(run)


def beside_the_springs_way(run: Run, name: str) -> np.ndarray:
    """(n - 1,) m: change of a body's offset from frame to frame, less the part that the spring alone takes straight back."""
    offset = (run.path(name) - run.recorded[:, run.body(name)])[:, :3]
    change, size = np.diff(offset, axis=0), np.linalg.norm(offset[:-1], axis=1)
    out = offset[:-1] / np.where(size > 0, size, 1.0)[:, None]
    back = np.clip(-np.sum(change * out, axis=1), 0.0, (1 - np.exp(-50 / 60)) * size)
    return np.linalg.norm(change + back[:, None] * out, axis=1)


def test_what_slides_round_a_post_does_not_whip_round_it(tmp_path: Path) -> None:
    """Recorded straight through a post, a ball comes round it at a pace and is where it was recorded in the end."""
    n = 420
    x = np.clip(np.linspace(-0.3, 20.0, n), None, 0.13)
    path = np.column_stack([x, np.full(n, 0.001), np.zeros(n)])
    post = Thing(name="post", shape=("cylinder", 0.08, 1.0))
    run = play(tmp_path, [post, Thing(name="ball", shape=("sphere", 0.03), role="driven", path=path)])
    assert run.figures("recorded_penetration_m").max() > 0.08
    motion = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert (beside_the_springs_way(run, "ball") <= 2 * motion + 2e-3).all()
    assert_free(run, every=3)
    assert run.path("ball")[-3:].tobytes() == run.recorded[-3:, run.body("ball")].tobytes()


def test_a_body_behind_a_wall_says_that_it_is_blocked(tmp_path: Path) -> None:
    """Recorded into a closed box and out again: it waits outside, says so while its recorded place is free, and rejoins."""
    n = 150
    x = np.interp(np.arange(n), [0, 30, 80, 110], [-0.6, 0.0, 0.0, -0.6])
    path = np.column_stack([x, np.zeros(n), np.zeros(n)])
    walls = [
        Thing(
            name=f"wall{axis}{sign}",
            shape=("box", *np.where(np.arange(3) == axis, 0.005, 0.4)),
            at=0.2 * sign * np.eye(3)[axis],
        )
        for axis in range(3)
        for sign in (-1, 1)
    ]
    run = play(tmp_path, [*walls, Thing(name="cube", shape=("box", 0.1, 0.1, 0.1), role="driven", path=path)])
    blocked = (run.figures("flags").astype(int) & FLAG_BLOCKED) != 0
    free = run.figures("recorded_penetration_m") == 0.0
    inside = x > -0.1
    assert blocked[inside & free].all()
    assert (inside & free).sum() > 50
    assert not blocked[x < -0.26].any()
    assert run.path("cube")[:, 0].max() <= -0.25
    assert np.abs(np.diff(run.path("cube")[35:75], axis=0)).max() <= 1e-9
    assert run.path("cube")[-5:].tobytes() == run.recorded[-5:, run.body("cube")].tobytes()
    told = [text for result in run.results for level, text in result.messages if level == "info"]
    assert told == ["something stands between a body and its recorded place"]


@pytest.mark.parametrize("fingers", [0, 1, 3])
def test_a_hand_without_limbs_is_corrected_in_chains_mode_too(tmp_path: Path, fingers: int) -> None:
    """A body without joints yields as in rigid mode, bit for bit; fingers of one joint bend."""
    finger = '<origin xyz="0.03 0 0" rpy="0 1.5708 0"/><geometry><cylinder radius="0.008" length="0.05"/></geometry>'
    parts = [link("palm", '<geometry><box size="0.08 0.1 0.03"/></geometry>')]
    for k in range(fingers):
        inside = '<axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" effort="1" velocity="1"/>'
        parts += [
            link(f"f{k}", finger),
            joint(f"j{k}", "palm", f"f{k}", inside=inside, xyz=f"0.045 {0.03 * k - 0.03} 0"),
        ]
    urdf(tmp_path / "hand.urdf", *parts)
    n, names = 100, [f"j{k}" for k in range(fingers)]
    turn = Rotation.from_euler("zyx", [0.5, 0.2, 0.1]).as_quat()
    t = np.linspace(0, 1, n)
    path = np.column_stack([t - 0.5, 0.1 * t, 0.02 + 0.015 * np.cos(12 * t), np.tile(turn, (n, 1))])
    angles = 0.35 * np.sin(np.outer(t, np.arange(12, 12 + 3 * fingers, 3)) + np.arange(fingers))
    runs = {}
    for mode in ("rigid", "chains"):
        avatar = f'[[avatar]]\nname="h"\nurdf="hand.urdf"\nmode="{mode}"\nmaterial="human"\nroot={{topic="/w"}}\n'
        avatar += 'joints={topic="/a"}\n' if fingers else ""
        runs[mode] = play(
            tmp_path, [TABLE], avatars=avatar, roots={"/w": path}, angles={"/a": (names, angles)} if fingers else None
        )
        assert_free(runs[mode])
        assert runs[mode].figures("recorded_penetration_m").max() > 0.02
    if fingers == 0:
        assert runs["chains"].corrected.tobytes() == runs["rigid"].corrected.tobytes()
    else:
        assert np.abs(runs["chains"].angles - angles).max() > 0.05
        lifted = [run.offset("h/palm")[:, 2].max() for run in (runs["chains"], runs["rigid"])]
        assert lifted[0] < lifted[1]
