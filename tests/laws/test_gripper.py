"""A parallel gripper grips by its joints: forces, what it carries, limits of effort, and `squeeze`."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.config import Config
from geomphys.load import load_world
from geomphys.replays import replay
from tests.laws.replayed import Run, floor, thing
from tests.laws.test_grasp import CUBE, HALF, LIFTED, SLIP, Grasp, frictions, ramp
from tests.recording.log_files import joints, pose, write_log

BOX = '<collision><origin xyz="{}"/><geometry><box size="{}"/></geometry></collision>'


def write_gripper(path: Path, effort: float, mimic: bool) -> None:
    """A palm and two fingers on prismatic joints that close along x; one follows the other if it is to `mimic` it."""
    links = f'<link name="palm">{BOX.format("0 0 0", "0.12 0.05 0.03")}</link>'
    parts = [links]
    for name, x, axis in (("left", -0.065, 1), ("right", 0.065, -1)):
        follows = '<mimic joint="slide_left"/>' if mimic and name == "right" else ""
        parts.append(f'<link name="{name}">{BOX.format("0 0 -0.045", "0.02 0.04 0.06")}</link>')
        parts.append(
            f'<joint name="slide_{name}" type="prismatic"><parent link="palm"/><child link="{name}"/>'
            f'<origin xyz="{x} 0 -0.016"/><axis xyz="{axis} 0 0"/>'
            f'<limit lower="-0.02" upper="0.08" effort="{effort}" velocity="1"/>{follows}</joint>'
        )
    path.write_text(f'<robot name="gripper">{"".join(parts)}</robot>')


def write_fingers(path: Path) -> None:
    """A palm and two fingers of two revolute joints each, about y, that hang straight down."""
    parts = [f'<link name="palm">{BOX.format("0 0 0", "0.14 0.05 0.03")}</link>']
    for name, x in (("left", -0.065), ("right", 0.065)):
        links = (
            ("palm", f"{name}_upper", f"{x} 0 -0.016", "0 0 -0.02"),
            (f"{name}_upper", name, "0 0 -0.05", "0 0 -0.03"),
        )
        for parent, link, at, middle in links:
            parts.append(
                f'<link name="{link}">{BOX.format(middle, "0.02 0.04 0.03" if link != name else "0.02 0.04 0.04")}</link>'
            )
            parts.append(
                f'<joint name="turn_{link}" type="revolute"><parent link="{parent}"/><child link="{link}"/>'
                f'<origin xyz="{at}"/><axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" effort="100" velocity="9"/></joint>'
            )
    path.write_text(f'<robot name="fingers">{"".join(parts)}</robot>')


def grip(
    folder: Path, mode: str, *, rate: int = 60, squeeze: float = 0.005, seconds: float = 3.0, effort: float = 100.0,
    mimic: bool = False, about: tuple[float, float, float] = (0.0, 0.0, 0.0), keys: str = "",
    along: float = 0.0, less: float = 0.0,
) -> Grasp:  # fmt: skip
    """It closes on a cube by 1 s, deeper than its surface by `squeeze`, lifts it 20 cm by 2.3 s; then turns or carries it.

    The right finger closes by `less` [m] than the left one.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_gripper(folder / "gripper.urdf", effort, mimic)
    avatar = (
        f'[[avatar]]\nname = "gripper"\nurdf = "gripper.urdf"\nmode = "{mode}"\nmaterial = "human"\n{keys}\n'
        'root = { topic = "/root" }\njoints = { topic = "/joints" }\n'
    )
    things = thing("thing", position=(0, 0, HALF), **CUBE) + floor(material="metal")
    (folder / "scene.toml").write_text(f'[scene]\nname = "gripper"\n{frictions(0.8)}{avatar}{things}')
    items = []
    for t in np.arange(round(seconds * rate) + 1) / rate:
        share = ramp(t, LIFTED, LIFTED + 1.0, 1.0)
        turn = Rotation.from_rotvec(np.array(about) * share)
        at = np.array([along * share, 0, HALF + ramp(t, 1.3, 2.3, 0.2)]) + turn.apply([0, 0, 0.068])
        closed = ramp(t, 0.3, 1.0, 0.055 - HALF + squeeze)
        names = ("slide_left",) if mimic else ("slide_left", "slide_right")
        items.append(pose("/root", 1.0 + t, [float(x) for x in (*at, *turn.as_quat())]))
        ways = dict.fromkeys(names, closed)
        if less != 0.0:
            ways["slide_right"] = min(closed, 0.055 - HALF + squeeze - less)
        items.append(joints("/joints", 1.0 + t, ways))
    write_log(folder / "log.mcap", items, encoding="protobuf")
    world = load_world(folder / "scene.toml")
    return Grasp(
        Run(world, list(replay(folder / "log.mcap", world, config=Config()))), rate, "gripper/left", "gripper/right"
    )


@pytest.mark.parametrize("rate", [30, 60, 120, 240])
@pytest.mark.parametrize("mode", ["chains", "rigid"])
@pytest.mark.parametrize("mimic", [False, True])
def test_fingers_press_by_stiffness_times_depth_and_lift(tmp_path: Path, mode: str, rate: int, mimic: bool) -> None:
    done = grip(tmp_path, mode, rate=rate, mimic=mimic)
    for t in (1.25, 3.0):
        for finger in (done.left, done.right):
            assert done.force(finger, t) == pytest.approx(5.0, rel=0.01)
    assert done.slip(1.25, 3.0) < SLIP
    assert done.run.path("thing")[-1, 2] == pytest.approx(HALF + 0.2 - 0.2 * 9.81 / 1000, abs=2e-5)


@pytest.mark.parametrize("rate", [30, 240])
def test_joints_that_yield_one_after_the_other_press_by_stiffness_times_depth(tmp_path: Path, rate: int) -> None:
    write_fingers(tmp_path / "fingers.urdf")
    avatar = (
        '[[avatar]]\nname = "fingers"\nurdf = "fingers.urdf"\nmode = "chains"\nmaterial = "human"\n'
        'root = { topic = "/root" }\njoints = { topic = "/joints" }\n'
    )
    things = thing("thing", position=(0, 0, HALF), **CUBE) + floor(material="metal")
    (tmp_path / "scene.toml").write_text(f'[scene]\nname = "fingers"\n{frictions(0.02)}{avatar}{things}')
    items = []
    for t in np.arange(2 * rate + 1) / rate:
        angle = math.asin(ramp(t, 0.3, 1.0, 0.055 - HALF + 0.005) / 0.05)  # the last links stay upright
        inwards = {"left": -1.0, "right": 1.0}
        values = {f"turn_{n}_upper": s * angle for n, s in inwards.items()} | {
            f"turn_{n}": -s * angle for n, s in inwards.items()
        }
        items.append(pose("/root", 1.0 + t, [0, 0, HALF + 0.016 + 0.03 + 0.05 * math.cos(angle), 0, 0, 0, 1]))
        items.append(joints("/joints", 1.0 + t, values))
    write_log(tmp_path / "log.mcap", items, encoding="protobuf")
    world = load_world(tmp_path / "scene.toml")
    run = Run(world, list(replay(tmp_path / "log.mcap", world, config=Config())))
    done = Grasp(run, rate, "fingers/left", "fingers/right")
    for finger in (done.left, done.right):
        assert done.force(finger, 1.9) == pytest.approx(5.0, rel=0.1)


@pytest.mark.parametrize("about", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)])
def test_what_it_holds_is_turned_and_carried(tmp_path: Path, about: tuple[float, float, float]) -> None:
    turn = tuple(0.5 * math.pi * x for x in about)
    done = grip(tmp_path, "chains", about=turn, seconds=4.0, along=0.3)
    assert done.slip(1.25, 4.0) < SLIP


@pytest.mark.parametrize("rate", [30, 60, 240])
def test_a_joint_presses_with_no_more_than_its_effort(tmp_path: Path, rate: int) -> None:
    done = grip(tmp_path, "chains", rate=rate, squeeze=0.012, effort=8.0)
    assert done.force(done.left, 3.0) == pytest.approx(8.0, rel=0.01)
    assert done.slip(1.25, 3.0) < SLIP


def test_an_avatars_effort_is_that_of_joints_without_one(tmp_path: Path) -> None:
    done = grip(tmp_path, "chains", squeeze=0.012, effort=0.0, keys="effort_n = 6.0")
    assert done.force(done.left, 3.0) == pytest.approx(6.0, rel=0.01)


@pytest.mark.parametrize("recorded", [0.0005, 0.003])
def test_squeeze_presses_as_if_it_had_been_recorded_deeper(tmp_path: Path, recorded: float) -> None:
    done = grip(tmp_path, "chains", squeeze=recorded, keys="squeeze = 0.006")
    assert done.force(done.left, 3.0) == pytest.approx(1000 * (recorded + 0.006), rel=0.01)
    assert done.slip(1.25, 3.0) < SLIP


@pytest.mark.parametrize("rate", [30, 60, 240])
def test_squeeze_reaches_what_a_finger_beside_one_that_touches_was_recorded_short_of(tmp_path: Path, rate: int) -> None:
    """Left recorded 0.2 mm inside, right 0.45 mm short, of a cube that friction with the floor keeps where it is.

    The root yields by d: with 0.5 mm more they press with 0.7 N - K d and 0.05 N + K d, which differ by K d.
    """
    done = grip(tmp_path, "chains", rate=rate, squeeze=0.0002, less=0.00065, keys="squeeze = 0.0005", seconds=1.3)
    assert done.run.drift("thing")[0] < 1e-5
    assert done.force(done.left, 1.25) == pytest.approx(0.7 - 0.65 / 3, rel=0.02)
    assert done.force(done.right, 1.25) == pytest.approx(0.05 + 0.65 / 3, rel=0.02)


def test_squeeze_leaves_a_hand_that_touches_nothing_as_it_was_recorded(tmp_path: Path) -> None:
    done = grip(tmp_path, "chains", squeeze=-0.001, keys="squeeze = 0.006", seconds=1.5)
    for result in done.run.results:
        for name in ("gripper/left", "gripper/right"):
            body = done.run.world.body_names.index(name)
            np.testing.assert_array_equal(result.corrected[body], result.recorded[body])
    assert done.run.path("thing")[-1, 2] == pytest.approx(HALF, abs=1e-5)
