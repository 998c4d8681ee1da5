"""Boxes hold what they bound, and the sweep finds just the pairs brute force finds."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.collision.support import pose_pieces
from geomphys.collision.sweep import Boxes, make_boxes, near_trees, update_boxes
from geomphys.jit.packed_records import pack
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Capsule, Cylinder, Hull, Sphere
from tests.simulated.scenes import Thing, make_scene


def shape(rng: np.random.Generator, k: int) -> Box | Capsule | Cylinder | Hull | Sphere:
    size = rng.uniform(0.01, 0.1, 3)
    if k % 5 == 0:
        return Sphere(size[0])
    if k % 5 == 1:
        return Box(tuple(size))
    if k % 5 == 2:
        return Capsule(size[0], size[1])
    if k % 5 == 3 or k > 100:  # building a hull takes time
        return Cylinder(size[0], size[1])
    corners = rng.normal(size=(12, 3)) * size
    return Hull(corners - corners.mean(axis=0))


def made(seed: int, still: int, moving: int, spread: float) -> tuple[s.Scene, np.ndarray, Boxes]:
    """Scattered objects, a floor and a wall among them."""
    rng = np.random.default_rng(seed)
    things = [
        Thing(
            shape=shape(rng, k), role=s.DRIVEN if k < moving else s.FIXED, at=rng.uniform(-spread, spread, 3),
            turn=Rotation.random(rng=rng).as_quat(), moving=k < moving, mass=1.0,
        )
        for k in range(still + moving)
    ]  # fmt: skip
    things += [
        Thing(shape=Box((spread, spread, 0.05)), role=s.FIXED, at=(0, 0, -spread)),
        Thing(shape=Box((0.05, spread, spread)), role=s.FIXED, at=(spread, 0, 0)),
    ]
    scene = make_scene(things)
    frames = np.zeros((len(scene.pieces.kind), 12))
    pose_pieces(scene.pieces, scene.trees.rest, frames)
    return scene, frames, make_boxes(scene, frames)


def extent(scene: s.Scene, frames: np.ndarray, k: int) -> np.ndarray:
    """Low and high (2, 3) of a piece by its support function."""
    m, kind, size = frames[k, :9].reshape(3, 3), scene.pieces.kind[k], scene.pieces.size[k]
    reach = np.zeros(3)
    centre = frames[k, 9:]
    if kind == s.HULL:
        corners = scene.pieces.vertices[scene.pieces.vertex_start[k] : scene.pieces.vertex_start[k + 1]] @ m.T + centre
        return np.stack([corners.min(axis=0), corners.max(axis=0)])
    for axis in range(3):
        d = m[axis]  # world axis in the piece's frame
        if kind == s.SPHERE:
            reach[axis] = size[0]
        elif kind == s.CAPSULE:
            reach[axis] = size[0] + size[1] * abs(d[2])
        elif kind == s.CYLINDER:
            reach[axis] = size[0] * np.hypot(d[0], d[1]) + size[1] * abs(d[2])
        else:
            reach[axis] = size @ np.abs(d)
    return np.stack([centre - reach, centre + reach])


def test_boxes_hold_their_pieces_and_are_tight_for_primitives() -> None:
    scene, frames, boxes = made(1, 60, 10, 0.5)
    for k in range(len(scene.pieces.kind)):
        low, high = extent(scene, frames, k)
        assert (boxes.piece_low[k] <= low + 1e-12).all()
        assert (boxes.piece_high[k] >= high - 1e-12).all()
        if scene.pieces.kind[k] != s.HULL:
            assert boxes.piece_low[k] == pytest.approx(low, abs=1e-12)
            assert boxes.piece_high[k] == pytest.approx(high, abs=1e-12)


def by_brute_force(boxes: Boxes, tree: int, room: float) -> set[int]:
    low, high = boxes.tree_low, boxes.tree_high
    gaps = np.maximum(low - high[tree], low[tree] - high).max(axis=1)
    return {int(k) for k in np.flatnonzero(gaps <= room) if k != tree}


@pytest.mark.parametrize(("still", "moving", "spread"), [(30, 5, 0.3), (2000, 20, 2.0), (0, 6, 0.1), (1, 1, 0.05)])
def test_the_sweep_finds_what_brute_force_finds(still: int, moving: int, spread: float) -> None:
    scene, frames, boxes = made(7, still, moving, spread)
    packed, found = pack(boxes), np.zeros(len(scene.trees.role), np.int64)
    rng = np.random.default_rng(2)
    for _ in range(3):
        for tree in range(moving):
            frames[tree, 9:] += rng.uniform(-0.1, 0.1, 3)
            update_boxes(pack(scene), frames, packed, tree)
        for tree, room in product(range(moving), (0.0, 0.03)):
            count = near_trees(packed, tree, room, found)
            assert len(set(found[:count].tolist())) == count
            assert set(found[:count].tolist()) == by_brute_force(boxes, tree, room)


def test_a_wide_floor_does_not_lengthen_every_search() -> None:
    scene, _, boxes = made(3, 500, 4, 2.0)
    assert boxes.widest < 1.0
    assert {len(scene.trees.role) - 2} <= set(boxes.others.tolist())
    both = np.concatenate([boxes.sorted_still, boxes.others])
    assert sorted(both.tolist()) == list(range(len(scene.trees.role)))
    assert (np.diff(boxes.sorted_low) >= 0).all()
