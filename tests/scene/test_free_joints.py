"""A floating or planar joint above a model's root is what the root's pose stands for; elsewhere it is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.errors import ModelError
from geomphys.scene.free_joints import JointEnds, links_above_free_joint
from geomphys.scene.skeleton import load_skeleton
from tests.scene.models import ball, joint, link, urdf

REST = (ball("palm"), ball("tip"), joint("j", "palm", "tip"))
VISUAL = '<link name="base"><visual><geometry><sphere radius="0.1"/></geometry></visual></link>'


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_the_link_below_is_the_root(tmp_path: Path, kind: str) -> None:
    free = load_skeleton(urdf(tmp_path / "a.urdf", link("base"), *REST, joint("free", "base", "palm", kind)))
    plain = load_skeleton(urdf(tmp_path / "b.urdf", *REST))
    assert [entry.name for entry in free.links] == ["palm", "tip"]
    assert free.dof_names == ("j",)
    assert free.joints[0] is None
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 2, 3] = [0.0, 1.0, 2.0]
    angles = np.array([[0.0], [0.3], [-0.7]])
    assert np.array_equal(free.forward(angles, poses), plain.forward(angles, poses))


def test_fixed_joints_may_lie_between(tmp_path: Path) -> None:
    above = (
        link("world"),
        link("base"),
        joint("f", "world", "base", "fixed"),
        joint("free", "base", "palm", "floating"),
    )
    assert [entry.name for entry in load_skeleton(urdf(tmp_path / "a.urdf", *above, *REST)).links] == ["palm", "tip"]


def test_a_visual_above_is_not_shown(tmp_path: Path) -> None:
    skeleton = load_skeleton(urdf(tmp_path / "a.urdf", VISUAL, *REST, joint("free", "base", "palm", "floating")))
    assert len(skeleton.not_shown) == 1
    assert "link 'base' stands above the free joint" in skeleton.not_shown[0]


@pytest.mark.parametrize(
    ("elements", "says"),
    [
        (
            (*REST, ball("cup"), joint("free", "tip", "cup", "floating")),
            "joint 'free' is floating, .*objects of their own",
        ),
        ((*REST, ball("cup"), joint("free", "tip", "cup", "planar")), "joint 'free' is planar, .*two prismatic joints"),
        (
            (
                link("base"),
                link("flag"),
                *REST,
                joint("f", "base", "flag", "fixed"),
                joint("free", "base", "palm", "floating"),
            ),
            "joint 'free' is floating",
        ),
        ((ball("base"), *REST, joint("free", "base", "palm", "floating")), "link 'base' has collision geometry"),
        (
            (
                link("base"),
                *REST,
                ball("cup"),
                joint("a", "base", "palm", "floating"),
                joint("b", "palm", "cup", "floating"),
            ),
            "joint 'b' is floating",
        ),
        ((*REST, ball("x"), joint("s", "tip", "x", "spherical")), "joint 's' has the type 'spherical'"),
    ],
)
def test_elsewhere_it_is_refused_on_one_line(tmp_path: Path, elements: tuple[str, ...], says: str) -> None:
    with pytest.raises(ModelError, match=says) as caught:
        load_skeleton(urdf(tmp_path / "a.urdf", *elements))
    assert "\n" not in str(caught.value)


def test_rings_and_two_roots_have_nothing_above() -> None:
    assert links_above_free_joint([JointEnds("floating", "a", "b"), JointEnds("fixed", "b", "a")]) == []
    assert links_above_free_joint([JointEnds("floating", "a", "b"), JointEnds("floating", "c", "d")]) == []
    assert links_above_free_joint([]) == []
