"""Extent of pieces along directions against the points of their surfaces."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.collision.extent import extent, gap_along
from geomphys.collision.support import Shapes, pose_pieces
from geomphys.jit.packed_records import pack
from geomphys.scene.pieces import Box, Capsule, Sphere
from tests.simulated.scenes import Thing, make_scene

AT, TURN = (0.3, -0.2, 0.1), (0.1, 0.4, -0.2, 0.8)


@pytest.mark.parametrize(
    ("shape", "local", "radius"),
    [
        (Sphere(0.05), [(0, 0, 0)], 0.05),
        (Capsule(0.02, 0.1), [(0, 0, 0.1), (0, 0, -0.1)], 0.02),
        (Box((0.1, 0.2, 0.3)), [(x, y, z) for x in (0.1, -0.1) for y in (0.2, -0.2) for z in (0.3, -0.3)], 0.0),
    ],
    ids=["ball", "capsule", "box"],
)
def test_no_point_of_a_piece_lies_beyond_and_one_reaches_it(shape: object, local: list, radius: float) -> None:
    rotation = Rotation.from_quat(TURN)
    scene = make_scene([Thing(shape=shape, at=AT, turn=rotation.as_quat()), Thing(shape=Sphere(0.05), at=(2, 0, 0))])
    frames = np.zeros((2, 12))
    packed, poses = pack(scene), scene.trees.rest.copy()
    pose_pieces(packed.pieces, poses, frames)
    shapes = Shapes(packed.pieces, frames)
    corners = np.array(AT) + rotation.apply(np.array(local, float))
    for n in Rotation.random(20, random_state=1).apply([0.0, 0.0, 1.0]):
        assert extent(shapes, 0, tuple(n)) == pytest.approx((corners @ n).max() + radius, abs=1e-12)
        gap = (corners @ n).min() - radius - (np.array([2.0, 0, 0]) @ n + 0.05)
        assert gap_along(shapes, 0, 1, tuple(n)) == pytest.approx(gap, abs=1e-12)
