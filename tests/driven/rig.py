"""Small articulated models, made without a log, and the rooms that the chains' solvers need."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np

from geomphys.collision.detect import find_near, make_axes, make_near
from geomphys.collision.penetration import make_scratch
from geomphys.collision.sweep import make_boxes
from geomphys.driven.ccd import CcdRoom, descend, make_ccd_room
from geomphys.driven.chain_loop import free_chains
from geomphys.driven.chain_room import make_chain_room
from geomphys.driven.places import make_places
from geomphys.driven.posture import make_joints
from geomphys.jit.packed_records import pack
from geomphys.load import load_world
from geomphys.scene.arrays import World
from geomphys.scene.kinematics import joint_origins, place_tree, pose_tree
from tests.scene.models import urdf


class Rig:
    """A world and everything its chains' solvers write to."""

    def __init__(self, world: World) -> None:
        scene = self.scene = world.scene
        self.world, self.origins = world, joint_origins(scene)
        self.dofs = len(scene.dofs.lower)
        self.poses = np.zeros((len(scene.bodies.role), 7))
        self.near, self.places = make_near(512), make_places(scene, 512)
        self.roots = scene.trees.rest.copy()
        for tree in range(len(scene.trees.role)):
            pose_tree(pack(scene), self.origins, tree, self.roots, np.zeros(self.dofs), self.poses)
            for frames in (self.places.base, self.places.frames):
                place_tree(pack(scene), tree, self.poses, frames)
        self.joints = make_joints(scene, self.poses)
        self.ccd: CcdRoom = make_ccd_room(scene, self.joints)
        self.room = make_chain_room(scene, 3 * len(scene.trees.role) + self.dofs, 512)
        self.boxes = make_boxes(scene, self.places.base)
        self.axes, self.scratch = make_axes(1 << 10), make_scratch()
        names = ("scene", "joints", "ccd", "room", "places", "boxes", "near", "axes", "scratch")
        self.packs = SimpleNamespace(**{name: pack(getattr(self, name)) for name in names})

    def body(self, name: str) -> int:
        """Index of a body by the end of its name."""
        return next(k for k, full in enumerate(self.world.body_names) if full.endswith(name))

    def pose(self, angles) -> np.ndarray:
        """Poses (B, 7) of all bodies at these angles."""
        poses = np.zeros_like(self.poses)
        for tree in range(len(self.scene.trees.role)):
            pose_tree(self.packs.scene, self.origins, tree, self.roots, np.asarray(angles, float), poses)
        return poses

    def descend(self, link, local, goal, recorded=None, bend=None, still=-1, whole=False, tolerance=1e-9, sweeps=200):
        """`descend` from the zero pose or from recorded + bend: (error, offsets, angles)."""
        recorded = np.zeros(self.dofs) if recorded is None else np.array(recorded, float)
        bend = np.zeros(self.dofs) if bend is None else np.array(bend, float)
        angles = recorded + bend
        poses = self.pose(angles)
        error = descend(
            self.packs.scene, self.origins, self.packs.joints, self.packs.ccd, self.body(link), still, whole, recorded, bend,
            angles, poses, tuple(map(float, local)), tuple(map(float, goal)), tolerance, sweeps,
        )  # fmt: skip
        last = self.body(link) + 1
        np.testing.assert_allclose(poses[:last], self.pose(angles)[:last], atol=1e-9)
        return error, bend, angles

    def free(self, recorded, start=None, seed=0, frame=0, gap=2e-6):
        """`free_chains`: (status, rounds, angles)."""
        recorded = np.array(recorded, float)
        start = np.zeros(self.dofs) if start is None else start
        p = self.packs
        status, rounds = free_chains(
            p.scene, self.origins, p.joints, p.ccd, p.room, p.places, p.boxes, p.near, self.roots, recorded, start, gap, seed,
            frame, p.axes, p.scratch,
        )  # fmt: skip
        return status, rounds, self.room.angles.copy()

    def deepest(self) -> float:
        """Smallest separation [m] of any pair that a driven body is in, where `free` left them; 0.02 m at most."""
        p = self.packs
        self.places.reach[:] = 0.0
        find_near(
            p.scene,
            self.places.frames,
            p.boxes,
            self.places.reach,
            0.02,
            np.inf,
            p.near,
            self.places.found,
            p.axes,
            p.scratch,
        )
        return float(self.near.separation[: self.near.filled[0]].min(initial=0.02))


def rig(folder: Path, elements: tuple[str, ...], scene: str) -> Rig:
    """A rig of one avatar `a` with a URDF of these elements; `scene` is the rest of the scene file."""
    urdf(folder / "a.urdf", *elements)
    (folder / "scene.toml").write_text(
        f'[[avatar]]\nname = "a"\nurdf = "a.urdf"\nmode = "chains"\nmaterial = "human"\n{scene}'
    )
    return Rig(load_world(folder / "scene.toml"))
