"""Which pose of a log is that of a root."""

from __future__ import annotations

import pytest

from geomphys.recording.root_candidates import PoseCandidate, rank_root_poses


def candidate(name, messages=100):
    return PoseCandidate(name, messages, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))


@pytest.mark.parametrize(
    ("names", "root", "file", "first"),
    [
        (("/tracker/wrist_target", "/tracker/wrist", "/object/mug"), "forearm", "hand", "/tracker/wrist"),
        (("/tracker/left_hand", "/tracker/right_hand"), "right_palm", "leap", "/tracker/right_hand"),
        (("/tracker/left_hand", "/tracker/right_hand"), "palm", "glove_l", "/tracker/left_hand"),
        (("/tf#mug", "/tf#base_link", "/tf#hand"), "base_link", "robot", "/tf#base_link"),
        (("/tracker/head", "/tracker/right_controller"), "base_link", "allegro_right", "/tracker/right_controller"),
        (("/vicon/a7",), "pelvis", "body", "/vicon/a7"),
    ],
)
def test_the_root_is_the_pose_that_says_so(names, root, file, first):
    ranked = rank_root_poses([candidate(n) for n in names], root, [file], "/joints", 100)
    assert ranked[0][1].name == first


def test_a_pose_that_came_once_is_no_root_beside_one_that_moves():
    ranked = rank_root_poses([candidate("/hand/start", 1), candidate("/p")], "hand", [], "", 0)
    assert ranked[0][1].name == "/p"


def test_a_known_side_outweighs_every_name():
    names = ("/left_hand/palm", "/tracker/right")
    assert [
        rank_root_poses([candidate(n) for n in names], "palm", ["hand"], "", 0, s)[0][1].name for s in ("left", "right")
    ] == [*names]
