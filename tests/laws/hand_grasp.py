"""A grasp of the shipped hand whose recorded forces balance: palm and fingers touch a thing and press it along its normals.

With the offsets x of the joints from where they are stopped the fingers press by τ = K x, and contact forces f are in balance
with them where τ = Jᵀ f. So forces in balance among themselves, within narrow cones about the normals, say how much farther
every joint is to be recorded: x = K⁻¹ Jᵀ f. Such a grasp neither pushes nor turns what it closes on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from geomphys.driven.links import make_links
from geomphys.scene.kinematics import joint_origins, pose_tree
from geomphys.scene.world import World

Floats = NDArray[np.float64]

HAND = Path(__file__).resolve().parents[2] / "assets" / "hand" / "hand.urdf"
OPENED = {"thumb": (34, -19, 4, 2), "finger": (10, 10, 8)}  # deg
JOINTS = {"thumb": ("cmc_abd", "cmc_flex", "mcp_flex", "ip_flex"), "finger": ("mcp_flex", "pip_flex", "dip_flex")}


FINGERS = ("thumb", "index", "middle")  # that grasp; the others stay open


@dataclass(frozen=True)
class Posing:
    """How a thing is grasped: the angles towards which the fingers close, and where it is at the palm."""

    at: tuple[float, float]  # m, of the thing's centre along the palm, in its frame
    thumb: tuple[float, ...]  # deg, of its four joints
    finger: tuple[float, ...]  # deg, of MCP, PIP and DIP
    yaw: float = 0.0  # deg, of the upright hand about the thing


POSINGS = {
    "ball": Posing((0.070, 0.004), (26, 13, 47, 58), (74, 84, 56)),
    "cube": Posing((0.0661, 0.0238), (6.9, 2.3, 36.6, 48.5), (65.6, 73.9, 52.8), 45.5),
    "cylinder": Posing((0.066, 0.0098), (-11.1, 11.5, 42.9, 24.9), (62.7, 65.9, 17.9)),
}
SIZES = {"ball": (0.025,) * 3, "cube": (0.025,) * 3, "cylinder": (0.025, 0.025, 0.04)}  # m
OWN_FRICTION = 0.2  # of the forces by which the grasp alone is in balance
EDGES = 12  # of the pyramid that stands for a cone
FLAT = 2e-4  # m: nearer points of the palm touch too
BISECTIONS = 24
FINEST = 4  # parts of the edge of a triangle of a surface


@dataclass(frozen=True)
class Thing:
    """What is grasped: a solid of revolution about z, or a box; `size` in m are half its widths."""

    kind: str  # ball | cube | cylinder
    size: Floats  # (3,)

    def distance(self, points: Floats) -> Floats:
        """Signed distances (n,) of points (n, 3) in its frame to its surface [m]."""
        if self.kind == "ball":
            return np.asarray(np.linalg.norm(points, axis=1) - self.size[0])
        d = np.abs(points) - self.size
        if self.kind == "cylinder":
            d = np.stack([np.hypot(points[:, 0], points[:, 1]) - self.size[0], d[:, 2]], axis=1)
        return np.asarray(np.linalg.norm(np.maximum(d, 0), axis=1) + np.minimum(d.max(axis=1), 0))

    def inwards(self, point: Floats) -> Floats:
        """Unit normal into it at a point of its surface (3,)."""
        step = 1e-6 * np.eye(3)
        n = self.distance(point - step) - self.distance(point + step)
        return np.asarray(n / np.linalg.norm(n))


class Touch(NamedTuple):
    """A contact of a link, in the frame of the thing."""

    digit: str  # a finger, or the palm
    link: str
    point: Floats  # (3,) m
    normal: Floats  # (3,) unit, into the thing


@dataclass
class GraspingHand:
    """The shipped hand at given joint values, seen from a thing whose centre is at `grasped` (3,) in the palm's frame."""

    world: World
    thing: Thing
    posing: Posing
    grasped: Floats

    @cached_property
    def origins(self) -> Floats:
        """Origins of the joints."""
        return joint_origins(self.world.scene)

    @cached_property
    def joints(self) -> list[str]:
        """Names of the degrees of freedom."""
        return [n.split("/")[-1] for n in self.world.dof_names]

    @cached_property
    def links(self) -> list[str]:
        """Names of the bodies."""
        return [n.split("/")[-1] for n in self.world.body_names]

    @cached_property
    def surfaces(self) -> dict[str, Floats]:
        """Link -> points (n, 3) of the surfaces of its convex pieces, link frame [m]."""
        pieces, out = self.world.scene.pieces, {}
        shares = [(i / FINEST, j / FINEST) for i in range(FINEST + 1) for j in range(FINEST + 1 - i)]
        weights = np.array([(a, b, 1 - a - b) for a, b in shares])
        for k, body in enumerate(pieces.body):
            corners = pieces.vertices[pieces.vertex_start[k] : pieces.vertex_start[k + 1]]
            hull = ConvexHull(corners)
            points = np.einsum("wc,tcx->twx", weights, corners[hull.simplices]).reshape(-1, 3)
            local = pieces.local[k]
            out.setdefault(self.links[body], []).append(points @ local[:9].reshape(3, 3).T + local[9:])
        return {link: np.unique(np.concatenate(parts), axis=0) for link, parts in out.items()}

    def poses(self, values: Floats) -> Floats:
        """Poses (B, 7) of the links, root at the origin."""
        scene = self.world.scene
        roots, out = np.zeros((len(scene.trees.role), 7)), np.zeros((len(self.links), 7))
        roots[:, 6] = 1.0
        pose_tree(scene, self.origins, 0, roots, values, out)
        return out

    def seen(self, poses: Floats, link: str, points: Floats) -> Floats:
        """Points (n, 3) of a link in the thing's frame."""
        at, palm = poses[self.links.index(link)], poses[self.links.index("palm")]
        world = Rotation.from_quat(at[3:]).apply(points) + at[:3] - palm[:3]
        return np.asarray(self.upright.apply(Rotation.from_quat(palm[3:]).inv().apply(world) - self.grasped))

    @cached_property
    def upright(self) -> Rotation:
        """Of the palm in the frame of the thing."""
        return Rotation.from_euler("z", self.posing.yaw, degrees=True) * Rotation.from_euler("x", 90, degrees=True)

    def values(self, shares: dict[str, float]) -> Floats:
        """Joint values (Q,) of fingers that are closed by shares [rad]."""
        out = np.zeros(len(self.joints))
        for finger in (*FINGERS, "ring", "little"):
            kind = "thumb" if finger == "thumb" else "finger"
            closed = self.posing.thumb if finger == "thumb" else self.posing.finger
            for name, a, b in zip(JOINTS[kind], OPENED[kind], closed, strict=True):
                out[self.joints.index(f"{finger}_{name}")] = math.radians(a + shares.get(finger, 0.0) * (b - a))
        return out

    def nearest(self, values: Floats, digit: str) -> tuple[float, Touch]:
        """Least distance of a digit's surface to the thing [m], and where."""
        poses, best = self.poses(values), (math.inf, Touch(digit, "", np.zeros(3), np.zeros(3)))
        for link, points in self.surfaces.items():
            if link.startswith(digit):
                seen = self.seen(poses, link, points)
                far = self.thing.distance(seen)
                k = int(far.argmin())
                if far[k] < best[0]:
                    best = float(far[k]), Touch(digit, link, seen[k], self.thing.inwards(seen[k]))
        return best

    def resting(self, values: Floats) -> list[Touch]:
        """Contacts of the palm, which may touch along a line or a face: the outermost of its points that are near."""
        seen = self.seen(self.poses(values), "palm", self.surfaces["palm"])
        near = seen[self.thing.distance(seen) < FLAT]
        normals = [self.thing.inwards(point) for point in near]
        mean = np.mean(normals, axis=0)
        t = np.cross(mean, np.eye(3)[np.abs(mean).argmin()])
        ends = {int(k) for way in (t, np.cross(mean, t)) for k in ((near @ way).argmin(), (near @ way).argmax())}
        return [Touch("palm", "palm", near[k], normals[k]) for k in sorted(ends)]

    def lay_on_palm(self) -> None:
        """Move the thing along the palm's normal until the palm just touches it."""
        values, low, high = self.values({}), -0.15, 0.0
        for _ in range(BISECTIONS):
            self.grasped[2] = 0.5 * (low + high)
            low, high = (self.grasped[2], high) if self.nearest(values, "palm")[0] > 0.0 else (low, self.grasped[2])
        self.grasped[2] = low

    def close(self) -> tuple[Floats, list[Touch]]:
        """Close each of the fingers until it touches: joint values (Q,) and contacts, with those of the palm."""
        shares, touches = {}, []
        for finger in FINGERS:
            low, high = 0.0, 1.4
            for _ in range(BISECTIONS):
                share = 0.5 * (low + high)
                free = self.nearest(self.values({finger: share}), finger)[0] > 0.0
                low, high = (share, high) if free else (low, share)
            shares[finger] = low
            touches.append(self.nearest(self.values(shares), finger)[1])
        return self.values(shares), touches + self.resting(self.values(shares))

    def jacobian(self, values: Floats, touch: Touch) -> Floats:
        """(3, Q) m per rad: motion of the link's point at a contact by every joint, seen from the palm that stays."""
        poses, step = self.poses(values), 1e-6
        at, palm = poses[self.links.index(touch.link)], poses[self.links.index("palm")]
        world = Rotation.from_quat(palm[3:]).apply(self.upright.inv().apply(touch.point) + self.grasped) + palm[:3]
        local = Rotation.from_quat(at[3:]).inv().apply(world - at[:3])
        turn = self.upright * Rotation.from_quat(palm[3:]).inv()
        out = np.zeros((3, len(values)))
        for q in range(len(values)):
            moved = values.copy()
            moved[q] += step
            there = self.poses(moved)[self.links.index(touch.link)]
            out[:, q] = turn.apply(Rotation.from_quat(there[3:]).apply(local) + there[:3] - world) / step
        return out

    def press(self, values: Floats, touches: list[Touch], forces: Floats, stiffness: float) -> Floats:
        """Joint values (Q,) of a recording whose springs press with `forces` (n, 3) N where `values` just touch.

        The joints behind a contact yield by `stiffness` K [N/m] together: joint j by s K lever_j², s = Σ (arm_j / lever_j)².
        """
        lever = make_links(self.world.scene).lever
        moments, size, yielding = np.zeros((3, len(values)))
        for touch, force in zip(touches, forces, strict=True):
            arms = self.jacobian(values, touch)
            along = np.abs(touch.normal @ arms) * (force @ touch.normal)
            moments += arms.T @ force
            size += along
            yielding += along * float(np.sum((touch.normal @ arms / lever) ** 2))
        share = np.where(size > 0.0, np.maximum(0.02, yielding / np.maximum(size, 1e-12)), 1.0)
        return np.asarray(values + moments / (share * stiffness * lever**2))


def balanced(touches: list[Touch], largest: float, friction: float = OWN_FRICTION) -> Floats:
    """Contact forces (n, 3) [N] on a thing that are in balance, found by a linear program: no finger presses by over `largest`.

    The fingers press together, and the weakest of them, as much as they can, within cones of `friction`; the palm as it must.
    """
    columns, owner = [], []
    for i, touch in enumerate(touches):
        n = touch.normal
        t = np.cross(n, np.eye(3)[np.abs(n).argmin()])
        t /= np.linalg.norm(t)
        for angle in np.arange(EDGES) * 2 * math.pi / EDGES:
            edge = n + friction * (math.cos(angle) * t + math.sin(angle) * np.cross(n, t))
            columns.append(np.concatenate([edge, np.cross(touch.point, edge) / 0.03]))
            owner.append(i)
    edges, mine = np.array(columns).T, np.array(owner)
    fingers = [i for i, touch in enumerate(touches) if touch.digit != "palm"]
    sums = np.array([mine == i for i in fingers], dtype=float)
    gain = np.append(-sums.sum(axis=0), -float(len(fingers)))  # the last unknown: the normal force of the weakest
    most = np.hstack([sums, np.zeros((len(fingers), 1))])
    least = np.hstack([-sums, np.ones((len(fingers), 1))])
    found = linprog(
        gain, np.vstack([most, least]), np.repeat([largest, 0.0], len(fingers)),
        np.hstack([edges, np.zeros((6, 1))]), np.zeros(6),
    )  # fmt: skip
    if found.status != 0 or found.x[-1] < 0.1 * largest:
        raise ValueError("no forces in balance")
    return np.array([edges[:3, mine == i] @ found.x[:-1][mine == i] for i in range(len(touches))])


class BalancedGrasp(NamedTuple):
    """A grasp to be recorded, the hand's root in the frame of the thing."""

    joints: list[str]
    root_position: Floats  # (3,) m
    root_rotation: Rotation
    outwards: Floats  # (3,) unit, away from the palm's side of the thing
    opened: Floats  # (Q,) rad
    touching: Floats  # (Q,) rad
    pressing: Floats  # (Q,) rad
    touches: list[Touch]
    forces: Floats  # (n, 3) N, on the thing


def balanced_grasp(world: World, what: str, largest: float, stiffness: float = 1000.0) -> BalancedGrasp:
    """The hand of a world lays a thing onto its palm and presses it there, no finger by more than `largest` [N]."""
    posing = POSINGS[what]
    hand = GraspingHand(world, Thing(what, np.array(SIZES[what])), posing, np.array([*posing.at, 0.0]))
    hand.lay_on_palm()
    touching, touches = hand.close()
    forces = balanced(touches, largest)
    opened = hand.values({})
    palm = hand.poses(opened)[hand.links.index("palm")]
    root = hand.upright * Rotation.from_quat(palm[3:]).inv()
    position = -root.apply(palm[:3]) - hand.upright.apply(hand.grasped)
    pressing = hand.press(touching, touches, forces, stiffness)
    outwards = hand.upright.apply([0.0, 0.0, 1.0])
    return BalancedGrasp(hand.joints, position, root, outwards, opened, touching, pressing, touches, forces)
