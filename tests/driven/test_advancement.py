"""Ways of two pieces against many moments of them: what is called free passes through nothing, and free ways are found."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from geomphys.collision.detect import make_axes
from geomphys.collision.penetration import make_scratch, separation
from geomphys.driven.advancement import is_parted_before, pair_motion, passing_depth, path_is_free, rotation_between
from geomphys.jit.packed_records import pack
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Capsule, Hull
from tests.simulated.scenes import Thing, make_scene

MOMENTS = 300


class Way:
    """Two bodies of one piece each on straight, evenly turning ways; the first is off its body's origin."""

    def __init__(self, rng: np.random.Generator, fast: float = 1.0) -> None:
        shapes = [Box((0.06, 0.02, 0.04)), Capsule(0.02, 0.06), Hull(0.05 * rng.normal(size=(9, 3)))]
        a, b = (shapes[k] for k in rng.integers(0, 3, 2))
        scene = make_scene([Thing(shape=[(a, (0.02, 0.0, 0.03))], role=s.DRIVEN), Thing(shape=b, role=s.DRIVEN)])
        self.scene, self.before, self.after = pack(scene), np.zeros((2, 7)), np.zeros((2, 7))
        for poses, far in ((self.before, 0.0), (self.after, fast)):
            poses[:, :3] = (
                0.12 * rng.normal(size=(2, 3))
                if far == 0.0
                else self.before[:, :3] + far * 0.15 * rng.normal(size=(2, 3))
            )
            turn = Rotation.from_rotvec(far * 0.6 * rng.normal(size=(2, 3)))
            poses[:, 3:] = (
                Rotation.random(2, rng) if far == 0.0 else turn * Rotation.from_quat(self.before[:, 3:])
            ).as_quat()
        self.frames, self.scratch, self.axes = np.zeros((2, 12)), pack(make_scratch()), pack(make_axes(16))
        self.pieces = scene.pieces

    def frames_at(self, share: float) -> np.ndarray:
        """(2, 12) world frames of the pieces, the centre of each a share of its straight way."""
        frames = np.zeros((2, 12))
        for k in range(2):
            turns = Rotation.from_quat([self.before[k, 3:], self.after[k, 3:]])
            local, shift, centre = (
                self.pieces.local[k, :9].reshape(3, 3),
                self.pieces.local[k, 9:],
                self.pieces.centre[k],
            )
            ends = [
                r.apply(local @ centre + shift) + p[k, :3]
                for r, p in zip(turns, (self.before, self.after), strict=True)
            ]
            rotation = Slerp([0, 1], turns)(share).as_matrix() @ local
            frames[k, :9] = rotation.reshape(9)
            frames[k, 9:] = ends[0] + share * (ends[1] - ends[0]) - rotation @ centre
        return frames

    def least(self) -> tuple[float, float, float]:
        """Least separation at all moments, at the start and at the end [m]."""
        none = (0.0, 0.0, 0.0)
        found = [
            separation(self.scene.pieces, self.frames_at(k / MOMENTS), 0, 1, 1.0, none, self.scratch)[0]
            for k in range(MOMENTS + 1)
        ]
        return min(found), found[0], found[-1]

    def is_free(self) -> bool:
        """What the certificate says."""
        return bool(path_is_free(self.scene, self.before, self.after, 0, 1, self.frames, self.axes, self.scratch))


@pytest.mark.parametrize("seed", range(3))
def test_what_is_called_free_passes_through_nothing(seed: int) -> None:
    rng, passed, blocked = np.random.default_rng(seed), 0, 0
    for _ in range(50):
        way = Way(rng)
        least, start, end = way.least()
        deep = passing_depth(way.scene, 0, 1)
        if start < 0.0 or end < 0.0:
            continue
        if least < -1.6 * deep:
            assert not way.is_free()
            blocked += 1
        elif least > -0.4 * deep:
            passed += way.is_free()
            assert way.is_free() or least < 1e-3
    assert passed > 10
    assert blocked > 2


@pytest.mark.parametrize("seed", range(3))
def test_a_direction_that_parts_both_ends_parts_the_way(seed: int) -> None:
    rng, parted = np.random.default_rng(seed), 0
    for _ in range(60):
        way = Way(rng, fast=0.15)
        _, n, _, _ = separation(way.scene.pieces, way.frames_at(1.0), 0, 1, 1.0, (0.0, 0.0, 0.0), way.scratch)
        motion, _ = pair_motion(way.scene, way.before, way.after, 0, 1)
        least, _, end = way.least()
        if end > 0.0 and is_parted_before(way.scene, way.before, way.after, 0, 1, n, motion, way.frames):
            parted += 1
            assert least > -1.5 * passing_depth(way.scene, 0, 1)
    assert parted > 5


def test_no_point_moves_farther_against_the_other_piece_than_the_bound() -> None:
    rng = np.random.default_rng(4)
    for _ in range(40):
        way = Way(rng)
        motion, swing = pair_motion(way.scene, way.before, way.after, 0, 1)
        ends, directions, far = [way.frames_at(share) for share in (0.0, 1.0)], rng.normal(size=(200, 3)), []
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
