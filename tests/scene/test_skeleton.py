"""Trees of links: order, joints, mimic joints, neighbours; forward kinematics against yourdfpy."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from geomphys.errors import ModelError
from geomphys.scene.skeleton import Skeleton, load_skeleton
from tests.scene.models import ball, joint, link, urdf

MODELS = (
    "adroit/adroit_hand.urdf",
    "adroit/door.urdf",
    "allegro_right/allegro_hand_right.urdf",
    "cmu_body/cmu_subject_02.urdf",
    "human_hands/leap_grab_right.urdf",
)


def against_yourdfpy(path: Path, skeleton: Skeleton, frames: int = 4) -> float:
    """Largest difference in any entry of any link's matrix."""
    import yourdfpy

    oracle = yourdfpy.URDF.load(str(path), load_meshes=False, build_scene_graph=True)
    angles = np.random.default_rng(0).uniform(-2, 2, (frames, len(skeleton.dof_names)))
    poses, worst = skeleton.forward(angles), 0.0
    for k in range(frames):
        oracle.update_cfg({name: angles[k, i] for i, name in enumerate(skeleton.dof_names)})
        for i, entry in enumerate(skeleton.links):
            truth = oracle.get_transform(entry.name, skeleton.links[0].name)
            worst = max(worst, float(np.abs(truth - poses[k, i]).max()))
    return worst


@pytest.mark.parametrize("model", MODELS)
def test_forward_kinematics_of_real_models_is_yourdfpys(shared_dir: Path, model: str) -> None:
    path = shared_dir / "models" / model
    assert against_yourdfpy(path, load_skeleton(path)) < 1e-9


def test_forward_kinematics_of_every_joint_type(tmp_path: Path) -> None:
    path = urdf(
        tmp_path / "a.urdf",
        *(link(n) for n in "abcdef"),
        joint("ab", "a", "b", "revolute", '<axis xyz="0.6 0 0.8"/>'),
        joint("bc", "b", "c", "continuous", '<axis xyz="0 2 0"/>'),
        joint("cd", "c", "d", "prismatic", '<axis xyz="0 1 0"/>'),
        joint("de", "d", "e", "fixed"),
        joint("ef", "e", "f", "revolute", '<origin xyz="0.1 0.2 0.3" rpy="0.3 -0.5 1.2"/>'),
    )
    skeleton = load_skeleton(path)
    assert against_yourdfpy(path, skeleton) < 1e-12
    assert skeleton.dof_names == ("ab", "bc", "cd", "ef")
    assert skeleton.lower.tolist() == [-1.0, -math.inf, -1.0, -1.0]
    zero = skeleton.forward()
    assert zero.shape == (6, 4, 4)
    assert np.array_equal(zero, skeleton.forward({"cd": 0.0}))
    moved = skeleton.forward({"cd": np.array([0.0, 0.25])}, np.tile(np.eye(4), (2, 1, 1)))
    np.testing.assert_allclose(moved[1, 3, :3, 3] - moved[0, 3, :3, 3], [0.0, 0.25, 0.0], atol=1e-15)


def test_an_axis_that_is_not_given_is_x_and_a_long_one_is_shortened(tmp_path: Path) -> None:
    text = '<joint name="{0}" type="continuous"><parent link="{1}"/><child link="{2}"/>{3}</joint>'
    path = urdf(
        tmp_path / "a.urdf",
        *(link(n) for n in "abc"),
        text.format("ab", "a", "b", ""),
        text.format("bc", "b", "c", '<axis xyz="0 0 -3"/>'),
    )
    axes = [j.axis.tolist() for j in load_skeleton(path).joints[1:] if j is not None]
    assert axes == [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]


def test_limits_that_are_not_given_are_infinite(tmp_path: Path) -> None:
    inside = '<limit effort="1" velocity="1" lower="-2"/>'
    path = urdf(tmp_path / "a.urdf", link("a"), link("b"), joint("ab", "a", "b", "revolute", inside))
    skeleton = load_skeleton(path)
    assert (skeleton.lower[0], skeleton.upper[0]) == (-2.0, math.inf)


def test_links_come_breadth_first_in_the_order_of_the_file(tmp_path: Path) -> None:
    path = urdf(
        tmp_path / "a.urdf",
        *(link(n) for n in ("leaf", "mid2", "root", "mid1")),
        joint("j1", "mid2", "leaf"),
        joint("j2", "root", "mid2"),
        joint("j3", "root", "mid1"),
    )
    skeleton = load_skeleton(path)
    assert [entry.name for entry in skeleton.links] == ["root", "mid2", "mid1", "leaf"]
    assert skeleton.dof_names == ("j2", "j3", "j1")
    assert skeleton.parents == [-1, 0, 0, 1]


def test_mimic_joints_follow_their_master_by_way_of_others(tmp_path: Path) -> None:
    path = urdf(
        tmp_path / "a.urdf",
        *(link(n) for n in "abcd"),
        joint("third", "c", "d", inside='<mimic joint="second" multiplier="-3" offset="0.5"/>'),
        joint("second", "b", "c", inside='<mimic joint="first" multiplier="0.5" offset="0.1"/>'),
        joint("first", "a", "b", inside='<limit lower="-9" upper="9" effort="1" velocity="1"/>'),
    )
    skeleton = load_skeleton(path)
    assert skeleton.dof_names == ("first",)
    third = skeleton.joints[3]
    assert third is not None
    assert (third.dof, third.multiplier, third.mimics) == (0, -1.5, "second")
    assert third.offset == pytest.approx(0.5 - 3 * 0.1)
    # angle 0.8 of the master: second 0.5, third -1; a turn by the sum about z
    turned = skeleton.forward([0.8])[3, :3, :3]
    assert math.atan2(turned[1, 0], turned[0, 0]) == pytest.approx(0.8 + 0.5 - 1.0)
    # the limits ±1 of `third` bind the master: -1.5 q + 0.2 within ±1
    assert skeleton.lower[0] == pytest.approx(-0.8 / 1.5)
    assert skeleton.upper[0] == pytest.approx(1.2 / 1.5)


def test_limits_of_a_mimic_joint_that_leave_nothing_do_not_count(tmp_path: Path) -> None:
    path = urdf(
        tmp_path / "a.urdf",
        *(link(n) for n in "abc"),
        joint("one", "a", "b"),
        joint("two", "b", "c", inside='<mimic joint="one" multiplier="1" offset="5"/>'),
    )
    skeleton = load_skeleton(path)
    assert (skeleton.lower[0], skeleton.upper[0]) == (-1.0, 1.0)


def test_neighbours_skip_links_without_geometry(tmp_path: Path) -> None:
    path = urdf(
        tmp_path / "a.urdf",
        ball("palm"),
        link("knuckle"),
        ball("finger"),
        ball("tip"),
        ball("thumb"),
        joint("j1", "palm", "knuckle"),
        joint("j2", "knuckle", "finger"),
        joint("j3", "finger", "tip"),
        joint("j4", "knuckle", "thumb"),
    )
    skeleton = load_skeleton(path)
    named = {tuple(sorted((skeleton.links[a].name, skeleton.links[b].name))) for a, b in skeleton.neighbours()}
    assert named == {("finger", "palm"), ("finger", "thumb"), ("finger", "tip"), ("palm", "thumb")}


@pytest.mark.parametrize(
    ("elements", "says"),
    [
        ([link("a"), link("b")], "2 links hang on no joint (a, b)"),
        ([link("a"), link("b"), joint("ab", "a", "b"), joint("ba", "b", "a")], "form a ring"),
        (
            [*(link(n) for n in "abc"), joint("bc", "b", "c"), joint("cb", "c", "b")],
            "the joints of link 'b' form a ring that does not reach the root 'a'",
        ),
        ([link("a"), joint("aa", "a", "a")], "form a ring"),
        ([link("a"), joint("ab", "a", "b")], "joint 'ab' joins link 'b', which is not in the file"),
        (
            [*(link(n) for n in "abc"), joint("ac", "a", "c"), joint("bc", "b", "c")],
            "link 'c' hangs on two joints, 'ac' and 'bc'",
        ),
        ([link("a"), link("b"), joint("ab", "a", "b", inside='<mimic joint="ab"/>')], "joint 'ab' mimics itself"),
        ([link("a"), link("b"), joint("ab", "a", "b", inside='<mimic joint="x"/>')], "'ab' mimics 'x', which"),
        (
            [
                *(link(n) for n in "abc"),
                joint("ab", "a", "b", inside='<mimic joint="bc"/>'),
                joint("bc", "b", "c", inside='<mimic joint="ab"/>'),
            ],
            "mimics itself, by way of others",
        ),
        ([link("a"), link("b"), joint("ab", "a", "b", inside='<axis xyz="0 0 0"/>')], "the axis 0 0 0"),
        (
            [
                link("a"),
                link("b"),
                joint("ab", "a", "b", inside='<limit lower="1" upper="0" effort="1" velocity="1"/>'),
            ],
            "lower limit 1.0 above upper limit 0.0",
        ),
    ],
)
def test_what_is_no_tree_is_refused(tmp_path: Path, elements: list[str], says: str) -> None:
    path = urdf(tmp_path / "bad.urdf", *elements)
    with pytest.raises(ModelError) as caught:
        load_skeleton(path)
    assert says in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")


def test_a_long_row_of_links_is_no_trouble(tmp_path: Path) -> None:
    count = 2000
    path = urdf(
        tmp_path / "long.urdf",
        *(link(f"l{k}") for k in range(count)),
        *(joint(f"j{k}", f"l{k}", f"l{k + 1}", xyz="0 0 0.001") for k in range(count - 1)),
    )
    skeleton = load_skeleton(path)
    assert skeleton.forward()[-1, 2, 3] == pytest.approx(0.001 * (count - 1))


@pytest.mark.parametrize(
    ("kind", "shape", "moves"), [("revolute", True, True), ("fixed", True, False), ("revolute", False, False)]
)
def test_joints_that_move_what_collides(tmp_path: Path, kind: str, shape: bool, moves: bool) -> None:
    ball = '<geometry><sphere radius="0.1"/></geometry>'
    tip = link("tip", ball) if shape else link("tip")
    path = urdf(tmp_path / "a.urdf", link("palm", ball), tip, joint("j", "palm", "tip", kind=kind))
    assert load_skeleton(path).moves_collisions() is moves
