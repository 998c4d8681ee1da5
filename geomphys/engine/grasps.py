"""Classifies grasps of simulated bodies by driven ones: held, lifted, dropped, or touched and not held; forces and margins.

The margin of a grasp is the friction that is available at its contacts over the force that friction has to carry,

    Σ μ N / |m (a - g) - Σ N n|,

with the normal forces N of driven bodies, n into the body, and the acceleration a of its centre of mass. Torques are ignored.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from geomphys.numerics.quantiles import median
from geomphys.numerics.transforms import apply, matrix_from_pose
from geomphys.results import HELD_FOR, Contacts, FrameResult, Grasp, ResultColumns
from geomphys.scene.arrays import DRIVEN, SIMULATED, Scene
from geomphys.scene.world import World

Floats = NDArray[np.float64]

MIN_FORCE = 1e-3  # N: smaller forces count as none


@dataclass
class _Body:
    """A simulated body, and what has been done with it so far."""

    touched_s: float = 0.0
    held_s: float = 0.0
    sole_support_s: float = 0.0  # s, for which driven bodies have been its only support; 0: they are not
    start_height: float = 0.0  # m, its height when that began
    lifted: float = 0.0  # m
    dropped: int = 0
    margin: float = math.inf  # the least, but for the `latest`
    latest: list[tuple[float, float]] = field(default_factory=list)  # (sole_support_s, margin) of the last `HELD_FOR`
    centre: Floats | None = None  # (3,) m, of mass, in the frame before if it was touched then
    velocity: Floats | None = None  # (3,) m/s
    acceleration: Floats | None = None  # (3,) m/s²
    touch_forces: list[float] = field(
        default_factory=list
    )  # N, sum of the normal forces of driven bodies in each frame
    grip_forces: list[float] = field(default_factory=list)  # N, the same of the frames in which it was held


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
        self._solely_supported: set[int] = set()

    def messages(self, columns: ResultColumns) -> dict[int, tuple[tuple[str, str], ...]]:
        """Take n more frames; returns messages (level, text) of what changed in them, by their rows."""
        if not self._bodies:
            return {}
        contacts = columns.contacts
        gripping = contacts.normal_impulse > 0.0
        gripping &= self._driven[contacts.body_a] | self._driven[contacts.body_b]
        counts = np.concatenate([[0], np.cumsum(gripping)])[columns.contact_end]
        found = {}
        for row, (grips, frame) in enumerate(zip(np.diff(counts).tolist(), columns.frames, strict=True)):
            if grips or self._solely_supported:
                if messages := self.add(columns.result(row)):
                    found[row] = messages
            else:
                self._time_ns = frame.time_ns
        return found

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
        if not self._solely_supported and not gripping.any():
            return ()
        near = {*contacts.body_a[gripping].tolist(), *contacts.body_b[gripping].tolist()} & self._bodies.keys()
        messages: list[tuple[str, str]] = []
        for body in sorted(near | self._solely_supported):
            messages += self._follow(body, self._bodies[body], result, dt)
        self._solely_supported = {
            body for body in near | self._solely_supported if self._bodies[body].sole_support_s > 0.0
        }
        return tuple(messages)

    def _follow(self, body: int, seen: _Body, result: FrameResult, dt: float) -> list[tuple[str, str]]:
        contacts, name = result.contacts, self._names[body]
        of_body = (contacts.body_a == body) | (contacts.body_b == body)
        driven = self._driven[np.where(contacts.body_a == body, contacts.body_b, contacts.body_a)]
        forces = contacts.normal_impulse / dt
        gripping = of_body & driven & (forces > 0.0)
        grip_force, other_force = float(forces[gripping].sum()), float(forces[of_body & ~driven].sum())
        was_held = seen.sole_support_s >= HELD_FOR
        touched = grip_force > MIN_FORCE
        if touched:
            seen.touched_s += dt
            seen.touch_forces.append(grip_force)
            self._estimate_motion(body, seen, result, dt)
        else:
            seen.centre, seen.velocity = None, None
        if not touched or other_force > MIN_FORCE:
            seen.sole_support_s = 0.0
            seen.latest.clear()
            dropped = was_held and not touched and other_force <= MIN_FORCE
            seen.dropped += dropped
            ended = ("warning", f"{name}: dropped") if dropped else ("info", f"{name}: set down")
            return [ended] if was_held else []
        height = float(result.corrected[body, :3] @ self._up)
        if seen.sole_support_s == 0.0:
            seen.start_height = height
        seen.sole_support_s += dt
        seen.lifted = max(seen.lifted, height - seen.start_height)
        if seen.sole_support_s < HELD_FOR:
            return []
        seen.held_s += dt if was_held else seen.sole_support_s
        seen.grip_forces.append(grip_force)
        seen.latest.append((seen.sole_support_s, self._margin(body, seen, contacts, gripping, forces)))
        # what follows within `HELD_FOR` counts only if it is still held then: a hand that opens needs no margin
        while seen.sole_support_s - seen.latest[0][0] >= HELD_FOR:
            seen.margin = min(seen.margin, seen.latest.pop(0)[1])
        return [] if was_held else [("info", f"{name}: held with {grip_force:.3g} N")]

    def _estimate_motion(self, body: int, seen: _Body, result: FrameResult, dt: float) -> None:
        """Velocity and acceleration of a touched body's centre of mass, from the frames before in which it was touched too."""
        centre = apply(matrix_from_pose(result.corrected[body]), self._scene.bodies.com[body])
        velocity = None if seen.centre is None else (centre - seen.centre) / dt
        seen.acceleration = None
        if velocity is not None and seen.velocity is not None:
            seen.acceleration = (velocity - seen.velocity) / dt
        seen.centre, seen.velocity = centre, velocity

    def _margin(self, body: int, seen: _Body, contacts: Contacts, gripping: NDArray[np.bool_], forces: Floats) -> float:
        """The margin of a grasp; inf where friction carries nothing. `forces` (n,) N, normal, of all contacts."""
        bodies, friction = self._scene.bodies, self._scene.materials.friction
        on_a = contacts.body_a[gripping] == body
        other = np.where(on_a, contacts.body_b[gripping], contacts.body_a[gripping])
        available = float((friction[bodies.material[body], bodies.material[other]] * forces[gripping]).sum())
        into_body = np.where(on_a, 1.0, -1.0) * forces[gripping]
        pressed = (contacts.normal[gripping] * into_body[:, None]).sum(axis=0)
        acceleration = np.zeros(3) if seen.acceleration is None else seen.acceleration
        force = bodies.mass[body] * (acceleration - self._scene.gravity)
        needed = float(np.linalg.norm(force - pressed))
        return available / needed if needed > MIN_FORCE else math.inf

    def grasps(self) -> tuple[Grasp, ...]:
        """Outcomes so far of every simulated body that was touched."""
        return tuple(
            Grasp(
                body=self._names[body],
                touched_s=seen.touched_s,
                held_s=seen.held_s,
                lifted_m=seen.lifted if seen.held_s > 0.0 else 0.0,
                dropped=seen.dropped,
                grip_force_n=median(seen.grip_forces or seen.touch_forces),
                margin=min([seen.margin, *(margin for _, margin in seen.latest)]),
            )
            for body, seen in self._bodies.items()
            if seen.touched_s > 0.0
        )
