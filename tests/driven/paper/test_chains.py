"""The order of the chains, the link that is moved first, its end effector and goal by (1) to (3), on boxes by closed forms."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from geomphys.config import Config
from geomphys.driven.paper.chains import (
    NOTHING,
    can_move,
    contacts_of,
    detect,
    draw_order,
    move_chains,
    next_random,
    step_chain,
    update_tree,
)
from geomphys.driven.paper.state import PaperWorkspace, make_paper_workspace
from geomphys.engine.state import make_replay_data
from geomphys.jit.packed_records import pack
from geomphys.load import load_world
from geomphys.scene.world import World
from tests.driven.compound import limit
from tests.scene.models import joint, link, urdf

GAP = 2e-6
LENGTH, HALF = 0.2, 0.02  # m: of a link along its own x, and half its thickness
BAR = f'<origin xyz="{LENGTH / 2} 0 0"/><geometry><box size="{0.9 * LENGTH} {2 * HALF} {2 * HALF}"/></geometry>'


def two_limbs(folder: Path, scene: str) -> World:
    """Two limbs of two bars each that point along x from a torso, 0.4 m from each other along y; joints about y."""
    joints = []
    for name, side in (("a", 0.2), ("b", -0.2)):
        joints.append(joint(f"{name}1", "torso", f"{name}_upper", xyz=f"0.1 {side} 0", inside=limit(-3, 3, "0 1 0")))
        joints.append(
            joint(f"{name}2", f"{name}_upper", f"{name}_lower", xyz=f"{LENGTH} 0 0", inside=limit(-3, 3, "0 1 0"))
        )
    bars = [link(f"{name}_{part}", BAR) for name in "ab" for part in ("upper", "lower")]
    urdf(folder / "body.urdf", link("torso"), *bars, *joints)
    avatar = '[[avatar]]\nname="body"\nurdf="body.urdf"\nmode="chains"\nmaterial="human"\n'
    avatar += "".join(f'[[avatar.chain]]\nname="{n}"\nbase="torso"\ntip="{n}_lower"\n' for n in "ab")
    (folder / "scene.toml").write_text(avatar + scene)
    return load_world(folder / "scene.toml")


def block(name: str, size: str, at: str) -> str:
    return f'[[object]]\nname="{name}"\nclass="fixed"\nbox=[{size}]\nposition=[{at}]\nmaterial="wood"\n'


class Posed:
    """A world with the workspace of the published method at an iterate, its near pairs found."""

    def __init__(self, world: World, angles: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0), seed: int = 0) -> None:
        self.world = world
        data = make_replay_data(world.scene)
        self.w: PaperWorkspace = make_paper_workspace(world.scene, data.workspace, Config(seed=seed, gap=GAP))
        self.w.iterate.angles[:], self.w.lower[:], self.w.upper[:] = angles, -3.0, 3.0
        self.scene, self.packed = pack(world.scene), pack(self.w)
        update_tree(self.scene, self.packed, 0)
        self.overlap = detect(self.scene, self.packed)

    def body(self, name: str) -> int:
        return self.world.body_names.index(name)


def splitmix64(state: int) -> int:
    """The reference of Steele, Lea and Flood: one step of the generator from `state` k, its gamma times k + 1."""
    mask = 2**64 - 1
    z = (state * 0x9E3779B97F4A7C15 + 0x9E3779B97F4A7C15) & mask
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & mask
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
    return z ^ (z >> 31)


def test_random_numbers_are_those_of_splitmix64() -> None:
    assert splitmix64(0) == 0xE220A8397B1DCDAF  # the first number of seed 0, as published
    for state in (0, 1, 2, 12345, 2**62 + 7):
        assert next_random(state) == splitmix64(state) >> 1


def test_an_order_is_a_permutation_drawn_by_seed_and_frame_alone(tmp_path: Path) -> None:
    posed = Posed(two_limbs(tmp_path, ""))
    drawn = []
    for seed in (0, 5):
        w = posed.w._replace(seed=seed, order=np.arange(6), rank=np.zeros(6, np.int64))
        for number in (0, 1, 2, 1):
            w.order[:] = w.order[::-1].copy()  # what is there does not count
            draw_order(pack(w), number)
            assert sorted(w.order) == list(range(6))
            assert np.array_equal(w.order[w.rank], np.arange(6))
            drawn.append(tuple(map(int, w.order)))
    assert drawn[1] == drawn[3]
    assert len(set(drawn)) == 6


def test_every_order_is_as_likely(tmp_path: Path) -> None:
    """1200 frames, six orders of three chains: within five standard deviations of 200 each."""
    w = Posed(two_limbs(tmp_path, "")).w._replace(order=np.arange(3), rank=np.zeros(3, np.int64))
    packed, counts = pack(w), Counter[tuple[int, ...]]()
    for number in range(1200):
        draw_order(packed, number)
        counts[tuple(map(int, w.order))] += 1
    assert len(counts) == 6
    assert max(abs(count - 200) for count in counts.values()) < 5 * np.sqrt(1200 * (1 / 6) * (5 / 6))


def test_links_of_chains_are_counted_from_the_root(tmp_path: Path) -> None:
    posed = Posed(two_limbs(tmp_path, ""))
    depth = {name: int(posed.w.limbs.depth[posed.body(f"body/{name}")]) for name in ("a_upper", "a_lower", "torso")}
    assert depth == {"a_upper": 1, "a_lower": 2, "torso": 0}
    chains = [
        int(posed.w.limbs.chain[posed.body(f"body/{name}")]) for name in ("torso", "a_lower", "b_upper", "b_lower")
    ]
    assert chains[0] == -1
    assert chains[1] != chains[2] == chains[3]


def test_a_link_is_moved_only_by_joints_that_do_not_move_what_it_is_in(tmp_path: Path) -> None:
    posed = Posed(two_limbs(tmp_path, block("box", "0.1,0.1,0.1", "0,0,5")))
    lower, upper, torso, box, other = map(
        posed.body, ("body/a_lower", "body/a_upper", "body/torso", "box", "body/b_lower")
    )
    for body, obstacle, moves in (
        (lower, box, True), (lower, other, True), (lower, upper, True), (lower, torso, True),
        (upper, lower, False), (torso, box, False), (box, lower, False),
    ):  # fmt: skip
        assert can_move(posed.scene, posed.packed, body, obstacle) == moves, (body, obstacle)


DEPTH = 3e-3
TOP = -HALF + DEPTH  # m: height of a surface that a limb along x is in by DEPTH


def test_end_effector_and_depth_of_a_bar_on_a_table(tmp_path: Path) -> None:
    """(2): the mean of the corners of the face that they share; (1): the depth and the clearance, straight up."""
    posed = Posed(two_limbs(tmp_path, block("table", "0.1,1,0.2", f"0.45,0,{TOP - 0.1}")))
    lower = posed.body("body/a_lower")
    ee, pd, extent = contacts_of(posed.scene, posed.packed, lower, 0)
    edge, end = 0.4, 0.1 + 1.95 * LENGTH  # of the table, and of the bar
    assert ee[:2] == pytest.approx([0.5 * (edge + end), 0.2], abs=1e-9)
    assert ee[2] == pytest.approx(-HALF, abs=1e-9)  # on the link
    assert pd == pytest.approx([0.0, 0.0, DEPTH + GAP], abs=1e-12)
    assert extent == pytest.approx(end - edge, abs=1e-9)


def test_depths_of_several_obstacles_are_weighted_by_themselves(tmp_path: Path) -> None:
    """A table and a wall, in different depths: (d² z + e² y) / (d + e)."""
    deeper = 2.0 * DEPTH
    wall = block("wall", "0.05,0.1,0.01", f"0.45,{0.2 + HALF - deeper + 0.05},0")
    posed = Posed(two_limbs(tmp_path, block("table", "0.1,0.4,0.2", f"0.45,0.2,{TOP - 0.1}") + wall))
    _, pd, _ = contacts_of(posed.scene, posed.packed, posed.body("body/a_lower"), 0)
    d, e = DEPTH + GAP, deeper + GAP
    assert pd == pytest.approx([0.0, -(e**2) / (d + e), d**2 / (d + e)], abs=1e-9)


def test_where_normals_cancel_the_deepest_pair_counts(tmp_path: Path) -> None:
    slabs = block("lower", "0.1,0.4,0.2", f"0.45,0.2,{TOP - 0.1}")
    slabs += block("upper", "0.1,0.4,0.2", f"0.45,0.2,{-TOP + 1e-5 + 0.1}")
    posed = Posed(two_limbs(tmp_path, slabs))
    _, pd, _ = contacts_of(posed.scene, posed.packed, posed.body("body/a_lower"), 0)
    assert pd == pytest.approx([0.0, 0.0, DEPTH + GAP], abs=1e-12)


def crossed(folder: Path) -> Posed:
    """The limbs have come together: one lower bar lies on the other, DEPTH deep."""
    world = two_limbs(folder, "")
    side = 0.2 - HALF + 0.5 * DEPTH
    for body, sign in ((world.body_names.index("body/a_upper"), -1.0), (world.body_names.index("body/b_upper"), 1.0)):
        world.scene.bodies.origin[body, 10] += sign * side
    return Posed(world)


def test_of_two_links_that_can_move_the_first_takes_half(tmp_path: Path) -> None:
    posed = crossed(tmp_path)
    a, b = posed.body("body/a_lower"), posed.body("body/b_lower")
    chains = [int(posed.w.limbs.chain[k]) for k in (a, b)]
    posed.w.rank[chains[0]], posed.w.rank[chains[1]] = 0, 1
    assert contacts_of(posed.scene, posed.packed, a, 0)[1] == pytest.approx([0.0, 0.5 * (DEPTH + GAP), 0.0], abs=1e-9)
    assert contacts_of(posed.scene, posed.packed, b, 0)[1] == pytest.approx([0.0, -DEPTH - GAP, 0.0], abs=1e-9)
    assert contacts_of(posed.scene, posed.packed, a, 2)[1] == pytest.approx([0.0, DEPTH + GAP, 0.0], abs=1e-9)


def test_the_link_nearest_the_root_is_moved_first(tmp_path: Path) -> None:
    """Both bars of one limb are in the table: the shoulder moves, the elbow waits; the other limb is left alone."""
    posed = Posed(two_limbs(tmp_path, block("table", "1,0.1,0.2", f"0.3,0.2,{TOP - 0.1}")))
    chain = int(posed.w.limbs.chain[posed.body("body/a_upper")])
    other = int(posed.w.limbs.chain[posed.body("body/b_upper")])
    assert step_chain(posed.scene, posed.packed, other, 0) == NOTHING
    assert step_chain(posed.scene, posed.packed, chain, 0) != NOTHING
    names = list(posed.world.dof_names)
    moved = {names[k].split("/")[-1] for k in np.flatnonzero(posed.w.iterate.angles)}
    assert moved == {"a1"}


def test_passes_over_the_chains_free_a_limb(tmp_path: Path) -> None:
    posed = Posed(two_limbs(tmp_path, block("table", "0.1,1,0.2", f"0.45,0,{TOP - 0.1}")))
    assert posed.overlap == pytest.approx(2 * DEPTH, abs=1e-9)
    draw_order(posed.packed, 0)
    left = [move_chains(posed.scene, posed.packed, count) for count in range(4)]
    assert left[-1] == 0.0
    assert max(left) < posed.overlap
    assert detect(posed.scene, posed.packed) == 0.0
