"""Ways of two pieces against many moments of them: what is called free passes through nothing, and free ways are found."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from geomphys.collision.detect import make_axes
from geomphys.collision.penetration import make_scratch, separation
from geomphys.driven.advancement import (
    is_separated_on_path,
    pair_motion,
    path_is_free,
    path_tolerance,
    rotation_between,
)
from geomphys.jit.packed_records import pack
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Capsule, Hull
from tests.simulated.scenes import Thing, make_scene

MOMENTS = 80


class Way:
    """Two bodies of one piece each on straight, evenly turning ways; the first is off its body's origin."""

    def __init__(self, rng: np.random.Generator, fast: float = 1.0) -> None:
        shapes = [Box((0.06, 0.02, 0.04)), Capsule(0.02, 0.06), Hull(0.05 * rng.normal(size=(9, 3)))]
        a, b = (shapes[k] for k in rng.integers(0, 3, 2))
        scene = make_scene([Thing(shape=[(a, (0.02, 0.0, 0.03))], role=s.DRIVEN), Thing(shape=b, role=s.DRIVEN)])
        self.scene, self.before, self.after = pack(scene), np.zeros((2, 7)), np.zeros((2, 7))
        self.before[:, :3], self.before[:, 3:] = 0.12 * rng.normal(size=(2, 3)), Rotation.random(2, rng).as_quat()
        swapped = fast >= 1.0 and rng.random() < 0.5  # where they go past or through each other
        self.after[:, :3] = self.before[:: -1 if swapped else 1, :3] + fast * 0.1 * rng.normal(size=(2, 3))
        turn = Rotation.from_rotvec(fast * 0.6 * rng.normal(size=(2, 3)))
        self.after[:, 3:] = (turn * Rotation.from_quat(self.before[:, 3:])).as_quat()
        self.frames, self.scratch, self.axes = np.zeros((2, 12)), pack(make_scratch()), pack(make_axes(16))
        self.pieces = scene.pieces

    def frames_at(self, shares: np.ndarray) -> np.ndarray:
        """(n, 2, 12) world frames of the pieces, the centre of each at shares (n,) of its straight path."""
        frames = np.zeros((len(shares), 2, 12))
        for k in range(2):
            turns = Rotation.from_quat([self.before[k, 3:], self.after[k, 3:]])
            local, shift = self.pieces.local[k, :9].reshape(3, 3), self.pieces.local[k, 9:]
            centre, poses = self.pieces.centre[k], (self.before, self.after)
            ends = [r.apply(local @ centre + shift) + p[k, :3] for r, p in zip(turns, poses, strict=True)]
            rotations = Slerp([0, 1], turns)(shares).as_matrix() @ local
            frames[:, k, :9] = rotations.reshape(-1, 9)
            frames[:, k, 9:] = ends[0] + shares[:, None] * (ends[1] - ends[0]) - rotations @ centre
        return frames

    def separations(self) -> tuple[np.ndarray, tuple[float, float, float]]:
        """Separation at all moments [m], and the normal at the last."""
        found = []
        for frames in self.frames_at(np.linspace(0.0, 1.0, MOMENTS)):
            found.append(separation(self.scene.pieces, frames, 0, 1, 1.0, (0.0, 0.0, 0.0), self.scratch))
        return np.array([s for s, *_ in found]), found[-1][1]

    def is_free(self) -> bool:
        """What the certificate says."""
        return bool(path_is_free(self.scene, self.before, self.after, 0, 1, self.frames, self.axes, self.scratch))


@pytest.mark.parametrize("seed", range(3))
def test_what_is_called_free_passes_through_nothing(seed: int) -> None:
    rng, passed, blocked = np.random.default_rng(seed), 0, 0
    for _ in range(40):
        way = Way(rng)
        found, _ = way.separations()
        deep = path_tolerance(way.scene, 0, 1)
        if found[0] < 0.0 or found[-1] < 0.0:
            continue
        if found.min() < -1.6 * deep:
            assert not way.is_free()
            blocked += 1
        elif found.min() > 1e-3:
            assert way.is_free()
            passed += 1
    assert passed > 5
    assert blocked > 5


@pytest.mark.parametrize("fast", [0.03, 0.1, 0.5])
def test_a_direction_that_parts_both_ends_parts_a_path(fast: float) -> None:
    """With little rotation as it is, with more attached to the piece that rotates most."""
    rng, parted = np.random.default_rng(2), 0
    for _ in range(120):
        way = Way(rng, fast=fast)
        found, n = way.separations()
        motion, _ = pair_motion(way.scene, way.before, way.after, 0, 1)
        at_start, end = way.frames_at(np.array([0.0]))[0], (found[-1], n)
        if found[-1] > 0.0 and is_separated_on_path(way.scene, way.before, way.after, 0, 1, end, motion, at_start):
            parted += 1
            assert found.min() > -1.5 * path_tolerance(way.scene, 0, 1)
    assert parted > 10


def test_a_rod_that_sweeps_through_something_is_blocked_though_both_ends_are_parted() -> None:
    """It lies along y at both ends, on one side of a box, and goes round by half a rotation through it."""
    way = Way(np.random.default_rng(0))
    rod = Thing(shape=Box((0.01, 0.1, 0.01)), role=s.DRIVEN)
    scene = make_scene([rod, Thing(shape=Box((0.02, 0.02, 0.02)), role=s.DRIVEN)])
    way.scene, way.pieces = pack(scene), scene.pieces
    way.before[:] = way.after[:] = [(0, 0, 0, 0, 0, 0, 1), (0.06, 0, 0, 0, 0, 0, 1)]
    way.after[0, 3:] = Rotation.from_rotvec([0, 0, 0.999 * np.pi]).as_quat()
    found, n = way.separations()
    assert found[0] > 0.02
    assert found[-1] > 0.02
    assert found.min() < -0.01
    motion, swing = pair_motion(way.scene, way.before, way.after, 0, 1)
    assert motion == swing > 0.3
    at_start = way.frames_at(np.array([0.0]))[0]
    assert not is_separated_on_path(way.scene, way.before, way.after, 0, 1, (found[-1], n), motion, at_start)
    assert not way.is_free()
    way.after[0, 3:] = Rotation.from_rotvec([0, 0, 0.2]).as_quat()
    assert way.is_free()


def test_no_point_moves_farther_against_the_other_piece_than_the_bound() -> None:
    rng = np.random.default_rng(4)
    for _ in range(40):
        way = Way(rng)
        motion, swing = pair_motion(way.scene, way.before, way.after, 0, 1)
        ends, directions, far = way.frames_at(np.array([0.0, 1.0])), rng.normal(size=(200, 3)), []
        for k in range(2):
            points = (
                way.pieces.centre[k] + way.pieces.reach[k] * directions / np.linalg.norm(directions, axis=1)[:, None]
            )
            at = [points @ frames[k, :9].reshape(3, 3).T + frames[k, 9:] for frames in ends]
            far.append(at[1] - at[0])
        worst = max(np.linalg.norm(far[0] - far[1][rng.permutation(200)], axis=1).max() for _ in range(5))
        assert worst <= motion + 1e-12
        angles = [
            (Rotation.from_quat(b) * Rotation.from_quat(a).inv()).magnitude()
            for a, b in zip(way.before[:, 3:], way.after[:, 3:], strict=True)
        ]
        assert [rotation_between(way.before, way.after, k) for k in range(2)] == pytest.approx(angles, abs=1e-9)
        assert swing == pytest.approx(float(angles @ way.pieces.reach), abs=1e-9)


def test_angles_of_rotations_are_those_of_the_arcsine_to_rounding() -> None:
    before = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
    for angle in np.concatenate([np.geomspace(1e-9, 0.2, 400), np.linspace(0.2, 3.1, 50)]):
        after = np.array([[0.0, 0.0, 0.0, 0.6 * np.sin(angle / 2), 0.0, 0.8 * np.sin(angle / 2), np.cos(angle / 2)]])
        expected = 4.0 * np.arcsin(0.5 * np.linalg.norm(after - before))
        assert rotation_between(before, after, 0) == pytest.approx(expected, rel=1e-15)
    assert rotation_between(before, before, 0) == 0.0
