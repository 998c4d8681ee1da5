"""Into how many steps a frame is cut: no two pieces come nearer by more than is told, and what moves along with one is free."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.collision.detect import find_near, pair_separation
from geomphys.driven.places import place_at
from geomphys.driven.steps import _change, make_stir, measure_stir, steps_needed
from geomphys.jit.packed_records import pack
from geomphys.scene.kinematics import place_tree, pose_tree
from tests.driven.rig import Rig, rig
from tests.driven.test_chain_loop import chain, finger, rod
from tests.scene.models import joint, link

GAP = 2e-6
FAR = 1e3
ARM = '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/>'


@pytest.fixture(scope="module")
def hand(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """Two fingers side by side on an arm that turns, no chain of theirs; beside it a block that is tracked."""
    elements = (
        link("root"),
        rod("base", 0.2),
        joint("arm", "root", "base", inside=ARM),
        *finger("f"),
        *finger("g", at="0 0.03 0"),
    )
    block = '[[object]]\nname = "block"\nclass = "fixed"\ntopic = "/block"\nbox = [0.1, 0.04, 0.2]\nposition = [0.3, 0.1, 0.1]\n'
    return rig(
        tmp_path_factory.mktemp("hand"), elements, chain("f", "f2") + chain("g", "g2") + block + 'material = "wood"\n'
    )


class Step:
    """A step of the rig from one posture and place of the block to another."""

    def __init__(self, hand: Rig, angles: tuple[np.ndarray, np.ndarray], block: tuple[np.ndarray, np.ndarray]) -> None:
        self.hand, self.stir, p = hand, make_stir(hand.scene), hand.packs
        self.packed = pack(self.stir)
        self.before, self.after = (self._frames(a, b) for a, b in zip(angles, block, strict=True))
        for place in (p.places.base, p.places.frames):
            place[:] = self.after
        p.places.goal[:] = p.places.current[:] = 0.0
        measure_stir(p.scene, p.joints, self.before, *angles, p.places, self.packed)
        p.places.reach[:] = FAR
        find_near(p.scene, self.after, p.boxes, p.places.reach, FAR, np.inf, p.near, p.places.found, p.axes, p.scratch)

    def _frames(self, angles: np.ndarray, block: np.ndarray) -> np.ndarray:
        hand, frames, poses = self.hand, np.zeros_like(self.hand.places.base), np.zeros_like(self.hand.poses)
        roots = hand.roots.copy()
        roots[1] = block
        for tree in range(2):
            pose_tree(hand.packs.scene, hand.origins, tree, roots, angles, poses)
            place_tree(hand.packs.scene, tree, poses, frames)
        return frames

    def change(self, k: int) -> float:
        """What is told of the pair k. [m]"""
        p = self.hand.packs
        return float(_change(p.scene, p.joints, p.places, p.near, k, self.packed))

    def separation(self, k: int, frames: np.ndarray) -> float:
        """Of the pair k. [m]"""
        p = self.hand.packs
        return float(pair_separation(p.scene.pieces, frames, p.near.a[k], p.near.b[k], FAR, p.axes, p.scratch)[0])

    def steps(self) -> int:
        """How many are needed."""
        p = self.hand.packs
        return int(steps_needed(p.scene, p.joints, p.places, self.before, p.near, self.packed, GAP, p.axes, p.scratch))


def turned(rng: np.random.Generator, hand: Rig, size: float) -> np.ndarray:
    """A place of the block near where it rests."""
    place = hand.roots[1].copy()
    place[:3] += size * rng.uniform(-0.2, 0.2, 3)
    place[3:] = (Rotation.from_rotvec(size * rng.uniform(-1, 1, 3)) * Rotation.from_quat(place[3:])).as_quat()
    return place


@pytest.mark.parametrize("seed", range(6))
def test_no_pair_comes_nearer_or_parts_by_more_than_is_told(hand: Rig, seed: int) -> None:
    rng = np.random.default_rng(seed)
    size = [1.0, 0.1][seed % 2]
    start = rng.uniform(-1, 1, hand.dofs)
    end = start + size * rng.uniform(-0.5, 0.5, hand.dofs)
    step = Step(hand, (start, end), (turned(rng, hand, 1.0), turned(rng, hand, size)))
    places, near, pieces = hand.places, hand.near, hand.scene.pieces
    assert near.filled[0] > 10
    pull = size * rng.uniform(-0.1, 0.1, 3)
    places.goal[0] = pull
    for k in range(near.filled[0]):
        bends = any(hand.joints.bends[pieces.body[piece]] for piece in (near.a[k], near.b[k]))
        apart = step.separation(k, step.before)
        for share in (0.0, 0.4, 1.0) if bends else (0.0,):
            places.current[0] = share * pull
            frames = step.after.copy()
            place_at(hand.packs.scene, step.after, places.current, 0, frames)
            places.current[0] = 0.0
            assert abs(step.separation(k, frames) - apart) <= step.change(k) + 1e-12


def test_fingers_that_an_arm_takes_along_do_not_move_against_each_other(hand: Rig) -> None:
    """Two fingers 1 cm apart swing by 15 cm in a frame: one step does."""
    start = np.zeros(hand.dofs)
    end = start.copy()
    end[0] = 0.6
    away = hand.roots[1].copy()
    away[:3] = 5.0
    step = Step(hand, (start, end), (away, away))
    own = [k for k in range(hand.near.filled[0]) if hand.near.tree_a[k] == hand.near.tree_b[k]]
    fingers = [k for k in own if hand.joints.bends[hand.scene.pieces.body[hand.near.b[k]]]]
    assert len(fingers) > 5
    assert np.linalg.norm(step.stir.way, axis=1).max() > 0.14
    assert max(step.change(k) for k in fingers) <= 1e-12
    assert step.steps() == 1


def test_a_block_that_goes_along_with_a_finger_counts_as_little(hand: Rig) -> None:
    """Both turn about the arm's joint by 0.1 rad and go 2.5 cm and more; from each other they go 6 mm, and turn."""
    end = np.zeros(hand.dofs)
    end[0] = angle = 0.1
    place, turn = hand.roots[1].copy(), Rotation.from_euler("z", angle)
    place[:3] = [0.25, 0.09, 0.1]
    along = np.concatenate([turn.apply(place[:3]), turn.as_quat()])
    step = Step(hand, (np.zeros(hand.dofs), end), (place, along))
    tip = hand.scene.bodies.piece_start[hand.body("g2")]
    block = len(hand.scene.pieces.kind) - 1
    k = next(k for k in range(hand.near.filled[0]) if {hand.near.a[k], hand.near.b[k]} == {tip, block})
    assert np.linalg.norm(step.stir.way[[tip, block]], axis=1).min() > 0.024
    turns = angle * (hand.scene.pieces.reach[tip] + hand.scene.pieces.reach[block])
    assert step.change(k) == pytest.approx(2 * np.sin(angle / 2) * 0.06 + turns, rel=1e-3)
