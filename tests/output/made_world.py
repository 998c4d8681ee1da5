"""Worlds and frames made by hand: what the sinks need of them, nothing that a collision could be computed with."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from geomphys.results import Contacts, Frame, FrameResult, Metrics, Penetrations
from geomphys.scene import arrays as s
from geomphys.scene.scene_facts import facts_of
from geomphys.scene.scene_file import SceneFile
from geomphys.scene.world import World

URDF = """<robot name="hand">
  <link name="palm"><visual><geometry><mesh filename="meshes/palm.stl"/></geometry></visual>
    <collision><geometry><box size="0.08 0.1 0.02"/></geometry></collision></link>
  <link name="finger"><collision><geometry><box size="0.08 0.02 0.02"/></geometry></collision></link>
  <joint name="knuckle" type="revolute"><parent link="palm"/><child link="finger"/><axis xyz="0 1 0"/>
    <origin xyz="0.04 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>
"""
OBJECTS = """
[[object]]
name = "table"
class = "fixed"
box = [0.6, 0.6, 0.1]
position = [0.0, 0.0, -0.05]

[[object]]
name = "ball"
class = "simulated"
sphere = 0.03
material = "metal"

[[object]]
name = "cup"
class = "driven"
cylinder = [0.04, 0.1]
topic = "/tracker/cup"

[[object]]
name = "shelf"
class = "fixed"
capsule = [0.02, 0.3]
topic = "/tracker/shelf"
"""
LINKS = ("palm", "finger")
T0 = 1_700_000_000_123_456_789
STEP = 16_666_667


def make_world(folder: Path, avatars: Sequence[str]) -> World:
    """Avatars of two links and the objects above."""
    (folder / "meshes").mkdir(parents=True)
    (folder / "meshes" / "palm.stl").write_bytes(_stl(box((0.08, 0.1, 0.02))))
    (folder / "hand.urdf").write_text(URDF)
    text = OBJECTS + "".join(f'\n[[avatar]]\nname = "{a}"\nurdf = "hand.urdf"\n' for a in avatars)
    (folder / "scene.toml").write_text(text)
    file = SceneFile.model_validate(tomllib.loads(text))
    objects = [o.name for o in file.object]
    roles = {"fixed": s.FIXED, "simulated": s.SIMULATED, "driven": s.DRIVEN}
    tree_sizes = [len(LINKS)] * len(avatars) + [1] * len(objects)
    tree_roles = [s.DRIVEN] * len(avatars) + [roles[o.class_] for o in file.object]
    trees = len(tree_sizes)
    tree_of = np.repeat(np.arange(trees), tree_sizes)
    bodies = len(tree_of)
    dofs = len(avatars)
    shapes = [box((0.08, 0.1, 0.02)), box((0.08, 0.02, 0.02))] * len(avatars)
    shapes += [box((0.6, 0.6, 0.1)), box((0.05, 0.05, 0.05)), box((0.08, 0.08, 0.1)), box((0.04, 0.04, 0.3))]
    single = len(avatars) == 1
    scene = s.Scene(
        gravity=np.array([0.0, 0.0, -9.81]),
        pieces=s.Pieces(*(np.zeros(0) for _ in s.Pieces._fields)),
        bodies=s.Bodies(
            role=np.array(tree_roles)[tree_of],
            tree=tree_of,
            piece_start=np.zeros(bodies + 1, np.int64),
            material=np.zeros(bodies, np.int64),
            mass=np.ones(bodies),
            com=np.zeros((bodies, 3)),
            inertia=np.ones((bodies, 3)),
            principal=np.tile([0.0, 0.0, 0.0, 1.0], (bodies, 1)),
            parent=np.full(bodies, -1),
            joint=np.zeros(bodies, np.int64),
            origin=np.zeros((bodies, 12)),
            axis=np.zeros((bodies, 3)),
            dof=np.full(bodies, -1),
            multiplier=np.ones(bodies),
            offset=np.zeros(bodies),
        ),
        trees=s.Trees(
            body_start=np.concatenate([[0], np.cumsum(tree_sizes)]),
            dof_start=np.concatenate([np.arange(dofs + 1), np.full(len(objects), dofs)]),
            role=np.array(tree_roles),
            moving=np.array([1] * len(avatars) + [0, 1, 1, 1]),
            rest=np.tile([0.0, 0, 0, 0, 0, 0, 1], (trees, 1)),
            mass=np.full(trees, 0.4),
            stiffness=np.full(trees, 1000.0),
            damping=np.full(trees, 40.0),
            chains=np.zeros(trees, np.int64),
            self_collision=np.zeros(trees, np.int64),
            effort=np.full(trees, np.inf),
            squeeze=np.zeros(trees),
        ),
        dofs=s.Dofs(np.full(dofs, -1.0), np.full(dofs, 1.0), np.arange(dofs), np.full(dofs, -1), np.full(dofs, np.inf)),
        chains=s.Chains(*(np.zeros(0, np.int64) for _ in s.Chains._fields)),
        cones=s.ReachCones(*(np.zeros(0) for _ in s.ReachCones._fields)),
        materials=s.Materials(np.full((1, 1), 0.3), np.full((1, 1), 0.3)),
        excluded=np.zeros((0, 0), np.int64),
        initial_velocity=np.zeros((bodies, 6)),
    )
    return World(
        facts=facts_of(file),
        path=folder / "scene.toml",
        scene=scene,
        tree_names=(*avatars, *objects),
        body_names=(*(f"{a}/{link}" for a in avatars for link in LINKS), *objects),
        frame_names=(*(link if single else f"{a}/{link}" for a in avatars for link in LINKS), *objects),
        dof_names=("knuckle",) * dofs,
        avatar_count=len(avatars),
        roots=(),
        joints=(),
        urdfs=dict.fromkeys(avatars, folder / "hand.urdf"),
        zero_pose_overlaps=(),
        triangles=tuple(shapes),
        collision_triangles=tuple(shapes),
    )


def frames(world: World, count: int, start: int = T0) -> list[FrameResult]:
    """Frames in which every number differs; a third of them has contacts, in the middle of each dozen."""
    random = np.random.default_rng(7)
    bodies, dofs = len(world.body_names), len(world.dof_names)
    rest = np.zeros((bodies, 7))
    rest[:, 6] = 1.0
    rest[:, 0] = np.linspace(-0.2, 0.2, bodies)
    first_object = bodies - 4
    results = []
    for index in range(count):
        recorded = rest.copy()
        recorded[:first_object, 2] = 0.05 + 0.06 * np.cos(0.5 * index)
        recorded[:, 3:] = _unit(random.normal([0, 0, 0, 5], 0.2, (bodies, 4)))
        recorded[first_object] = (0.0, 0.0, -0.05, 0.0, 0.0, 0.0, 1.0)  # the table
        corrected = recorded.copy()
        in_contact = index % 12 in (4, 5, 6, 7)
        n = 1 + index % 3 if in_contact else 0
        lift = 0.001 * (1 + index % 5) if in_contact else 0.0
        corrected[:first_object, 2] += lift
        contacts = Contacts(
            body_a=np.arange(n) % 2,
            body_b=np.full(n, first_object),
            point=random.normal(0, 0.1, (n, 3)),
            normal=_unit(random.normal(0, 1, (n, 3))),
            depth=np.full(n, lift),
            normal_impulse=random.random(n),
            tangential_impulse=random.random(n),
        )
        m = min(n, 1)
        penetrations = Penetrations(
            np.zeros(m, np.int64),
            np.full(m, first_object),
            random.normal(0, 0.01, (m, 3)),
            np.full(m, 2),
            np.full(m, lift),
            np.full(m, index % 3),
        )
        metrics = Metrics(
            n,
            lift,
            1e-9 * index,
            2,
            0,
            0,
            lift,
            0.0,
            index % 5 == 0,
            int(index % 5 == 0),
            0.4,
            0.2,
            3.0,
            2.0,
            0.0,
            *(0.0, 0, 0, 0, 0, 0.0, 0.0, 0.0),
        )
        time = start + STEP * index
        results.append(
            FrameResult(
                frame=Frame(index, time, recorded[: len(world.tree_names)], np.full(dofs, 0.1), index % 5 == 0),
                recorded=recorded,
                corrected=corrected,
                angles=random.normal(0, 0.3, dofs),
                contacts=contacts,
                penetrations=penetrations,
                metrics=metrics,
                timing=(("decode", 1000 + index, 1), ("step", 20000, 1), ("step.overlap", 9000, 3)),
                messages=(("warning", f"frame {index}: a stream was held"),) if index % 50 == 10 else (),
            )
        )
    return results


def box(size: Sequence[float]) -> tuple[s.Floats, s.Ints]:
    """Triangles of a box about the origin."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * np.array(size) / 2
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def _unit(rows: np.ndarray) -> np.ndarray:
    return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


def _stl(mesh: tuple[s.Floats, s.Ints]) -> bytes:
    vertices, faces = mesh
    body = b"".join(np.concatenate([np.zeros(3), vertices[f].ravel()]).astype("<f4").tobytes() + b"\0\0" for f in faces)
    return bytes(80) + len(faces).to_bytes(4, "little") + body
