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
from geomphys.numerics.transforms import matrix_from_pose
from geomphys.results import HELD_FOR, Contacts, FrameResult, Grasp, ResultColumns
from geomphys.scene.arrays import DRIVEN, SIMULATED, Scene
from geomphys.scene.world import World

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MIN_FORCE = 1e-3  # N: smaller forces count as none


def _sums(rows: Ints, values: Floats, count: int) -> Floats:
    """Sums (count,) of values (n,) that are of the same row."""
    return np.bincount(rows, values, count).astype(np.float64)


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

    def messages(self, columns: ResultColumns) -> dict[int, tuple[tuple[str, str], ...]]:
        """Take n more frames; returns messages (level, text) of what changed in them, by their rows."""
        times = np.array([frame.time_ns for frame in columns.frames], np.int64)
        return self._take(times, columns.contacts, columns.contact_end, columns.corrected)

    def add(self, result: FrameResult) -> tuple[tuple[str, str], ...]:
        """Take one more frame; returns messages (level, text) of what changed in it."""
        contact_end = np.array([0, len(result.contacts.body_a)])
        times = np.array([result.frame.time_ns], np.int64)
        return self._take(times, result.contacts, contact_end, result.corrected[None]).get(0, ())

    def _take(
        self, times_ns: Ints, contacts: Contacts, contact_end: Ints, poses: Floats
    ) -> dict[int, tuple[tuple[str, str], ...]]:
        """Take n frames, with the ends (n + 1,) of their contacts and poses (n, B, 7); returns messages by rows."""
        before = times_ns[0] if self._time_ns is None else self._time_ns
        self._time_ns = int(times_ns[-1])
        dts = np.diff(times_ns, prepend=before) * 1e-9
        rows = np.flatnonzero(dts > 0.0)
        frame_of_contact = np.repeat(np.cumsum(dts > 0.0) - 1, np.diff(contact_end))
        frame_of_contact[np.repeat(dts <= 0.0, np.diff(contact_end))] = -1
        gripping = contacts.normal_impulse > 0.0
        gripping &= self._driven[contacts.body_a] | self._driven[contacts.body_b]
        found: dict[int, tuple[tuple[str, str], ...]] = {}
        for body, seen in self._bodies.items():
            of_body = ((contacts.body_a == body) | (contacts.body_b == body)) & (frame_of_contact >= 0)
            if len(rows) and (seen.sole_support_s > 0.0 or (of_body & gripping).any()):
                own = Contacts._make(column[of_body] for column in contacts)
                loads = self._loads(body, seen, dts[rows], own, frame_of_contact[of_body], poses[rows, body])
                for row, *load in zip(rows.tolist(), *(column.tolist() for column in loads), strict=True):
                    if message := self._follow(body, seen, *load):
                        found[row] = (*found.get(row, ()), message)
            elif len(rows):
                seen.centre = seen.velocity = None
        return found

    def _loads(
        self, body: int, seen: _Body, dts: Floats, contacts: Contacts, frames: Ints, poses: Floats
    ) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Durations [s], grip forces and other forces [N], heights [m] and margins (n,) of a body with poses (n, 7).

        `frames` (m,) are those of its `contacts`. A margin is inf where friction carries nothing.
        """
        count, on_a = len(dts), contacts.body_a == body
        other = np.where(on_a, contacts.body_b, contacts.body_a)
        force, driven = contacts.normal_impulse / dts[frames], self._driven[other]
        grip = np.where(driven, force, 0.0)
        bodies, friction = self._scene.bodies, self._scene.materials.friction
        available = _sums(frames, friction[bodies.material[body], bodies.material[other]] * grip, count)
        into_body = contacts.normal * (np.where(on_a, 1.0, -1.0) * grip)[:, None]
        pressed = np.stack([_sums(frames, column, count) for column in into_body.T], axis=1)
        grip_force, other_force = (
            _sums(frames, grip, count),
            _sums(frames, np.where(driven, 0.0, force), count),
        )
        acceleration = self._acceleration(body, seen, dts, grip_force > MIN_FORCE, poses)
        needed = np.linalg.norm(bodies.mass[body] * (acceleration - self._scene.gravity) - pressed, axis=1)
        margin = np.full(count, math.inf)
        np.divide(available, needed, out=margin, where=needed > MIN_FORCE)
        return dts, grip_force, other_force, poses[:, :3] @ self._up, margin

    def _acceleration(self, body: int, seen: _Body, dts: Floats, touched: NDArray[np.bool_], poses: Floats) -> Floats:
        """Acceleration (n, 3) [m/s²] of a body's centre of mass: zero but where it was touched in the two frames before too."""
        matrices = matrix_from_pose(poses)
        centres = matrices[:, :3, :3] @ self._scene.bodies.com[body] + matrices[:, :3, 3]
        known = np.concatenate([[seen.centre is not None], touched])
        start = centres[0] if seen.centre is None else seen.centre
        velocity = np.diff(centres, axis=0, prepend=start[None]) / dts[:, None]
        moved = np.concatenate([[seen.velocity is not None], known[1:] & known[:-1]])
        start = velocity[0] if seen.velocity is None else seen.velocity
        acceleration = np.diff(velocity, axis=0, prepend=start[None]) / dts[:, None]
        seen.centre = centres[-1] if known[-1] else None
        seen.velocity = velocity[-1] if moved[-1] else None
        return np.where((moved[1:] & moved[:-1])[:, None], acceleration, 0.0)

    def _follow(
        self, body: int, seen: _Body, dt: float, grip_force: float, other_force: float, height: float, margin: float
    ) -> tuple[str, str] | None:
        """Take a frame of a body; returns a message of what changed."""
        name, was_held, touched = self._names[body], seen.sole_support_s >= HELD_FOR, grip_force > MIN_FORCE
        if touched:
            seen.touched_s += dt
            seen.touch_forces.append(grip_force)
        if not touched or other_force > MIN_FORCE:
            seen.sole_support_s = 0.0
            seen.latest.clear()
            dropped = was_held and not touched and other_force <= MIN_FORCE
            seen.dropped += dropped
            ended = ("warning", f"{name}: dropped") if dropped else ("info", f"{name}: set down")
            return ended if was_held else None
        if seen.sole_support_s == 0.0:
            seen.start_height = height
        seen.sole_support_s += dt
        seen.lifted = max(seen.lifted, height - seen.start_height)
        if seen.sole_support_s < HELD_FOR:
            return None
        seen.held_s += dt if was_held else seen.sole_support_s
        seen.grip_forces.append(grip_force)
        seen.latest.append((seen.sole_support_s, margin))
        # what follows within `HELD_FOR` counts only if it is still held then: a hand that opens needs no margin
        while seen.sole_support_s - seen.latest[0][0] >= HELD_FOR:
            seen.margin = min(seen.margin, seen.latest.pop(0)[1])
        return None if was_held else ("info", f"{name}: held with {grip_force:.3g} N")

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
