"""Small scenes for the simulated loop, made without files, and a player that steps through them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from geomphys.collision.penetration import make_scratch, separation
from geomphys.collision.support import pose_pieces
from geomphys.jit.packed_records import pack
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Capsule, Cylinder, Hull, PosedShape, Shape, Sphere, build_pieces
from geomphys.simulated.allocation import CAPACITY, Capacity, make_simulation
from geomphys.simulated.driven_paths import fit_paths
from geomphys.simulated.update import begin_frame, end_frame

MATERIALS = ("wood", "human", "metal", "ice", "rubber")
RESTITUTION = np.array(
    [
        [0.3, 0.2, 0.2, 0.0, 0.5],
        [0.2, 0.1, 0.2, 0.0, 0.5],
        [0.2, 0.2, 0.3, 0.0, 0.5],
        [0.0] * 5,
        [0.5, 0.5, 0.5, 0.0, 0.9],
    ]
)
FRICTION = np.array(
    [
        [0.3, 0.2, 0.1, 0.0, 0.5],
        [0.2, 0.2, 0.1, 0.0, 0.5],
        [0.1, 0.1, 0.1, 0.0, 0.5],
        [0.0] * 5,
        [0.5, 0.5, 0.5, 0.0, 0.9],
    ]
)
GRAVITY = 9.81


@dataclass(frozen=True, kw_only=True)
class Thing:
    """One object. `mass` None: 1000 kg/m³; `com`: where the centre of mass is moved to, inertia kept."""

    shape: Shape | Sequence[tuple[Shape, Sequence[float]]]
    role: int = s.SIMULATED
    at: Sequence[float] = (0.0, 0.0, 0.0)
    turn: Sequence[float] = (0.0, 0.0, 0.0, 1.0)
    v: Sequence[float] = (0.0, 0.0, 0.0)
    w: Sequence[float] = (0.0, 0.0, 0.0)
    material: str = "wood"
    mass: float | None = None
    moving: bool = False
    coupling_mass: float = 0.4


def mass_properties(shape: Shape, density: float = 1000.0) -> tuple[float, np.ndarray]:
    """Mass and principal moments about the centre (textbook formulas)."""
    if isinstance(shape, Sphere):
        m = density * 4 / 3 * np.pi * shape.radius**3
        return m, np.full(3, 0.4 * m * shape.radius**2)
    if isinstance(shape, Box):
        x, y, z = shape.half_extents
        m = density * 8 * x * y * z
        return m, m / 3 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])
    if isinstance(shape, Cylinder):
        r, h = shape.radius, shape.half_height
        m = density * np.pi * r * r * 2 * h
        side = m * (3 * r * r + 4 * h * h) / 12
        return m, np.array([side, side, 0.5 * m * r * r])
    if isinstance(shape, Capsule):
        r, h = shape.radius, shape.half_height
        rod, ball = density * np.pi * r * r * 2 * h, density * 4 / 3 * np.pi * r**3
        side = rod * (3 * r * r + 4 * h * h) / 12 + ball * (0.4 * r * r + h * h + 0.75 * r * h)
        return rod + ball, np.array([side, side, 0.5 * rod * r * r + 0.4 * ball * r * r])
    raise TypeError(shape)


def make_scene(things: Sequence[Thing], gravity: Sequence[float] = (0.0, 0.0, -GRAVITY)) -> s.Scene:
    """Flat arrays of the objects, in the order given."""
    n = len(things)
    placed, starts = [], [0]
    mass, com, inertia = np.zeros(n), np.zeros((n, 3)), np.ones((n, 3))
    principal = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
    for b, thing in enumerate(things):
        parts = [(thing.shape, (0.0, 0.0, 0.0))] if not isinstance(thing.shape, list | tuple) else thing.shape
        tensor = np.zeros((3, 3))
        known = [mass_properties(p) if not isinstance(p, Hull) else hull_properties(p) for p, _ in parts]
        mass[b] = sum(m for m, _ in known)
        com[b] = sum(m * np.array(o) for (m, _), (_, o) in zip(known, parts, strict=True)) / mass[b]
        for (m, i), (_, o) in zip(known, parts, strict=True):
            d = np.array(o) - com[b]
            tensor += (np.diag(i) if np.ndim(i) == 1 else i) + m * (d @ d * np.eye(3) - np.outer(d, d))
        if thing.mass is not None:
            tensor *= thing.mass / mass[b]
            mass[b] = thing.mass
        if np.allclose(tensor, np.diag(np.diag(tensor)), rtol=0, atol=1e-14 * np.trace(tensor)):
            inertia[b] = np.diag(tensor)
        else:
            inertia[b], axes = np.linalg.eigh(tensor)
            axes[:, 0] *= np.sign(np.linalg.det(axes))
            principal[b] = Rotation.from_matrix(axes).as_quat()
        for shape, offset in parts:
            local = np.eye(4)
            local[:3, 3] = offset
            placed.append(PosedShape(shape, local, b))
        starts.append(len(placed))
    frame = np.tile(np.concatenate([np.eye(3).ravel(), np.zeros(3)]), (n, 1))
    role = np.array([t.role for t in things])
    none = np.zeros(0, np.int64)
    bodies = s.Bodies(
        role=role, tree=np.arange(n), piece_start=np.array(starts), mass=mass, com=com, inertia=inertia,
        material=np.array([MATERIALS.index(t.material) for t in things]), principal=principal, parent=np.full(n, -1),
        joint=np.zeros(n, np.int64), origin=frame, axis=np.tile([0.0, 0.0, 1.0], (n, 1)), dof=np.full(n, -1),
        multiplier=np.ones(n), offset=np.zeros(n),
    )  # fmt: skip
    trees = s.Trees(
        body_start=np.arange(n + 1), dof_start=np.zeros(n + 1, np.int64), role=role,
        moving=np.array([int(t.moving or t.role != s.FIXED) for t in things]),
        rest=np.array([[*t.at, *t.turn] for t in things], float), mass=np.array([t.coupling_mass for t in things]),
        stiffness=np.full(n, 1000.0), damping=np.full(n, 40.0), chains=np.zeros(n, np.int64),
        self_collision=np.zeros(n, np.int64), effort=np.full(n, np.inf), squeeze=np.zeros(n),
    )  # fmt: skip
    return s.Scene(
        gravity=np.array(gravity, float), pieces=build_pieces(placed), bodies=bodies, trees=trees,
        dofs=s.Dofs(np.zeros(0), np.zeros(0), none, none, np.zeros(0)), chains=s.Chains(none, np.zeros(1, np.int64), none),
        cones=s.ReachCones(np.zeros(1, np.int64), none, np.zeros((0, 3)), np.zeros(1, np.int64), np.zeros((0, 3))),
        materials=s.Materials(RESTITUTION, FRICTION), excluded=np.zeros((0, 0), np.int64),
        initial_velocity=np.array([[*t.v, *t.w] for t in things], float),
    )  # fmt: skip


def hull_properties(hull: Hull, density: float = 1000.0) -> tuple[float, np.ndarray]:
    """Mass and inertia tensor of a hull whose centroid is its origin, by tetrahedra from the origin."""
    from scipy.spatial import ConvexHull

    shell = ConvexHull(hull.vertices)
    volume, second = 0.0, np.zeros((3, 3))
    for triangle in shell.simplices:
        p = hull.vertices[triangle]
        v = abs(np.linalg.det(p)) / 6
        total = p.sum(axis=0)
        second += v / 20 * (p.T @ p + np.outer(total, total))
        volume += v
    return density * volume, density * (np.trace(second) * np.eye(3) - second)


class Player:
    """A scene being played: `poses` (B, 7) and `velocity` (B, 6) are the present state, `time` in s."""

    def __init__(self, things: Sequence[Thing], gravity: Sequence[float] = (0.0, 0.0, -GRAVITY), gap: float = 2e-6):
        self.scene = make_scene(things, gravity)
        self.gap = gap
        self.poses = self.scene.trees.rest.copy()
        self.velocity = self.scene.initial_velocity.copy()
        self.frames = np.zeros((len(self.scene.pieces.kind), 12))
        pose_pieces(self.scene.pieces, self.poses, self.frames)
        self.scratch = make_scratch()
        self.time = 0.0
        self.impacts = self.flags = 0
        self.end = self.poses.copy()
        self.set_up()
        self.targets: dict[int, Callable[[float], Sequence[float]]] = {}

    def set_up(self, capacity: Capacity = CAPACITY) -> None:
        """Make the simulated loop."""
        self.simulation = make_simulation(
            self.scene, self.poses, start=self.poses, end=self.end, reported=self.velocity,
            frames=self.frames, scratch=self.scratch, capacity=capacity,
        )  # fmt: skip
        self.packed = pack(self.simulation)

    def simulate(self, dt: float, max_impacts: int = 200) -> tuple[int, int]:
        """One frame, from `poses` to `end`."""
        fit_paths(self.packed, self.end, dt)
        return end_frame(self.packed, max_impacts, begin_frame(self.packed, dt, self.gap, False))

    def step(self, dt: float, max_impacts: int = 500) -> None:
        """One frame. Bodies in `targets` go to target(time) = (pose of 7)."""
        end = self.end
        end[:] = self.poses
        for body, target in self.targets.items():
            end[body] = target(self.time + dt)
            self.velocity[body, :3] = (end[body, :3] - self.poses[body, :3]) / dt
            turn = Rotation.from_quat(end[body, 3:]) * Rotation.from_quat(self.poses[body, 3:]).inv()
            self.velocity[body, 3:] = turn.as_rotvec() / dt
        impacts, flags = self.simulate(dt, max_impacts)
        self.poses[:] = end
        self.time += dt
        self.impacts += impacts
        self.flags |= flags

    def run(self, seconds: float, rate: float = 60.0) -> np.ndarray:
        """Play on; returns the poses of every frame (n, B, 7), the present one first."""
        out = [self.poses.copy()]
        for _ in range(round(seconds * rate)):
            self.step(1.0 / rate)
            out.append(self.poses.copy())
        return np.array(out)

    def overlap(self) -> float:
        """Deepest overlap of a simulated body with anything [m]; 0 if there is none."""
        pose_pieces(self.scene.pieces, self.poses, self.frames)
        body, role = self.scene.pieces.body, self.scene.bodies.role
        deepest = 0.0
        for i in range(len(body)):
            for j in range(i):
                if body[i] != body[j] and s.SIMULATED in (role[body[i]], role[body[j]]):
                    apart = separation(
                        self.packed.pieces, self.frames, i, j, 1e-3, (0.0, 0.0, 0.0), self.packed.scratch
                    )[0]
                    deepest = max(deepest, -apart)
        return deepest

    def energy(self) -> float:
        """Kinetic and potential energy of the simulated bodies [J]."""
        total = 0.0
        bodies = self.scene.bodies
        for b in np.flatnonzero(bodies.role == s.SIMULATED):
            turn = Rotation.from_quat(self.poses[b, 3:])
            centre = self.poses[b, :3] + turn.apply(bodies.com[b])
            own = (turn * Rotation.from_quat(bodies.principal[b])).inv().apply(self.velocity[b, 3:])
            total += 0.5 * bodies.mass[b] * self.velocity[b, :3] @ self.velocity[b, :3]
            total += 0.5 * own @ (bodies.inertia[b] * own) - bodies.mass[b] * self.scene.gravity @ centre
        return float(total)


def floor(material: str = "wood", **more: object) -> Thing:
    """A fixed box whose top is the plane z = 0."""
    return Thing(shape=Box((2.0, 2.0, 0.1)), role=s.FIXED, at=(0.0, 0.0, -0.1), material=material, **more)  # type: ignore[arg-type]
