"""What is generated and committed equals what its script writes now, and holds what its README promises."""

from __future__ import annotations

import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ElementTree
from collections import Counter
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yourdfpy
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory


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
        tables = [avatar.get(key, {}) for key in ("joints", "root", "keypoints")]
        wanted = {table["topic"].split("#")[0] for table in tables if "topic" in table}
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


def test_the_body_is_the_experiment(root: Path) -> None:
    robot = ElementTree.parse(root / "assets" / "body" / "body.urdf").getroot()
    assert sum(link.find("collision") is not None for link in robot.findall("link")) == 15
    assert len(robot.findall("joint[@type='revolute']")) == 32
    joints = {j.attrib["name"] for j in robot.findall("joint")}
    links = {link.attrib["name"] for link in robot.findall("link")}
    for name in ("two_arms", "avatar_box"):
        avatar = tomllib.loads((root / "assets" / "scenes" / f"{name}.toml").read_text())["avatar"][0]
        assert len(avatar["chain"]) == 5
        assert {chain[end] for chain in avatar["chain"] for end in ("base", "tip")} <= links
        assert len(avatar["reach_cone"]) == 4
        assert {joint for cone in avatar["reach_cone"] for joint in cone["joints"]} <= joints


@pytest.mark.parametrize("name", ["hand", "body"])
def test_at_zero_only_neighbours_touch(root: Path, name: str) -> None:
    folder = root / "assets" / name
    robot = yourdfpy.URDF.load(str(folder / f"{name}.urdf"), load_meshes=False, load_collision_meshes=False)
    shaped = [link for link in robot.link_map.values() if link.collisions]
    above = {j.child: j.parent for j in robot.joint_map.values()}

    def bearer(link: str) -> str | None:
        up = above.get(link)
        while up is not None and not robot.link_map[up].collisions:
            up = above.get(up)
        return up

    managers = {}
    for link in shaped:
        managers[link.name] = trimesh.collision.CollisionManager()
        for k, part in enumerate(link.collisions):
            g = part.geometry
            if g.mesh is not None:
                mesh = trimesh.load(folder / g.mesh.filename, force="mesh")
            elif g.box is not None:
                mesh = trimesh.creation.box(g.box.size)
            elif g.sphere is not None:
                mesh = trimesh.creation.icosphere(2, g.sphere.radius)
            else:
                mesh = trimesh.creation.cylinder(g.cylinder.radius, g.cylinder.length)
            place = np.eye(4) if part.origin is None else part.origin
            managers[link.name].add_object(str(k), mesh, robot.get_transform(link.name) @ place)
    for a, b in combinations(sorted(managers), 2):
        if bearer(a) != b and bearer(b) != a:
            assert not managers[a].in_collision_other(managers[b]), f"{a} and {b} overlap"


def test_the_recorded_hand_sinks_into_the_table_and_the_ball(root: Path) -> None:
    folder = root / "assets" / "scenes"
    scene = tomllib.loads((folder / "gallery.toml").read_text())
    ball = np.array(scene["object"][0]["position"])
    tracker_from_root = np.array(scene["avatar"][0]["root"]["position"])
    robot = yourdfpy.URDF.load(str(root / "assets" / "hand" / "hand.urdf"), load_meshes=False)
    points = {
        link.name: trimesh.load(
            root / "assets" / "hand" / link.collisions[0].geometry.mesh.filename, force="mesh"
        ).vertices
        for link in robot.link_map.values()
        if link.collisions
    }
    with open(root / "recordings" / "gallery_hand.mcap", "rb") as stream:
        found = list(make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages())
    poses = [m.pose for _, c, _, m in found if c.topic == "/tracker/wrist"]
    angles = [dict(zip(m.name, m.position, strict=True)) for _, c, _, m in found if c.topic == "/glove/joint_states"]

    def hand(frame: int) -> np.ndarray:
        p, q = poses[frame].position, poses[frame].orientation
        world = trimesh.transformations.quaternion_matrix([q.w, q.x, q.y, q.z])
        world[:3, 3] = np.array([p.x, p.y, p.z]) + world[:3, :3] @ tracker_from_root
        robot.update_cfg(angles[frame])
        return np.vstack([trimesh.transform_points(v, world @ robot.get_transform(k)) for k, v in points.items()])

    for frame in range(0, 1950, 150):
        assert hand(frame)[:, 2].min() > 0.76 + 0.1, "idle in the air"
    for frame in (*range(2010, 2370, 40), *range(2560, 2940, 40)):
        assert 0.005 < 0.76 - hand(frame)[:, 2].min() < 0.020, "sinks in while it slides"
    assert hand(2450)[:, 2].min() > 0.76 + 0.05, "breaks contact"
    assert min(np.linalg.norm(hand(frame) - ball, axis=1).min() for frame in range(3300, 3320, 4)) < 0.03


def test_meshes_are_closed_and_few_are_not_convex(root: Path) -> None:
    hollow = set()
    for path in sorted((root / "assets").rglob("*.obj")):
        mesh = trimesh.load(path, force="mesh")
        assert mesh.is_watertight, path
        assert mesh.is_winding_consistent, path
        assert mesh.volume > 0, path
        if mesh.convex_hull.volume > 1.0001 * mesh.volume:
            hollow.add(path.stem)
    assert hollow == {"palm", "table", "bench", "partition", "picture_framed", "star", "arch", "mug"}
