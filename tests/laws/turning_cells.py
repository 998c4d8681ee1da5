"""Scenes in which what is round a driven body turns by a recording: cells, boxes without a lid, slots, forks and doors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from geomphys.scene.arrays import DRIVEN
from tests.driven.logs import Engine, Floats, Run, Thing, play, wander
from tests.laws.between_frames import lines
from tests.scene.models import joint, link, urdf

KINDS = ("cell", "box", "carried", "lidless", "slot", "fork", "door", "shut door")
CLOSED = ("cell", "box", "carried")
EVERY = tuple((axis, sign) for axis in range(3) for sign in (-1, 1))
HALF, ROOM = 0.05, 0.054  # m: half sizes of a cube and of the cell it is in
BODIES = ("block", "ball", "rod", "hull", "hand", "chains")


@dataclass(frozen=True)
class Turning:
    """What is round a driven body: panels of a frame of reference that moves by a recording.

    `frame` (n, 7) are the poses of that frame, `half` (3,) the inner half sizes of the cell it is, or would be were it
    closed, `sides` which of its six walls there are, as (axis, sign), `rate` frames a second.
    """

    kind: str
    body: str
    frame: Floats
    half: Floats
    sides: tuple[tuple[int, int], ...]
    rate: float

    def inside(self, points: Floats, frame: Floats | None = None) -> Floats:
        """How far [m] points (n, P, 3) are inside the walls there are, (n, P): negative beyond one of them."""
        frame = self.frame if frame is None else frame
        turns = Rotation.from_quat(frame[:, 3:]).as_matrix()
        local = np.einsum("nji,npj->npi", turns, points - frame[:, None, :3])
        return np.min([self.half[axis] - sign * local[:, :, axis] for axis, sign in self.sides], axis=0)


def frame_path(rng: np.random.Generator, n: int, rate: float, kind: str, size: float) -> Floats:
    """Poses (n, 7) that turn about a random axis and a random centre, at the origin, upright, to begin with."""
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    speed = float(rng.uniform(0.5, 2 * np.pi))
    t = np.arange(n) / rate
    angle = speed * t if rng.integers(2) else speed * np.sin(1.5 * t)
    centre = rng.normal(size=3) * (0.0 if kind == "cell" else float(rng.choice([0.5, 3.0])) * size)
    turns = Rotation.from_rotvec(np.outer(angle, axis))
    at = centre - turns.apply(centre)
    if kind == "carried":
        shift = wander(rng, n, 0.3, 1.0, rate)[:, :3]
        at += shift - shift[0]
    return np.hstack([at, turns.as_quat()])


def panels(half: Floats, thin: float, sides: Sequence[tuple[int, int]]) -> list[tuple[Floats, Floats]]:
    """(sizes, centre) of the walls of a cell, outside of `half`."""
    return [
        (np.where(np.arange(3) == axis, thin, 2 * half + 2 * thin), sign * (half[axis] + 0.5 * thin) * np.eye(3)[axis])
        for axis, sign in sides
    ]


def text(values: Sequence[float] | Floats) -> str:
    return " ".join(map(repr, map(float, values)))


def as_things(walls: list[tuple[Floats, Floats]], frame: Floats) -> list[Thing]:
    """Each wall an object of its own."""
    turns = Rotation.from_quat(frame[:, 3:])
    return [
        Thing(name=f"wall{k}", shape=("box", *sizes), path=np.hstack([frame[:, :3] + turns.apply(at), frame[:, 3:]]))
        for k, (sizes, at) in enumerate(walls)
    ]


def as_one(folder: Path, walls: list[tuple[Floats, Floats]]) -> str:
    """All walls one object, its scene text."""
    shapes = [f'<origin xyz="{text(at)}"/><geometry><box size="{text(sizes)}"/></geometry>' for sizes, at in walls]
    urdf(folder / "cell.urdf", link("cell", *shapes))
    return '[[object]]\nname="cell"\nclass="fixed"\nurdf="cell.urdf"\nmaterial="wood"\ntopic="/cell"\n'


def hand(folder: Path, size: float, mode: str) -> tuple[str, Floats]:
    """Scene text and half sizes of a palm with two fingers of two links each, along z."""
    parts = [link("palm", f'<geometry><box size="{text((size, 0.3 * size, 0.6 * size))}"/></geometry>')]
    bend = '<axis xyz="1 0 0"/><limit lower="-1.5" upper="1.5" effort="1" velocity="1"/>'
    bone = text((0.2 * size, 0.15 * size, 0.36 * size))
    shape = f'<origin xyz="{text((0, 0, 0.2 * size))}"/><geometry><box size="{bone}"/></geometry>'
    table = ""
    for name, x in (("a", -0.3), ("b", 0.3)):
        parts += [
            link(f"{name}1", shape),
            link(f"{name}2", shape),
            joint(f"j{name}1", "palm", f"{name}1", inside=bend, xyz=text((x * size, 0, 0.3 * size))),
            joint(f"j{name}2", f"{name}1", f"{name}2", inside=bend, xyz=text((0, 0, 0.4 * size))),
        ]
        table += f'[[avatar.chain]]\nname="{name}"\nbase="palm"\ntip="{name}2"\n' if mode == "chains" else ""
    urdf(folder / "hand.urdf", *parts)
    scene = (
        f'[[avatar]]\nname="hand"\nurdf="hand.urdf"\nmode="{mode}"\nmaterial="human"\nroot={{topic="/hand"}}\n'
        f'joints={{topic="/angles"}}\n{table}'
    )
    return scene, np.array([0.5 * size, 0.15 * size, 0.7 * size])


def play_turning(folder: Path, seed: int, n: int = 60, kind: str = "", body: str = "") -> tuple[Turning, Run]:
    """A random scene of a kind of `KINDS` and a body of `BODIES`: what it was, and what became of it."""
    rng = np.random.default_rng(seed)
    kind = kind or KINDS[seed % len(KINDS)]
    body = body or BODIES[int(rng.integers(len(BODIES)))]
    rate = float(rng.choice([30.0, 60.0, 120.0]))
    folder.mkdir(parents=True, exist_ok=True)
    a, b, c = map(float, rng.uniform(0.03, 0.1, 3))
    scene, shape, size = "", None, np.array([a, b, c]) / 2
    if body in ("hand", "chains"):
        scene, size = hand(folder, a + 0.03, "rigid" if body == "hand" else "chains")
    elif body == "block":
        shape = ("box", a, b, c)
    elif body == "ball":
        shape, size = ("sphere", a / 2), np.full(3, a / 2)
    elif body == "rod":
        shape, size = ("capsule", a / 4, b), np.array([a / 4, a / 4, b / 2 + a / 4])
    else:
        shape = (rng.normal(size=(16, 3)) * 0.02).astype(np.float32).astype(float)
        size = np.abs(shape).max(axis=0)
    half, thin = size * rng.uniform(1.02, 1.6, 3), float(rng.choice([0.001, 0.003, 0.01]))
    sides = {
        "lidless": tuple(side for side in EVERY if side != (2, 1)),
        "slot": ((0, -1), (0, 1)),
        "fork": ((0, -1), (0, 1), (1, -1)),
        "door": ((0, -1),),
        "shut door": ((0, -1),),
    }.get(kind, EVERY)
    frame = frame_path(rng, n, rate, kind, float(np.linalg.norm(half)))
    things: list[Thing] = []
    if kind in ("door", "shut door"):
        half = np.array([half[0] + 0.02, 2 * half[1] + 0.05, 2 * half[2] + 0.05])
        speed = float(rng.uniform(1.0, 2 * np.pi))
        edge = np.array([-half[0], -half[1], 0.0])
        turns = Rotation.from_rotvec(np.outer(-speed * np.sin(np.arange(n) / rate), [0, 0, 1]))
        frame = np.hstack([edge - turns.apply(edge), turns.as_quat()])
        if kind == "shut door":
            away = half[0] + 2.2 * size[0]
            things.append(Thing(name="barrier", shape=("box", 0.01, 2, 2), at=(away + 0.005, 0, 0)))
    walls = panels(half, thin, sides)
    roots: dict[str, Floats] = {}
    if kind in ("cell", "slot", "door", "shut door"):
        things += as_things(walls, frame)
    else:
        scene += as_one(folder, walls)
        roots["/cell"] = frame
    path = np.tile([0.0, 0, 0, 0, 0, 0, 1], (n, 1))
    if rng.integers(2):
        path = wander(rng, n, 0.1, float(rng.uniform(0.2, 1.0)), rate, turn=1.0)
        first = Rotation.from_quat(path[0, 3:]).inv()
        path[:, :3] -= path[0, :3]
        path[:, 3:] = (Rotation.from_quat(path[:, 3:]) * first).as_quat()
    if kind in ("box", "carried") and rng.integers(3) == 0:
        path = frame.copy()  # goes along, but does not turn
        path[:, 3:] = [0, 0, 0, 1]
    angles = None
    if shape is None:
        turns = Rotation.from_quat(path[:, 3:])
        roots["/hand"] = np.hstack([path[:, :3] - turns.apply([0, 0, 0.4 * (a + 0.03)]), path[:, 3:]])
        bend = 0.5 * np.sin(2 * np.arange(n) / rate)[:, None] * rng.uniform(0, 1, 4) * rng.integers(2)
        angles = {"/angles": (["ja1", "ja2", "jb1", "jb2"], bend)}
    else:
        things.append(Thing(name="body", shape=shape, role="driven", path=path))
    run = play(folder, things, avatars=scene, roots=roots, angles=angles, rate=rate)
    return Turning(kind, body, frame, half, sides, rate), run


def driven_centres(run: Run, contacts: Floats) -> Floats:
    """(n, P, 3) centres of the driven pieces in poses (n, B, 7)."""
    scene = run.world.scene
    mine = np.flatnonzero(scene.bodies.role[scene.pieces.body] == DRIVEN)
    engine = Engine(run.world)
    frames = np.array([engine.frames(poses)[mine] for poses in contacts])
    return np.asarray(np.einsum("npij,pj->npi", frames[..., :3, :3], scene.pieces.centre[mine]) + frames[..., :3, 3])


def crossings(turning: Turning, run: Run) -> list[float]:
    """Moments, in frames, at which some driven piece is beyond a wall of a closed cell, at 1 kHz between the frames."""
    times = int(np.ceil(1000.0 / turning.rate))
    frames = lines(turning.frame[:, None], times)[:, 0]
    inside = turning.inside(driven_centres(run, lines(run.corrected, times)), frames).min(axis=1)
    return [float(k) / times for k in np.flatnonzero(inside < 0.0)]


def jumps(rate: float, run: Run, allowed: float = 2e-3) -> dict[int, float]:
    """Frames in which the offset of a driven piece changes by more than what moves excuses, and by how much more [m].

    Excused is twice the fastest recorded motion of anything and `allowed` [m], and what the coupling's spring takes
    back in a frame of 1 / `rate` [s].
    """
    scene, engine = run.world.scene, Engine(run.world)
    mine = scene.bodies.role[scene.pieces.body] == DRIVEN
    here, there = (
        np.einsum("npij,pj->npi", frames[..., :3, :3], scene.pieces.centre) + frames[..., :3, 3]
        for frames in (
            np.array([engine.frames(poses) for poses in contacts]) for contacts in (run.corrected, run.recorded)
        )
    )
    motion = np.linalg.norm(np.diff(there, axis=0), axis=2).max(axis=1)
    offset = (here - there)[:, mine]
    change, size = np.diff(offset, axis=0), np.linalg.norm(offset[:-1], axis=2)
    way = offset[:-1] / np.where(size > 0, size, 1.0)[..., None]
    back = np.clip(-np.sum(change * way, axis=2), 0.0, (1.0 - np.exp(-50.0 / rate)) * size)
    rest = np.linalg.norm(change + back[..., None] * way, axis=2).max(axis=1) - 2.0 * motion - allowed
    return {int(k) + 1: float(rest[k]) for k in np.flatnonzero(rest > 0.0)}


def turning_frame(angles: np.ndarray, centre: tuple[float, float, float] = (0, 0, 0)) -> np.ndarray:
    """Poses (n, 7) turned by `angles` [rad] about z, round `centre`."""
    turns = Rotation.from_rotvec(np.outer(angles, [0, 0, 1]))
    return np.hstack([np.array(centre) - turns.apply(centre), turns.as_quat()])


def play_cube(folder: Path, frame: np.ndarray, whole: bool, thin: float = 0.002) -> Run:
    """A cube, recorded at rest, in a cell that moves by `frame`."""
    folder.mkdir(parents=True, exist_ok=True)
    walls = panels(np.full(3, ROOM), thin, EVERY)
    still = np.tile([0.0, 0, 0, 0, 0, 0, 1], (len(frame), 1))
    things = [Thing(name="cube", shape=("box", *[2 * HALF] * 3), role="driven", path=still)]
    if whole:
        return play(folder, things, avatars=as_one(folder, walls), roots={"/cell": frame})
    return play(folder, [*as_things(walls, frame), *things])
