"""What is generated and committed equals what its script writes now, and holds what its README promises."""

from __future__ import annotations

import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ElementTree
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh
from mcap.reader import make_reader


def run(script: Path, folder: Path) -> None:
    done = subprocess.run([sys.executable, str(script), "--out", str(folder)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="session")
def fresh_recordings(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings")
    run(root / "recordings" / "make_recordings.py", folder)
    return folder


def messages(path: Path) -> list[tuple[str, str, int, int, bytes]]:
    with open(path, "rb") as stream:
        found = make_reader(stream).iter_messages(log_time_order=False)
        return [(c.topic, s.name if s else "", m.log_time, m.publish_time, m.data) for s, c, m in found]


def triangles(path: Path) -> int:
    return sum(line.startswith("f ") for line in path.read_text().splitlines())


def test_every_asset_is_what_its_script_writes(root: Path, tmp_path: Path) -> None:
    run(root / "assets" / "make_assets.py", tmp_path)
    written = [path for path in sorted(tmp_path.rglob("*")) if path.is_file()]
    assert len(written) > 30
    for path in written:
        committed = root / "assets" / path.relative_to(tmp_path)
        assert committed.read_bytes() == path.read_bytes(), f"{committed} is not fresh: run assets/make_assets.py"
    meshes = {p.relative_to(root / "assets") for p in (root / "assets").rglob("*.obj")}
    assert meshes == {p.relative_to(tmp_path) for p in written if p.suffix == ".obj"}, "a mesh that no script writes"


def test_every_recording_is_what_its_script_writes(root: Path, fresh_recordings: Path) -> None:
    committed = sorted((root / "recordings").glob("*.mcap"))
    assert [p.name for p in committed] == sorted(p.name for p in fresh_recordings.iterdir())
    for path in committed:
        now = messages(fresh_recordings / path.name)
        assert messages(path) == now, f"{path} is not fresh: run recordings/make_recordings.py"


def test_every_recording_has_a_scene_and_no_gap(root: Path) -> None:
    for path in sorted((root / "recordings").glob("*.mcap")):
        name = {"gallery_hand": "gallery"}.get(path.stem, path.stem)
        scene = tomllib.loads((root / "assets" / "scenes" / f"{name}.toml").read_text())
        avatar = scene["avatar"][0]
        times: dict[str, list[int]] = {}
        for topic, _, log_time, _, _ in messages(path):
            times.setdefault(topic, []).append(log_time)
        wanted = {avatar["joints"]["topic"], avatar["root"].get("topic")} - {None}
        assert wanted <= set(times), f"{path.name} lacks a topic of its scene"
        first, *others = times.values()
        assert all(other == first for other in others), f"{path.name}: the streams do not run together"
        steps = {b - a for a, b in pairwise(first)}
        assert max(steps) - min(steps) <= 1, f"{path.name}: the clock is uneven"


def test_the_gallery_is_the_experiment(root: Path) -> None:
    folder = root / "assets" / "scenes"
    scene = tomllib.loads((folder / "gallery.toml").read_text())
    fixed = [o for o in scene["object"] if o["class"] == "fixed"]
    assert len(fixed) == 21
    assert sum(triangles(folder / o["mesh"]) for o in fixed) == 476
    (ball,) = [o for o in scene["object"] if o["class"] == "simulated"]
    assert triangles(folder / ball["mesh"]) == 960
    counts = Counter(topic for topic, *_ in messages(root / "recordings" / "gallery_hand.mcap"))
    assert counts == {"/tracker/wrist": 3653, "/glove/joint_states": 3653}


def test_the_ball_lies_on_the_table(root: Path) -> None:
    folder = root / "assets" / "scenes"
    scene = tomllib.loads((folder / "gallery.toml").read_text())
    objects = {o["name"]: o for o in scene["object"]}
    table = trimesh.load(folder / objects["table"]["mesh"], force="mesh")
    top = table.bounds[1, 2] + objects["table"]["position"][2]
    ball = trimesh.load(folder / objects["ball"]["mesh"], force="mesh")
    x, y, z, w = objects["ball"]["orientation"]
    ball.apply_transform(trimesh.transformations.quaternion_matrix([w, x, y, z]))
    heights = np.sort(ball.vertices[:, 2]) + objects["ball"]["position"][2] - top
    assert np.all((heights[:4] > 0) & (heights[:4] < 1e-5)), "it lies on a face of four corners"
    assert heights[4] > 1e-3


def test_the_hand_is_the_experiment(root: Path) -> None:
    folder = root / "assets" / "hand"
    robot = ElementTree.parse(folder / "hand.urdf").getroot()
    files = [e.attrib["filename"] for e in robot.findall("link/collision/geometry/mesh")]
    assert files == [e.attrib["filename"] for e in robot.findall("link/visual/geometry/mesh")]
    assert len(files) == len(set(files)) == 18
    assert sum(triangles(folder / name) for name in files) == 4964
    limits = [j.find("limit") for j in robot.findall("joint[@type='revolute']")]
    assert len(limits) == 22
    assert all(
        limit is not None and float(limit.attrib["lower"]) <= 0 < float(limit.attrib["upper"]) for limit in limits
    )


def test_meshes_are_closed_and_few_are_not_convex(root: Path) -> None:
    hollow = set()
    for path in sorted((root / "assets").rglob("*.obj")):
        mesh = trimesh.load(path, force="mesh")
        assert mesh.is_watertight, path
        assert mesh.is_winding_consistent, path
        assert mesh.volume > 0, path
        if mesh.convex_hull.volume > 1.0001 * mesh.volume:
            hollow.add(path.stem)
    assert hollow == {"palm", "table", "bench", "partition", "picture_framed", "star", "arch"}
