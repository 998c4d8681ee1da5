"""What happens between two corrected frames, by brute force: sampled at 1 kHz, and followed in steps as small as it takes.

Two frames that are free do not tell whether the way between them was. A straight line from one to the other may cut an
edge that the body went round, and that is no fault; but somewhere near it there must be a way that leads through nothing.
`follow` looks for it: it takes the body along the line, in small steps, and keeps it out of everything by the least
translation, or translation and turn, from there; then along detours. A body that has been put through something is held
up there and does not arrive.
"""

from __future__ import annotations

import coal
import numpy as np
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation, Slerp

from geomphys.scene.arrays import DRIVEN
from tests.driven.logs import Engine, Floats, Run

CLEAR = 1e-6  # m, kept while following
TOUCHING = 2e-5  # m
ARRIVED = 1e-4  # m
DETOURS = 40
JUMP = 5e-3  # m: what has to be put so far aside at once may have got through something
ARM = 0.1  # m: a turn counts as the translation of a point so far away
SHARE = 0.2  # of the mean thickness of two pieces: what is no deeper between frames cannot be on its way through


def lines(contacts: Floats, times: int) -> Floats:
    """Poses (n, B, 7), and `times` - 1 between any two of them on straight lines: ((n - 1) * times + 1, B, 7)."""
    n = len(contacts)
    t = np.arange((n - 1) * times + 1) / times
    out = np.empty((len(t), *contacts.shape[1:]))
    for body in range(contacts.shape[1]):
        for k in range(3):
            out[:, body, k] = np.interp(t, np.arange(n), contacts[:, body, k])
        out[:, body, 3:] = Slerp(np.arange(n), Rotation.from_quat(contacts[:, body, 3:]))(t).as_quat()
    return out


def least_offset(normals: Floats, bounds: Floats) -> Floats | None:
    """The shortest x (n,) with normals x >= bounds, None if there is none (Lawson and Hanson: least distance by NNLS)."""
    width = normals.shape[1]
    if (bounds <= 0.0).all():
        return np.zeros(width)
    matrix, right = np.vstack([normals.T, bounds]), np.append(np.zeros(width), 1.0)
    u, misfit = nnls(matrix, right)
    if misfit < 1e-9:
        return None
    rest = matrix @ u - right
    return np.asarray(-rest[:width] / rest[width])


class Between:
    """Brute force between the frames of a run."""

    def __init__(self, run: Run, frame_rate: float = 60.0) -> None:
        self.run, self.engine, self.frame_rate = run, Engine(run.world), frame_rate
        scene = run.world.scene
        self.pieces, self.body_tree, self.trees = scene.pieces, scene.bodies.tree, scene.trees
        self.tree = scene.bodies.tree[scene.pieces.body]
        self.a, self.b = np.array(self.engine.pairs).T
        self.room = self.pieces.reach[self.a] + self.pieces.reach[self.b]
        self.mean = 0.5 * (self.pieces.thickness[self.a] + self.pieces.thickness[self.b])

    def _centres(self, frames: Floats) -> Floats:
        return np.asarray(np.einsum("pij,pj->pi", frames[:, :3, :3], self.pieces.centre) + frames[:, :3, 3])

    def deep(self, rate: float = 1000.0, share: float = SHARE) -> dict[int, float]:
        """Frames after which, sampled at `rate` [Hz], a pair is deeper in each other than a share of its thickness: how
        deep at most [m]."""
        times = int(np.ceil(rate / self.frame_rate))
        found: dict[int, float] = {}
        for k, poses in enumerate(lines(self.run.corrected, times)):
            if k % times == 0:
                continue
            frames = self.engine.frames(poses)
            centres = self._centres(frames)
            for i in np.flatnonzero(np.linalg.norm(centres[self.a] - centres[self.b], axis=1) < self.room):
                depth = -self.engine.gap(int(self.a[i]), int(self.b[i]), frames)
                if depth > share * self.mean[i]:
                    found[k // times] = max(found.get(k // times, 0.0), depth)
        return found

    def _pivot(self, poses: Floats, tree: int) -> Floats:
        """(3,) what a tree is turned about: the root's place."""
        return np.asarray(poses[np.flatnonzero(self.body_tree == tree)[0], :3])

    def _placed(self, poses: Floats, offsets: dict[int, Floats]) -> Floats:
        """(B, 7) poses with trees turned about their pivots by rotation vectors over `ARM`, and shifted."""
        placed = poses.copy()
        for tree, offset in offsets.items():
            bodies, pivot = self.body_tree == tree, self._pivot(poses, tree)
            turn = Rotation.from_rotvec(offset[3:] / ARM if len(offset) == 6 else np.zeros(3))
            placed[bodies, :3] = pivot + turn.apply(poses[bodies, :3] - pivot) + offset[:3]
            placed[bodies, 3:] = (turn * Rotation.from_quat(poses[bodies, 3:])).as_quat()
        return placed

    def _planes(
        self, offsets: dict[int, Floats], placed: Floats, reach: float, normals: dict[int, Floats]
    ) -> tuple[Floats, Floats]:
        """Half-spaces for the offsets of all trees in a contact, one for each pair of pieces within `reach` of each other.

        The direction between two points a micrometre apart is noise, so pairs that touch keep the one they had: `normals`.
        """
        frames, each = self.engine.frames(placed), len(next(iter(offsets.values())))
        centres, width = self._centres(frames), each * len(offsets)
        contacts, bounds = [np.zeros(width)], [0.0]
        near = np.linalg.norm(centres[self.a] - centres[self.b], axis=1) < self.room + reach
        for i in np.flatnonzero(near & (self.tree[self.a] != self.tree[self.b])):
            a, b = int(self.a[i]), int(self.b[i])
            places = (
                coal.Transform3s(np.ascontiguousarray(frames[k, :3, :3]), np.ascontiguousarray(frames[k, :3, 3]))
                for k in (a, b)
            )
            result = coal.DistanceResult()
            gap = coal.distance(
                self.engine.shapes[a], next(places), self.engine.shapes[b], next(places), coal.DistanceRequest(), result
            )
            if abs(gap) > TOUCHING or i not in normals:
                normals[int(i)] = np.array(result.normal)
            contact, bound = np.zeros(width), CLEAR - gap
            for place, (tree, offset) in enumerate(offsets.items()):
                if tree in (self.tree[a], self.tree[b]):
                    first = tree == self.tree[a]
                    out = normals[int(i)] * (-1.0 if first else 1.0)  # coal's points from a to b
                    point = np.array(result.getNearestPoint1() if first else result.getNearestPoint2())
                    lever = np.cross(point - self._pivot(placed, tree), out) / ARM
                    effect = np.concatenate([out, lever])[:each]
                    contact[each * place : each * (place + 1)] = effect
                    bound += float(effect @ offset)
            contacts.append(contact)
            bounds.append(bound)
        return np.array(contacts), np.array(bounds)

    def follow(self, frame: int, steps: int, turning: bool = False, via: dict[int, Floats] | None = None) -> float:
        """How far [m] from its corrected place in frame + 1 a tree arrives that goes there from `frame` through nothing.

        Driven trees give way to each other: what one does not yield to is not in its way if that one can yield. They give
        way by translation, or by `turning` too. The line leads `via` where trees are so far off halfway, if it is given.
        """
        ends = self.run.corrected[frame : frame + 2]
        if via is not None:
            ends = np.stack([ends[0], self._placed(lines(ends, 2)[1], via), ends[1]])
        driven, normals = np.flatnonzero(self.trees.role == DRIVEN), dict[int, Floats]()
        offsets = {int(tree): np.zeros(6 if turning else 3) for tree in driven}
        for poses in lines(ends, steps)[1:]:
            for _ in range(8):
                reach = 3.0 * max(float(np.linalg.norm(moved)) for moved in offsets.values()) + 0.01
                contacts, bounds = self._planes(offsets, self._placed(poses, offsets), reach, normals)
                best = least_offset(contacts, bounds)
                if best is None:
                    return np.inf
                change = 0.0
                for new, tree in zip(np.split(best, len(offsets)), offsets, strict=True):
                    change = max(change, float(np.linalg.norm(new - offsets[tree])))
                    offsets[tree] = new
                if change > JUMP:
                    return np.inf
                if change < 1e-7:
                    break
        return max(float(np.linalg.norm(offset)) for offset in offsets.values())

    def tunnels(self) -> dict[int, float]:
        """Frames from which something got to the next one through something: how far off it arrives if it may not [m]."""
        found = {}
        for frame in self.deep():
            if not any(
                self.follow(frame, steps, turning) <= ARRIVED for steps in (64, 512) for turning in (False, True)
            ):
                off = self._detour(frame)
                if off > ARRIVED:
                    found[frame] = off
        return found

    def _detour(self, frame: int) -> float:
        """How far off a tree arrives [m] by the best of many ways that begin with a detour of some centimetres."""
        rng, best = np.random.default_rng(frame), np.inf
        driven = np.flatnonzero(self.trees.role == DRIVEN)
        for _ in range(DETOURS):
            far = rng.uniform(0.005, 0.04)
            best = min(best, self.follow(frame, 200, True, {int(tree): far * rng.normal(size=6) for tree in driven}))
            if best <= ARRIVED:
                break
        return best
