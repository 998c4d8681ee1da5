"""Boxes moved apart by (1) in closed form, and the interpolation to the last free state where that does not do."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.config import Config
from geomphys.driven.paper.chains import detect, update_tree
from geomphys.driven.paper.elimination import (
    HALVINGS,
    copy_driven,
    eliminate,
    interpolate_tree,
    overlaps_others,
    propose_translations,
    translate_trees,
)
from geomphys.driven.paper.state import PaperWorkspace, make_paper_workspace
from geomphys.engine.state import make_replay_data
from geomphys.jit.packed_records import pack
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box
from tests.simulated.scenes import Thing, floor, make_scene

GAP = 2e-6
HALF = 0.05
CUBE = Box((HALF, HALF, HALF))


class Posed:
    """A scene with the workspace of the published method at its poses, overlaps found."""

    def __init__(self, *things: Thing) -> None:
        made = make_scene(things)
        data = make_replay_data(made)
        self.w: PaperWorkspace = make_paper_workspace(made, data.workspace, Config(gap=GAP))
        self.scene, self.packed = pack(made), pack(self.w)
        for tree in range(len(things)):
            if made.trees.role[tree] == s.DRIVEN:
                update_tree(self.scene, self.packed, tree)
        copy_driven(self.scene, self.packed.iterate, self.packed.target)
        self.overlap = detect(self.scene, self.packed)

    def position(self, tree: int) -> np.ndarray:
        return np.asarray(self.w.iterate.roots[tree, :3])

    def put_free(self, tree: int, position: tuple[float, float, float]) -> None:
        """Note a last free state."""
        self.w.free.roots[tree] = (*position, 0, 0, 0, 1)
        self.w.has_free[tree] = 1


def driven(*at: float) -> Thing:
    return Thing(shape=CUBE, role=s.DRIVEN, at=at)


def fixed(*at: float) -> Thing:
    return Thing(shape=CUBE, role=s.FIXED, at=at)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_box_leaves_another_by_depth_and_clearance_the_shortest_way(axis: int, sign: float) -> None:
    depth, at = 0.01, np.array([0.003, 0.002, 0.001])
    at[axis] = sign * (2 * HALF - depth)
    posed = Posed(driven(*at), fixed(0, 0, 0))
    assert posed.overlap == pytest.approx(depth, abs=1e-12)
    done = eliminate(posed.scene, posed.packed, 0)
    assert (done.passes, done.interpolations, done.overlap) == (1, 0, 0.0)
    expected = at.copy()
    expected[axis] = sign * (2 * HALF + GAP)
    assert posed.position(0) == pytest.approx(expected, abs=1e-9)


def test_of_two_driven_boxes_each_takes_half_of_the_depth() -> None:
    posed = Posed(driven(-0.047, 0, 0), driven(0.047, 0, 0))
    eliminate(posed.scene, posed.packed, 0)
    assert posed.position(0)[0] == pytest.approx(-HALF - GAP, abs=1e-9)
    assert posed.position(1)[0] == pytest.approx(HALF + GAP, abs=1e-9)


def test_the_other_one_takes_all_if_it_is_not_driven() -> None:
    posed = Posed(driven(-0.047, 0, 0), Thing(shape=CUBE, at=(0.047, 0, 0)))
    eliminate(posed.scene, posed.packed, 0)
    assert posed.position(0)[0] == pytest.approx(0.047 - 2 * HALF - GAP, abs=1e-9)


def test_depths_of_pieces_are_weighted_by_themselves() -> None:
    """One object of two boxes: (d² x + e² z) / (d + e) and the clearance along that."""
    d, e = 0.004, 0.008
    corner = [(CUBE, (2 * HALF - d, 0.0, 0.0)), (CUBE, (0.0, 0.0, -2 * HALF + e))]
    posed = Posed(driven(0, 0, 0), Thing(shape=corner, role=s.FIXED))
    propose_translations(posed.scene, posed.packed)
    pd = np.array([-(d**2), 0.0, e**2]) / (d + e)
    assert posed.w.translation[0] == pytest.approx(pd + GAP * pd / np.linalg.norm(pd), abs=1e-9)
    assert posed.w.deepest[0] == pytest.approx(e, abs=1e-9)
    assert posed.w.cancelled[0] == 0


def test_a_tree_is_moved_by_its_deepest_pair_of_objects() -> None:
    posed = Posed(driven(0, 0, 0), fixed(0, 2 * HALF - 0.002, 0), fixed(-2 * HALF + 0.006, 0, 0))
    assert translate_trees(posed.scene, posed.packed)
    assert posed.position(0) == pytest.approx([0.006 + GAP, 0, 0], abs=1e-9)


def test_what_overlaps_nothing_is_not_moved() -> None:
    posed = Posed(driven(0, 0, 0.2), floor())
    assert not translate_trees(posed.scene, posed.packed)
    assert eliminate(posed.scene, posed.packed, 0) == (0, 0, 0.0)
    assert posed.position(0).tolist() == [0, 0, 0.2]


@pytest.mark.parametrize(("other", "cancels"), [(1.0, True), (0.9, True), (0.7, False)])
def test_opposite_normals_cancel_where_a_tenth_of_the_depth_is_left(other: float, cancels: bool) -> None:
    """Depths d and r d from both sides: |PD_g| = (1 - r) d, under d / 10 from r = 0.9 on (an r of 0.9 is a little beyond)."""
    d = 0.005
    sides = [(CUBE, (2 * HALF - d, 0.0, 0.0)), (CUBE, (-2 * HALF + other * d + 1e-6, 0.0, 0.0))]
    posed = Posed(driven(0, 0, 0), Thing(shape=sides, role=s.FIXED))
    propose_translations(posed.scene, posed.packed)
    assert posed.w.cancelled[0] == cancels
    assert (posed.w.translation[0] != 0.0).any() == (not cancels)


def test_only_objects_that_overlap_count_as_overlapping() -> None:
    posed = Posed(driven(0, 0, 0), fixed(0.09, 0, 0), driven(0.5, 0, 0))
    assert overlaps_others(posed.packed, 0)
    assert not overlaps_others(posed.packed, 2)


def test_interpolation_stops_at_the_surface() -> None:
    """From 0.2 m above a floor to a pose in it: at the fraction where the box stands on it, to 2^-14 of the path."""
    posed = Posed(driven(0.3, 0, HALF - 0.02), floor())
    posed.put_free(0, (0.0, 0.0, HALF + 0.2))
    assert interpolate_tree(posed.scene, posed.packed, 0)
    path = 0.22
    height = posed.position(0)[2] - HALF
    assert 0.0 <= height <= path / 2**HALVINGS
    assert posed.position(0)[0] == pytest.approx(0.3 * (0.2 - height) / path, abs=1e-9)
    assert detect(posed.scene, posed.packed) == 0.0


def test_without_a_free_state_there_is_none_to_go_back_to() -> None:
    posed = Posed(driven(0, 0, HALF - 0.02), floor())
    assert not interpolate_tree(posed.scene, posed.packed, 0)
    posed.put_free(0, (0.0, 0.0, HALF - 0.01))  # which has become occupied
    assert not interpolate_tree(posed.scene, posed.packed, 0)


def test_a_box_in_a_vice_goes_back_along_its_path() -> None:
    """No translation by (1) frees it: one interpolation, counted and marked, and no passes in vain."""
    jaws = [(Box((HALF, HALF, HALF)), (sign * (2 * HALF - 0.005), 0.0, 0.0)) for sign in (1.0, -1.0)]
    posed = Posed(driven(0, 0, 0), Thing(shape=jaws, role=s.FIXED))
    posed.put_free(0, (0.0, 0.0, 0.3))
    done = eliminate(posed.scene, posed.packed, 0)
    assert (done.passes, done.interpolations, done.overlap) == (1, 1, 0.0)
    assert posed.w.interpolated[0] == 1
    assert posed.position(0) == pytest.approx([0, 0, 2 * HALF], abs=0.3 / 2**HALVINGS)


def test_without_a_way_out_the_pass_with_the_least_overlap_counts() -> None:
    jaws = [(CUBE, (sign * (2 * HALF - depth), 0.0, 0.0)) for sign, depth in ((1.0, 0.008), (-1.0, 0.004))]
    posed = Posed(driven(0, 0, 0), Thing(shape=jaws, role=s.FIXED))
    before = posed.overlap
    done = eliminate(posed.scene, posed.packed, 0)
    assert done.interpolations == 1
    assert 0.0 < done.overlap <= before + 1e-12
    assert done.overlap == pytest.approx(detect(posed.scene, posed.packed), abs=1e-15)
