"""Small scenes with their recordings, replayed through the whole pipeline, and an independent measure of what overlaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from pathlib import Path

import coal
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation, Slerp

from geomphys.config import Config
from geomphys.load import load_world
from geomphys.numerics.transforms import compose, matrix_from_frame, matrix_from_pose
from geomphys.replays import replay
from geomphys.results import FrameResult
from geomphys.scene.arrays import DRIVEN
from geomphys.scene.world import World
from tests.collision.engines import coal_place, coal_shape
from tests.recording.log_files import Item, joints, pose, write_log
from tests.scene.models import stl

Floats = NDArray[np.float64]

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
GAP = 2e-6  # m, kept between surfaces by default
FREE = 1e-5  # m: an overlap up to this counts as none


@dataclass(frozen=True, kw_only=True)
class Thing:
    """An object. `shape` is ("box", x, y, z), ("sphere", r), ("cylinder", r, h), ("capsule", r, h) or corners (n, 3) of a
    hull; `path` (n, 3) or (n, 7) are its recorded poses, one a frame."""

    name: str
    shape: Sequence[float | str] | Floats
    role: str = "fixed"
    at: Sequence[float] = (0.0, 0.0, 0.0)
    turn: Sequence[float] = UPRIGHT
    path: Floats | None = None
    extra: str = ""

    def toml(self, folder: Path) -> str:
        """Its table in the scene file; a hull is written to a mesh."""
        if isinstance(self.shape, np.ndarray):
            hull = ConvexHull(self.shape)
            corners = self.shape[hull.vertices]
            shell = ConvexHull(corners)
            faces = [
                t
                if np.dot(np.cross(corners[t[1]] - corners[t[0]], corners[t[2]] - corners[t[0]]), e[:3]) > 0
                else t[::-1]
                for t, e in zip(shell.simplices, shell.equations, strict=True)
            ]
            stl(folder / f"{self.name}.stl", corners, np.array(faces))
            shape = f'mesh = "{self.name}.stl"\ndecomposition = "hull"'
        else:
            kind, *sizes = self.shape
            shape = f"{kind} = {sizes[0] if kind == 'sphere' else list(map(float, sizes))}"
        lines = [f'name = "{self.name}"\nclass = "{self.role}"', shape, 'material = "wood"', self.extra]
        if self.path is None:
            lines.append(f"position = {list(map(float, self.at))}\norientation = {list(map(float, self.turn))}")
        else:
            lines.append(f'topic = "/{self.name}"')
        return "[[object]]\n" + "\n".join(lines) + "\n"


@dataclass(frozen=True)
class Run:
    """A replay: world and results, with what tests ask for as arrays over frames."""

    world: World
    results: list[FrameResult] = field(repr=False)

    @cached_property
    def recorded(self) -> Floats:
        """(N, B, 7)"""
        return np.array([r.recorded for r in self.results])

    @cached_property
    def corrected(self) -> Floats:
        """(N, B, 7)"""
        return np.array([r.corrected for r in self.results])

    @cached_property
    def angles(self) -> Floats:
        """(N, Q), corrected"""
        return np.array([r.angles for r in self.results])

    @cached_property
    def recorded_angles(self) -> Floats:
        """(N, Q)"""
        return np.array([r.frame.angles for r in self.results])

    def figures(self, name: str) -> NDArray[np.float64]:
        """(N,) a field of the metrics."""
        return np.array([getattr(r.metrics, name) for r in self.results])

    @property
    def residual(self) -> Floats:
        """(N,) m"""
        return self.figures("residual_penetration_m")

    def body(self, name: str) -> int:
        """Index of a body."""
        return self.world.body_names.index(name)

    def path(self, name: str) -> Floats:
        """(N, 7) corrected poses of a body."""
        return self.corrected[:, self.body(name)]

    def offset(self, name: str) -> Floats:
        """(N, 3) m, corrected - recorded position of a body."""
        k = self.body(name)
        return self.corrected[:, k, :3] - self.recorded[:, k, :3]

    def touched(self) -> NDArray[np.bool_]:
        """(N,) frames in which anything was corrected."""
        return (self.corrected != self.recorded).any(axis=(1, 2)) | (self.angles != self.recorded_angles).any(axis=1)


def play(
    folder: Path,
    things: Sequence[Thing] = (),
    *,
    avatars: str = "",
    angles: dict[str, tuple[Sequence[str], Floats]] | None = None,
    roots: dict[str, Floats] | None = None,
    rate: float = 60.0,
    config: Config | None = None,
) -> Run:
    """Write scene and log, replay. `angles`: topic -> (names, (n, m) rad); `roots`: topic -> (n, 3 or 7) poses."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.toml").write_text(avatars + "\n" + "".join(t.toml(folder) for t in things))
    items: list[Item] = []
    poses = {f"/{t.name}": t.path for t in things if t.path is not None} | (roots or {})
    for topic, rows in poses.items():
        items += [pose(topic, 1.0 + k / rate, row if len(row) == 7 else (*row, *UPRIGHT)) for k, row in enumerate(rows)]
    for topic, (names, values) in (angles or {}).items():
        items += [
            joints(topic, 1.0 + k / rate, dict(zip(names, map(float, row), strict=True)))
            for k, row in enumerate(values)
        ]
    items.sort(key=lambda item: item.log_time)
    write_log(folder / "log.mcap", items, encoding="protobuf")
    world = load_world(folder / "scene.toml", mode=config.mode if config else None)
    return Run(world, list(replay(folder / "log.mcap", world, config=config)))


def line(*points: Sequence[float], frames: Sequence[int]) -> Floats:
    """Straight from point to point, in so many frames each; points are positions, or poses (turned by slerp)."""
    rows = [np.array(points[0], float)[None]]
    for a, b, n in zip(points, points[1:], frames, strict=False):
        s = np.arange(1, n + 1)[:, None] / n
        p, q = np.array(a, float), np.array(b, float)
        part = p[:3] + s * (q[:3] - p[:3])
        part[-1] = q[:3]
        if len(p) == 7:
            turns = Slerp([0.0, 1.0], Rotation.from_quat([p[3:], q[3:]]))(s[:, 0]).as_quat()
            part = np.hstack([part, turns])
        rows.append(part)
    return np.vstack(rows)


def wander(
    rng: np.random.Generator, frames: int, reach: float, speed: float, rate: float = 60.0, turn: float = 1.0
) -> Floats:
    """(n, 7) a smooth random walk about the origin: sums of sines up to `speed` m/s and `turn` rad."""
    t = np.arange(frames) / rate
    waves = np.zeros((frames, 6))
    for k in range(6):
        for _ in range(3):
            amplitude = rng.uniform(0.3, 1.0)
            waves[:, k] += amplitude * np.sin(speed / reach * rng.uniform(0.5, 1.5) * t + rng.uniform(0, 2 * np.pi))
    turns = Rotation.from_rotvec(turn * waves[:, 3:] / 2).as_quat()
    return np.hstack([reach * waves[:, :3] / 2, turns])


class Engine:
    """The pieces of a world as shapes of coal."""

    def __init__(self, world: World) -> None:
        self.world = world
        pieces = world.scene.pieces
        self.shapes = [coal_shape(pieces, k) for k in range(len(pieces.kind))]
        role, tree = world.scene.bodies.role[pieces.body], world.scene.bodies.tree[pieces.body]
        excluded, chains = world.scene.excluded, world.scene.trees.chains
        self.pairs = [
            (i, j)
            for i, j in combinations(range(len(self.shapes)), 2)
            if DRIVEN in (role[i], role[j])
            and (tree[i] != tree[j] or (chains[tree[i]] and not excluded[pieces.body[i], pieces.body[j]]))
            and pieces.body[i] != pieces.body[j]
        ]

    def frames(self, poses: Floats) -> Floats:
        """(P, 4, 4) world_from_piece."""
        pieces = self.world.scene.pieces
        return np.array(
            [
                compose(matrix_from_pose(poses[pieces.body[k]]), matrix_from_frame(pieces.local[k]))
                for k in range(len(self.shapes))
            ]
        )

    def gap(self, i: int, j: int, frames: Floats) -> float:
        """Distance [m] of two pieces; negative: their penetration depth."""
        a, b = coal_place(frames[i]), coal_place(frames[j])
        return float(coal.distance(self.shapes[i], a, self.shapes[j], b, coal.DistanceRequest(), coal.DistanceResult()))

    def deepest(self, poses: Floats) -> float:
        """Deepest overlap [m] of driven pieces with anything, in poses (B, 7)."""
        frames, pieces = self.frames(poses), self.world.scene.pieces
        centres = np.einsum("pij,pj->pi", frames[:, :3, :3], pieces.centre) + frames[:, :3, 3]
        worst = 0.0
        for i, j in self.pairs:
            if np.linalg.norm(centres[i] - centres[j]) < pieces.reach[i] + pieces.reach[j]:
                worst = max(worst, -self.gap(i, j, frames))
        return worst


def assert_free(run: Run, every: int = 1) -> None:
    """No overlap in any frame, neither by the pipeline's own measure nor by coal's; no NaN; every frame has a result."""
    assert np.isfinite(run.corrected).all()
    assert np.isfinite(run.angles).all()
    assert run.residual.max() <= FREE
    engine = Engine(run.world)
    worst = [engine.deepest(poses) for poses in run.corrected[::every]]
    assert max(worst) <= FREE, f"frame {every * int(np.argmax(worst))}: {max(worst)} m"


def chatter(rows: Floats) -> float:
    """Largest second difference of positions (n, 3) [m]."""
    return float(np.linalg.norm(np.diff(rows, n=2, axis=0), axis=1).max())
