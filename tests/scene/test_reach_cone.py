"""Reach cones as a scene file gives them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.errors import SceneError
from geomphys.scene.reach_cone import reach_cone
from geomphys.scene.scene_file import ReachConeTable
from geomphys.scene.skeleton import Skeleton, load_skeleton
from tests.scene.models import joint, link, urdf

SQUARE = ((1.0, 1.0, 1.0), (-1.0, 1.0, 1.0), (-1.0, -1.0, 1.0), (1.0, -1.0, 1.0))
BENT = ((1.0, 1.0, 1.0), (0.0, 0.2, 1.0), (-1.0, 1.0, 1.0), (-1.0, -1.0, 1.0), (1.0, -1.0, 1.0))


@pytest.fixture
def shoulder(tmp_path: Path) -> Skeleton:
    return load_skeleton(
        urdf(
            tmp_path / "a.urdf",
            *(link(n) for n in ("torso", "x", "pad", "y", "z", "arm", "slide", "copy")),
            joint("sx", "torso", "x", xyz="0 0.2 0"),
            joint("pad", "x", "pad", "fixed", xyz="0 0 0"),
            joint("sy", "pad", "y", xyz="0 0 0"),
            joint("sz", "y", "z", "continuous", xyz="0 0 0"),
            joint("elbow", "z", "arm"),
            joint("slider", "torso", "slide", "prismatic", xyz="0 0 0"),
            joint("copy", "torso", "copy", inside='<mimic joint="sx"/>', xyz="0 0 0"),
        )
    )


def table(joints: tuple[str, ...], directions: tuple[tuple[float, float, float], ...] = SQUARE) -> ReachConeTable:
    return ReachConeTable(joints=joints, limb=(0.0, 0.0, 2.0), directions=directions)


@pytest.mark.parametrize("directions", [SQUARE, BENT, SQUARE[:3]], ids=["square", "bent", "triangle"])
def test_joints_become_links_and_directions_unit(shoulder: Skeleton, directions) -> None:
    cone = reach_cone(table(("sx", "sy", "sz"), directions), shoulder, "cone", Path("s.toml"))
    assert [shoulder.links[k].name for k in cone.links] == ["x", "y", "z"]
    assert cone.limb.tolist() == [0.0, 0.0, 1.0]
    np.testing.assert_allclose(np.linalg.norm(cone.directions, axis=1), 1.0, rtol=1e-15)


@pytest.mark.parametrize(
    ("joints", "directions", "says"),
    [
        (("sx", "knee"), SQUARE, "no joint 'knee'"),
        (("slider",), SQUARE, "joint 'slider' is no independent revolute joint"),
        (("copy",), SQUARE, "joint 'copy' is no independent revolute joint"),
        (("pad",), SQUARE, "joint 'pad' is no independent revolute joint"),
        (("sy", "sx"), SQUARE, "joint 'sx' is not below the joint before it"),
        (("sx", "sz"), SQUARE, "joint 'sz' is not below the joint before it"),
        (("sx", "sy", "sz", "elbow"), SQUARE, "joint 'elbow' sits 0.1 m off the first one"),
        (("sx",), (SQUARE[0], SQUARE[0], SQUARE[1]), "directions[0] equals the next one"),
        (("sx",), ((0, 0, 1), (0, 0, -1), (0, 1, 0)), "directions[0] is opposite to the next one"),
        (
            ("sx",),
            (SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]),
            "the sides after directions[0] and directions[2] cross",
        ),
    ],
)
def test_faults(shoulder: Skeleton, joints: tuple[str, ...], directions, says: str) -> None:
    with pytest.raises(SceneError) as caught:
        reach_cone(table(joints, directions), shoulder, "reach_cone[0] of avatar 'a'", Path("s.toml"))
    assert str(caught.value).startswith("s.toml: reach_cone[0] of avatar 'a': ")
    assert says in str(caught.value)
