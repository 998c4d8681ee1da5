"""Classifies grasps of simulated bodies by driven ones: held, lifted, dropped, or touched and not held; forces and margins."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from geomphys.numerics.transforms import apply, matrix_from_pose
from geomphys.results import HELD_FOR, FrameResult, Grasp
from geomphys.scene.arrays import DRIVEN, SIMULATED, Scene
from geomphys.scene.world import World

Floats = NDArray[np.float64]

LEAST_FORCE = 1e-3  # N: smaller forces count as none


@dataclass
class _Body:
    """A simulated body, and what has been done with it so far."""

    touched_s: float = 0.0
    held_s: float = 0.0
    supported_s: float = 0.0  # s, since it has no other support
    begin: float = 0.0  # m, its height when that began
    lifted: float = 0.0
    dropped: int = 0
    margin: float = math.inf
    latest: list[tuple[float, float]] = field(default_factory=list)  # (supported_s, margin) of the last `HELD_FOR`
    centre: Floats | None = None  # (3,) m, of mass, in the frame before if it was touched then
    velocity: Floats | None = None  # (3,) m/s
    acceleration: Floats | None = None  # (3,) m/s²
    forces: tuple[list[float], list[float]] = field(default_factory=lambda: ([], []))


class GraspMeter:
    """Follows the simulated bodies of a world frame by frame; memory grows with the frames in which they are touched only."""

    def __init__(self, world: World) -> None:
        self._names = world.body_names
        self._scene: Scene = world.scene
        role = world.scene.bodies.role
        self._driven: NDArray[np.bool_] = role == DRIVEN
        driven = bool((role == DRIVEN).any())
        self._bodies = {int(b): _Body() for b in np.flatnonzero(role == SIMULATED) if driven}
        gravity = float(np.linalg.norm(world.scene.gravity))
        self._up: Floats = -world.scene.gravity / gravity if gravity > 0.0 else np.array([0.0, 0.0, 1.0])
        self._time_ns: int | None = None
        self._supported: set[int] = set()

    def add(self, result: FrameResult) -> tuple[tuple[str, str], ...]:
        """Take one more frame; returns messages (level, text) of what changed in it."""
        before, self._time_ns = self._time_ns, result.frame.time_ns
        if not self._bodies or before is None or self._time_ns <= before:
            return ()
        dt = (self._time_ns - before) * 1e-9
        contacts = result.contacts
        gripping = contacts.normal_impulse > 0.0
        if gripping.any():
            gripping &= self._driven[contacts.body_a] | self._driven[contacts.body_b]
        if not self._supported and not gripping.any():
            return ()
        near = {*contacts.body_a[gripping].tolist(), *contacts.body_b[gripping].tolist()} & self._bodies.keys()
        messages: list[tuple[str, str]] = []
        for body in sorted(near | self._supported):
            messages += self._follow(body, self._bodies[body], result, dt)
        self._supported = {body for body in near | self._supported if self._bodies[body].supported_s > 0.0}
        return tuple(messages)

    def _follow(self, body: int, seen: _Body, result: FrameResult, dt: float) -> list[tuple[str, str]]:
        contacts, name = result.contacts, self._names[body]
        of_body = (contacts.body_a == body) | (contacts.body_b == body)
        other = np.where(contacts.body_a == body, contacts.body_b, contacts.body_a)
        role, forces = self._scene.bodies.role[other], contacts.normal_impulse / dt
        gripping = of_body & (role == DRIVEN) & (forces > 0.0)
        force, rest = float(forces[gripping].sum()), float(forces[of_body & (role != DRIVEN)].sum())
        height = float(result.corrected[body, :3] @ self._up)
        was_held = seen.supported_s >= HELD_FOR
        if force <= LEAST_FORCE:
            dropped = was_held and rest <= LEAST_FORCE
            seen.supported_s, seen.centre, seen.velocity = 0.0, None, None
            seen.latest.clear()
            seen.dropped += dropped
            if was_held:
                return [("warning" if dropped else "info", f"{name}: {'dropped' if dropped else 'set down'}")]
            return []
        seen.touched_s += dt
        velocity, seen.velocity = seen.velocity, self._velocity(body, seen, result, dt)
        seen.acceleration = (
            (seen.velocity - velocity) / dt if velocity is not None and seen.velocity is not None else None
        )
        seen.forces[0].append(force)
        if rest > LEAST_FORCE:
            seen.supported_s = 0.0
            seen.latest.clear()
            return [("info", f"{name}: set down")] if was_held else []
        if seen.supported_s == 0.0:
            seen.begin = height
        seen.supported_s += dt
        seen.lifted = max(seen.lifted, height - seen.begin)
        if seen.supported_s < HELD_FOR:
            return []
        seen.held_s += dt if was_held else seen.supported_s
        seen.forces[1].append(force)
        materials, friction = self._scene.bodies.material, self._scene.materials.friction
        available = float((friction[materials[body], materials[other[gripping]]] * forces[gripping]).sum())
        sign = np.where(contacts.body_a == body, 1.0, -1.0)
        pressed = (contacts.normal * (sign * forces)[:, None])[gripping].sum(axis=0)
        needed = float(np.linalg.norm(self._carrying_force(body, seen) - pressed))
        seen.latest.append((seen.supported_s, available / needed if needed > LEAST_FORCE else math.inf))
        while seen.supported_s - seen.latest[0][0] >= HELD_FOR:  # a released body needs no margin
            seen.margin = min(seen.margin, seen.latest.pop(0)[1])
        return [] if was_held else [("info", f"{name}: held with {force:.3g} N")]

    def _velocity(self, body: int, seen: _Body, result: FrameResult, dt: float) -> Floats | None:
        """Mean velocity (3,) of its centre of mass since the frame before, in which it was touched too."""
        centre = apply(matrix_from_pose(result.corrected[body]), self._scene.bodies.com[body])
        before, seen.centre = seen.centre, centre
        return None if before is None else (centre - before) / dt

    def _carrying_force(self, body: int, seen: _Body) -> Floats:
        """Force (3,) of the supports of a body on it [N]: m (a - g)."""
        acceleration = np.zeros(3) if seen.acceleration is None else seen.acceleration
        force: Floats = self._scene.bodies.mass[body] * (acceleration - self._scene.gravity)
        return force

    def grasps(self) -> tuple[Grasp, ...]:
        """Outcomes so far of every simulated body that was touched."""
        return tuple(
            Grasp(
                body=self._names[body],
                touched_s=seen.touched_s,
                held_s=seen.held_s,
                lifted_m=seen.lifted if seen.held_s > 0.0 else 0.0,
                dropped=seen.dropped,
                grip_force_n=float(np.median(seen.forces[1] or seen.forces[0])),
                margin=min([seen.margin, *(margin for _, margin in seen.latest)]),
            )
            for body, seen in self._bodies.items()
            if seen.touched_s > 0.0
        )
