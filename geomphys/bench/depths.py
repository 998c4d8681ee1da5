"""Times and checks penetration depths of pairs of convex pieces: the kernels of geomphys, coal and python-fcl."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.bench.depth_engines import Coal, DepthPeer, Fcl
from geomphys.bench.pair_loop import SEPARATION, Separations, measure_pairs
from geomphys.bench.report import DepthEngine, DepthResult, distribution_of
from geomphys.collision.penetration import make_scratch
from geomphys.jit.packed_records import pack
from geomphys.numerics.transforms import compose, frame_from_matrix, matrix_from_frame, matrix_from_pose
from geomphys.results import FrameResult
from geomphys.scene.arrays import BOX, CAPSULE, CYLINDER, SPHERE, Pieces
from geomphys.scene.pieces import Box, Capsule, Cylinder, Hull, PosedShape, Shape, Sphere, build_pieces
from geomphys.scene.world import World

Floats = NDArray[np.float64]

CORNERS = (8, 20, 60, 250)  # of random hulls
SHALLOW = 0.05  # fraction of the depth kept in the shallow sets; most overlaps of a replay are shallow
PAIRS = 24  # random pairs for each number of corners
MAX_RECORDED_PAIRS = 256  # most pairs taken from an experiment
BLOCK = 64  # pairs timed together, so that the cost of the call itself is negligible
FRAME_STRIDE = 5  # pairs are taken from every so many frames


class Pairs(NamedTuple):
    """N overlapping pairs: pair k is of the pieces 2k (A) and 2k + 1 (B)."""

    name: str
    pieces: Pieces
    frames: Floats  # (2 N, 12) world_from_piece


def random_pairs(seed: int = 0, corner_counts: Sequence[int] = CORNERS) -> list[Pairs]:
    """Overlapping pairs of random hulls of 2 to 10 cm: for each number of corners a set deep in each other, and the same
    pairs moved apart along their normals until the overlap is shallow.
    """
    random = np.random.default_rng(seed)
    sets = []
    for corners in corner_counts:
        shapes: list[Shape] = []
        frames = []
        for _ in range(PAIRS):
            sizes = random.uniform(0.01, 0.05, (2, 3))
            for size in sizes:
                rays = random.normal(size=(corners, 3))
                shapes.append(Hull(rays / np.linalg.norm(rays, axis=1, keepdims=True) * size))
            rotations = np.linalg.qr(random.normal(size=(2, 3, 3)))[0]
            rotations *= np.sign(np.linalg.det(rotations))[:, None, None]
            direction = random.normal(size=3)
            position = direction / np.linalg.norm(direction) * random.uniform(0.3, 0.9) * np.sum(np.min(sizes, axis=1))
            frames.append(np.concatenate([rotations[0].ravel(), position]))
            frames.append(np.concatenate([rotations[1].ravel(), np.zeros(3)]))
        deep = _overlapping(f"{corners} corners, deep", shapes, np.array(frames))
        grazing = deep.frames.copy()
        exact = PairLoop(deep).all(deep.frames)
        grazing[::2, 9:] -= (1.0 - SHALLOW) * exact["distance"][:, None] * exact["normal"]
        sets += [deep, Pairs(f"{corners} corners, shallow", deep.pieces, grazing)]
    return sets


class RecordedPairs:
    """Gathers the pairs of pieces that overlap in the recorded poses of an experiment."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._shapes: list[Shape] = []
        self._frames: list[Floats] = []

    def __call__(self, world: World, result: FrameResult) -> None:
        """Take the overlapping pairs of a frame."""
        if result.frame.index % FRAME_STRIDE or len(self._shapes) >= 2 * MAX_RECORDED_PAIRS:
            return
        pieces, starts = world.scene.pieces, world.scene.bodies.piece_start
        for a, b in zip(result.penetrations.body_a, result.penetrations.body_b, strict=True):
            for i in range(starts[a], starts[a + 1]):
                for j in range(starts[b], starts[b + 1]):
                    one, other = _frame(world, result, i), _frame(world, result, j)
                    if _distance(pieces, i, one, j, other) < pieces.reach[i] + pieces.reach[j]:
                        self._shapes += [shape_of(pieces, i), shape_of(pieces, j)]
                        self._frames += [one, other]

    def pairs(self) -> Pairs | None:
        """The pairs; None if nothing overlapped."""
        if not self._shapes:
            return None
        found = _overlapping(f"met in {self.name}", self._shapes, np.array(self._frames))
        return found if len(found.frames) else None


def _frame(world: World, result: FrameResult, piece: int) -> Floats:
    """world_from_piece (12,) as recorded."""
    pieces = world.scene.pieces
    pose = matrix_from_pose(result.recorded[pieces.body[piece]])
    return frame_from_matrix(compose(pose, matrix_from_frame(pieces.local[piece])))


def _distance(pieces: Pieces, i: int, one: Floats, j: int, other: Floats) -> float:
    """Distance between the centres of two posed pieces, m."""
    a = one[:9].reshape(3, 3) @ pieces.centre[i] + one[9:]
    b = other[:9].reshape(3, 3) @ pieces.centre[j] + other[9:]
    return float(np.linalg.norm(a - b))


def shape_of(pieces: Pieces, k: int) -> Shape:
    """The shape of a piece."""
    kind, (x, y, z) = int(pieces.kind[k]), (float(v) for v in pieces.size[k])
    if kind == SPHERE:
        return Sphere(x)
    if kind == CAPSULE:
        return Capsule(x, y)
    if kind == BOX:
        return Box((x, y, z))
    if kind == CYLINDER:
        return Cylinder(x, y)
    return Hull(pieces.vertices[pieces.vertex_start[k] : pieces.vertex_start[k + 1]])


def _arranged(name: str, shapes: Sequence[Shape], frames: Floats) -> Pairs:
    return Pairs(name, build_pieces([PosedShape(s, np.eye(4), k) for k, s in enumerate(shapes)]), frames)


def _overlapping(name: str, shapes: Sequence[Shape], frames: Floats) -> Pairs:
    """The pairs among `shapes` that overlap by more than 1 µm."""
    pairs = _arranged(name, shapes, frames)
    keep = np.repeat(PairLoop(pairs).all(frames)["distance"] < -1e-6, 2)
    if keep.all():
        return pairs
    return _arranged(name, [s for s, is_retained in zip(shapes, keep, strict=True) if is_retained], frames[keep])


class PairLoop:
    """The compiled loop over the pairs of a set."""

    def __init__(self, pairs: Pairs) -> None:
        self.count = len(pairs.frames) // 2
        self._pieces, self._scratch = pack(pairs.pieces), pack(make_scratch())
        self._frames = pairs.frames
        self._out = np.zeros(self.count, SEPARATION)

    def run(self, first: int, last: int) -> None:
        """Measure some pairs in one call."""
        measure_pairs(self._pieces, self._frames, first, last, self._out, self._scratch)

    def run_singly(self, first: int, last: int) -> None:
        """Measure some pairs, one a call."""
        for k in range(first, last):
            measure_pairs(self._pieces, self._frames, k, k + 1, self._out, self._scratch)

    def all(self, frames: Floats) -> Separations:
        """(N,) SEPARATION with the pieces at `frames` (2 N, 12)."""
        out = np.zeros(self.count, SEPARATION)
        measure_pairs(self._pieces, frames, 0, self.count, out, self._scratch)
        return out


def compare_depths(pairs: Pairs, repeats: int, with_peers: bool) -> DepthResult:
    """Time the penetration depths of a set of pairs and check their accuracy.

    Engines alternate block by block, so that other load on the machine affects all of them; the time of a block is the
    smallest of its repeats. Peers are called from Python, once a pair, as their users do; reading their
    answers is not timed. The residual is the overlap that remains once a pair is separated along its normal by its depth.

    Raises
    ------
    ConfigError
        A peer is not installed.
    """
    loop = PairLoop(pairs)
    exact = loop.all(pairs.frames)
    peers: list[DepthPeer] = [Coal(pairs.pieces, pairs.frames), Fcl(pairs.pieces, pairs.frames)] if with_peers else []
    engines: dict[str, Callable[[int, int], None]] = {"loop": loop.run, "call": loop.run_singly}
    engines |= {peer.name: peer.run for peer in peers}
    times = _times(engines, loop.count, repeats)
    own_median = float(np.median(times["loop"]))
    rows = []
    for name in engines:
        answers = next((peer.answers() for peer in peers if peer.name == name), exact)
        moved = pairs.frames.copy()
        moved[::2, 9:] -= answers["distance"][:, None] * answers["normal"]
        judge: DepthPeer | PairLoop = peers[0] if peers and name in ("loop", "call") else loop
        residual = np.maximum(0.0, -judge.all(moved)["distance"])
        rows.append(
            DepthEngine(
                engine=f"geomphys, {name}" if name in ("loop", "call") else name,
                ns=distribution_of(times[name]),
                ratio=own_median / float(np.median(times[name])),
                missed=int(np.sum(answers["distance"] == 0.0)),
                deviation=distribution_of(np.abs(answers["distance"] / exact["distance"] - 1.0)),
                residual_m=distribution_of(residual),
                judge="geomphys" if isinstance(judge, PairLoop) else judge.name,
            )
        )
    return DepthResult(name=pairs.name, pairs=loop.count, engines=tuple(rows))


def _times(engines: dict[str, Callable[[int, int], None]], count: int, repeats: int) -> dict[str, Floats]:
    """Ns a pair of each block, by engine; the first round is not counted."""
    edges = np.linspace(0, count, max(1, round(count / BLOCK)) + 1).astype(int).tolist()
    blocks = list(pairwise(edges))
    best = {name: np.full(len(blocks), np.inf) for name in engines}
    for round_index in range(repeats + 1):
        for k, (first, last) in enumerate(blocks):
            for name, run in engines.items():
                start = time.perf_counter_ns()
                run(first, last)
                ns = (time.perf_counter_ns() - start) / (last - first)
                if round_index > 0:
                    best[name][k] = min(best[name][k], ns)
    return best
