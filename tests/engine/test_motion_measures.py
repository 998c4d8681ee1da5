"""Measures of motion quality of a frame, against numpy and coal on the recorded and corrected poses of a hand at a box."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.config import Config
from geomphys.engine.fingertips import thumbs_of
from geomphys.load import load_world
from tests.driven.logs import Engine, Run, Thing, line, play

FINGERS = {"thumb": -0.03, "index": 0.02, "ring": 0.045}
"""Finger -> m, its place across the palm; each has two joints and closes over the box in front of it."""
JOINTS = [f"{finger}_{segment}" for finger in FINGERS for segment in ("proximal", "distal")]


def urdf() -> str:
    links = ['<link name="palm"><collision><geometry><box size="0.03 0.11 0.02"/></geometry></collision></link>']
    for finger, across in FINGERS.items():
        parent, at = "palm", f"0.02 {across} 0"
        for segment in ("proximal", "distal"):
            name = f"{finger}_{segment}"
            links.append(
                f'<link name="{name}"><collision><origin xyz="0.02 0 0" rpy="0 1.5707963267948966 0"/>'
                '<geometry><cylinder radius="0.007" length="0.03"/></geometry></collision></link>'
                f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/>'
                f'<origin xyz="{at}"/><axis xyz="0 1 0"/><limit lower="-0.5" upper="2.2" effort="1" velocity="1"/></joint>'
            )
            parent, at = name, "0.042 0 0"
        links.append(  # a pad that is fixed to the tip: it is in contact when the tip is
            f'<link name="{finger}_pad"><collision><geometry><sphere radius="0.008"/></geometry></collision></link>'
            f'<joint name="{finger}_pad" type="fixed"><parent link="{parent}"/><child link="{finger}_pad"/>'
            '<origin xyz="0.04 0 0"/></joint>'
        )
    return '<robot name="hand">' + "".join(links) + "</robot>"


def hand_at_a_box(folder: Path, mode: str) -> Run:
    """A hand comes down onto a box, its fingers close into it at different times, and open again."""
    (folder / "hand.urdf").write_text(urdf())
    avatar = (
        f'[[avatar]]\nname = "hand"\nurdf = "hand.urdf"\nmode = "{mode}"\nmaterial = "human"\n'
        'root = { topic = "/wrist" }\njoints = { topic = "/glove" }\n'
    )
    count = 90
    root = line((0.0, 0.0, 0.10), (0.0, 0.0, 0.06), (0.01, 0.0, 0.055), frames=(30, count - 31))
    t = np.linspace(0.0, 1.0, count)[:, None]
    closing = np.sin(np.pi * np.clip(1.6 * t - np.array([0.3, 0.3, 0.25, 0.25, 0.5, 0.5]), 0.0, 1.0))
    angles = closing * np.array([0.7, 0.5, 0.8, 0.5, 0.6, 0.7])
    box = Thing(name="box", shape=("box", 0.3, 0.2, 0.06), at=(0.12, 0.0, 0.0))
    return play(
        folder,
        [box],
        avatars=avatar,
        roots={"/wrist": root},
        angles={"/glove": (JOINTS, angles)},
        config=Config(mode=mode),
    )


@pytest.fixture(scope="module", params=["rigid", "chains"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    return hand_at_a_box(tmp_path_factory.mktemp(request.param), request.param)


def gaps(run: Run, poses: np.ndarray) -> np.ndarray:
    """(N, F) m, smallest gap of each fingertip (with its pad) to the box, by coal."""
    engine, scene = Engine(run.world), run.world.scene
    of = [[f"hand/{finger}_distal", f"hand/{finger}_pad"] for finger in FINGERS]
    tips = [[i for name in names for i in pieces_of(run, name)] for names in of]
    (box,) = pieces_of(run, "box")
    frames = [engine.frames(row) for row in poses]
    assert len(scene.trees.role) == 2
    return np.array([[min(engine.gap(i, box, f) for i in tip) for tip in tips] for f in frames])


def pieces_of(run: Run, name: str) -> range:
    body, start = run.body(name), run.world.scene.bodies.piece_start
    return range(int(start[body]), int(start[body + 1]))


def test_contacts_and_grasps(run: Run) -> None:
    before, after = gaps(run, run.recorded), gaps(run, run.corrected)
    clear = np.abs(before - 2e-3).min(axis=1) > 1e-5  # of the threshold, where coal and the package may differ
    clear &= (np.abs(after - np.maximum(1e-3, before + 1e-6)) > 1e-5).all(axis=1) | (run.recorded == run.corrected).all(
        axis=(1, 2)
    )
    touches = before <= 2e-3
    kept = touches & (after <= np.maximum(1e-3, before + 2e-6))
    assert clear.sum() > 60
    assert 10 < touches.any(axis=1)[clear].sum() < clear.sum() - 10
    assert (run.figures("contacts_recorded") == touches.sum(axis=1))[clear].all()
    assert (run.figures("contacts_kept") == kept.sum(axis=1))[clear].all()
    grasps = touches[:, 0] & touches[:, 1:].any(axis=1)
    assert grasps.any()
    assert (run.figures("grasps_recorded") == grasps)[clear].all()
    assert (run.figures("grasps_kept") == (kept[:, 0] & kept[:, 1:].any(axis=1)))[clear].all()


def moved(run: Run, name: str) -> tuple[np.ndarray, np.ndarray]:
    """(N, k, 3) m, displacements of the middles of the box sides of a body's pieces, and (N, pieces, 3) of their centres."""
    scene, k = run.world.scene, run.body(name)
    points, centres = [], []
    for i in pieces_of(run, name):
        r, h, _ = scene.pieces.size[i]
        half = {0: (r, r, r), 3: (r, r, h)}.get(int(scene.pieces.kind[i]), tuple(scene.pieces.size[i]))
        local = scene.pieces.local[i, :9].reshape(3, 3)
        sides = np.concatenate([np.diag(half), -np.diag(half)])
        points.append(sides @ local.T + scene.pieces.local[i, 9:])
        centres.append(scene.pieces.local[i, 9:])
    found = []
    for rows in (np.concatenate(points), np.array(centres)):
        at = [
            np.array([Rotation.from_quat(p[k, 3:]).apply(rows) + p[k, :3] for p in poses])
            for poses in (run.recorded, run.corrected)
        ]
        found.append(at[1] - at[0])
    return found[0], found[1]


def test_amplification_is_the_largest_offset_over_the_depth(run: Run) -> None:
    names = [name for name in run.world.body_names if name.startswith("hand/")]
    largest = np.max([np.linalg.norm(moved(run, name)[0], axis=2).max(axis=1) for name in names], axis=0)
    depth = run.figures("recorded_penetration_m")
    deep = depth > 5e-4
    assert 10 < deep.sum() < len(depth) - 10
    assert run.figures("amplification")[deep] == pytest.approx(largest[deep] / depth[deep], rel=1e-9)
    assert not run.figures("amplification")[~deep].any()


def test_fingertip_error_is_of_those_in_contact_or_of_all(run: Run) -> None:
    touches = gaps(run, run.recorded) <= 2e-3
    errors = np.stack(
        [
            np.linalg.norm(
                np.concatenate([moved(run, f"hand/{finger}_{part}")[1] for part in ("distal", "pad")], axis=1).mean(
                    axis=1
                ),
                axis=1,
            )
            for finger in FINGERS
        ],
        axis=1,
    )
    counted = np.where(touches.any(axis=1, keepdims=True), touches, True)
    expected = (errors * counted).sum(axis=1) / counted.sum(axis=1)
    assert expected.max() > 1e-3
    assert run.figures("fingertip_error_m") == pytest.approx(expected, abs=1e-9)


def test_a_free_frame_has_no_error_and_loses_nothing(run: Run) -> None:
    free = ~run.touched()
    assert free.sum() > 5
    for name in ("amplification", "fingertip_error_m", "contact_precision_m", "contact_alignment_rad"):
        assert not run.figures(name)[free].any()
    assert (run.figures("contacts_kept") == run.figures("contacts_recorded"))[free].all()


@pytest.mark.parametrize("mode", ["rigid", "chains"])
def test_points_of_contact_are_those_below_the_ball_that_touches(tmp_path: Path, mode: str) -> None:
    """A ball at the end of a finger presses on a plate: its point of contact is where its centre stands above the plate."""
    ball = '<link name="tip"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>'
    palm = '<link name="palm"><collision><geometry><box size="0.02 0.02 0.02"/></geometry></collision></link>'
    joint = '<joint name="bend" type="revolute"><parent link="palm"/><child link="arm"/><axis xyz="0 1 0"/>'
    joint += '<limit lower="-2" upper="2" effort="1" velocity="1"/></joint><link name="arm"/>'
    joint += '<joint name="end" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="0.06 0 0"/></joint>'
    (tmp_path / "hand.urdf").write_text(f'<robot name="hand">{palm}{ball}{joint}</robot>')
    avatar = (
        f'[[avatar]]\nname = "hand"\nurdf = "hand.urdf"\nmode = "{mode}"\nmaterial = "human"\n'
        'root = { topic = "/wrist" }\njoints = { topic = "/glove" }\n'
    )
    angles = 0.9 * np.sin(np.linspace(0.0, np.pi, 60))[:, None]
    root = line((0.0, 0.0, 0.05), (0.0, 0.0, 0.05), frames=(59,))
    plate = Thing(name="plate", shape=("box", 0.4, 0.4, 0.02), at=(0.0, 0.0, -0.01))
    run = play(tmp_path, [plate], avatars=avatar, roots={"/wrist": root}, angles={"/glove": (["bend"], angles)},
               config=Config(mode=mode))  # fmt: skip
    before, after = run.recorded[:, run.body("hand/tip"), :3], run.corrected[:, run.body("hand/tip"), :3]
    kept = (run.figures("contacts_kept") == 1) & (before[:, 2] > 0.0)
    slid = np.linalg.norm((after - before)[:, :2], axis=1)
    assert kept.sum() > 10
    assert (slid[kept].max() > 1e-3) == (mode == "chains")
    assert run.figures("contact_precision_m")[kept] == pytest.approx(slid[kept], abs=1e-7)
    assert run.figures("contact_alignment_rad")[kept] == pytest.approx(0.0, abs=1e-6)


def test_thumbs_are_found_by_name(tmp_path: Path) -> None:
    (tmp_path / "hand.urdf").write_text(urdf())
    (tmp_path / "scene.toml").write_text(
        '[[avatar]]\nname = "hand"\nurdf = "hand.urdf"\nmaterial = "human"\nroot = { topic = "/wrist" }\n'
    )
    world = load_world(tmp_path / "scene.toml")
    marked = {name for name, is_thumb in zip(world.body_names, thumbs_of(world), strict=True) if is_thumb}
    assert marked == {"hand/thumb_proximal", "hand/thumb_distal", "hand/thumb_pad"}
