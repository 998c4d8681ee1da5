"""Which recorded joint is which joint of a URDF, by names."""

from __future__ import annotations

import itertools

import pytest

from geomphys.recording.joint_labels import JointLabel, label_joints
from geomphys.recording.joint_matching import match_joints
from geomphys.recording.name_words import common_side, side_of, words

GLOVE = ["ThumbMCPSpread", "ThumbMCPStretch", "IndexMCPStretch", "IndexPIPStretch", "PinkyMCPSpread", "PinkyDIPStretch"]
HAND = ["thumb_mcp_flex", "index_mcp_flex", "index_pip_flex", "little_mcp_abd", "little_dip_flex", "wrist_dev"]


def pairs(matches):
    return {m.recorded: (m.joint, m.how) for m in matches}


def test_names_are_the_same_words_in_any_spelling():
    assert words("IndexMCPStretch") == words("index_mcp_flex") == words("index-mcp.bend") == ["index", "mcp", "flex"]
    assert words("FFJ3") == ["index", "3"]
    assert [side_of(n) for n in ("rh_FFJ3", "/glove/left/joints", "upright", "left_to_right")] == [
        "right",
        "left",
        "",
        "",
    ]


def test_a_glove_finds_the_joints_of_a_hand():
    found = pairs(match_joints(GLOVE, HAND))
    assert found == {
        "ThumbMCPStretch": ("thumb_mcp_flex", "spelling"),
        "IndexMCPStretch": ("index_mcp_flex", "spelling"),
        "IndexPIPStretch": ("index_pip_flex", "spelling"),
        "PinkyMCPSpread": ("little_mcp_abd", "spelling"),
        "PinkyDIPStretch": ("little_dip_flex", "spelling"),
    }


def test_equal_names_go_first_and_every_name_is_used_once():
    found = match_joints(["b", "a", "joint_a", "A"], ["a", "b", "c"])
    assert [(m.recorded, m.joint, m.how) for m in found] == [("a", "a", "name"), ("b", "b", "name")]
    (either,) = match_joints(["A", "joint_a"], ["a"])
    assert either.how == "guess"


def test_a_side_that_all_names_share_tells_nothing_and_two_sides_tell_all():
    assert pairs(match_joints(["right_index_pip"], ["index_pip"])) == {"right_index_pip": ("index_pip", "spelling")}
    both = match_joints(["left_index_pip", "right_index_pip"], ["r_index_pip", "l_index_pip"])
    assert pairs(both) == {
        "left_index_pip": ("l_index_pip", "spelling"),
        "right_index_pip": ("r_index_pip", "spelling"),
    }
    assert match_joints(["left_index_pip"], ["right_index_pip"]) == ()


def test_what_is_only_alike_is_a_guess_and_numbers_are_never_mixed_up():
    (match,) = match_joints(["elbow_flexion_angle"], ["elbow"])
    assert match.how == "guess"
    assert match_joints(["joint_1", "joint_2"], ["joint_3", "joint_12"]) == ()


def by_joint(recorded, joints, **options):
    return {m.joint: m.recorded for m in match_joints(recorded, joints, **options) if m.is_used}


FINGERS = {
    "thumb": ("thumb", "th", "Thumb"),
    "index": ("index", "ff", "first", "pointer", "if"),
    "middle": ("middle", "mf"),
    "ring": ("ring", "rf"),
    "little": ("little", "lf", "pinky", "small"),
}
SEGMENTS = {
    "mcp_flex": ("mcp_flexion", "proximal", "mcp_fle", "knuckle"),
    "pip_flex": ("pip", "intermediate", "middle", "pip_bend"),
    "dip_flex": ("dip", "distal", "dip_fle"),
    "mcp_abd": ("spread", "abduction", "aa", "mcp_adduction"),
}
OURS = [f"{f}_{s}" for f in ("index", "middle", "ring", "little") for s in SEGMENTS]


@pytest.mark.parametrize("styles", [*itertools.product(range(2), range(4))], ids=str)
@pytest.mark.parametrize("prefix", ["", "right_", "R_", "rh_", "glove_r_"])
def test_fingers_and_segments_go_by_many_names(prefix, styles):
    finger, segment = styles

    def spelled(joint):
        f, s = joint.split("_", 1)
        names, parts = FINGERS[f], SEGMENTS[s]
        return f"{prefix}{names[finger % len(names)]}_{parts[segment % len(parts)]}"

    recorded = {spelled(j): j for j in OURS}
    assert {m.joint: m.recorded for m in match_joints(recorded, OURS, side="right")} == {
        j: r for r, j in recorded.items()
    }


def test_numbers_count_from_the_palm_or_as_shadow_counts_towards_it():
    hand = ["index_mcp_abd", "index_mcp_flex", "index_pip_flex", "index_dip_flex"]
    assert list(by_joint([f"index_j{k}" for k in (1, 2, 3, 4)], hand).values()) == [f"index_j{k}" for k in (1, 2, 3, 4)]
    assert list(by_joint([f"rh_FFJ{k}" for k in (1, 2, 3, 4)], hand).values()) == [f"rh_FFJ{k}" for k in (4, 3, 2, 1)]
    assert list(by_joint([f"FFJ{k}" for k in range(4)], hand).values()) == [f"FFJ{k}" for k in (3, 2, 1, 0)]


def test_numbers_alone_are_left_to_a_person():
    hand = [f"{f}_{s}" for f in ("index", "middle", "ring") for s in SEGMENTS]
    hand += ["thumb_cmc_abd", "thumb_cmc_flex", "thumb_mcp_flex", "thumb_ip_flex"]
    found = match_joints([f"joint_{k}" for k in range(16)], hand)
    assert not any(m.is_used for m in found)
    assert {m.joint: m.recorded for m in found}["middle_mcp_flex"] == "joint_5"


def test_what_all_names_of_one_side_have_is_a_prefix():
    found = by_joint([f"joint_{k}" for k in range(1, 8)], [f"panda_joint{k}" for k in range(1, 8)])
    assert found == {f"panda_joint{k}": f"joint_{k}" for k in range(1, 8)}
    assert not by_joint([f"left_leg_{k}" for k in range(3)], [f"left_arm_{k}" for k in range(3)])
    assert by_joint([f"joint_{k}" for k in range(4)], [f"joint_{k}.0" for k in range(4)]) == {
        f"joint_{k}.0": f"joint_{k}" for k in range(4)
    }


def test_three_segments_of_a_thumb_are_its_own_three():
    thumb = ["thumb_cmc_flex", "thumb_mcp_flex", "thumb_ip_flex"]
    assert list(by_joint(["ThumbMCPStretch", "ThumbPIPStretch", "ThumbDIPStretch"], thumb)) == thumb
    assert list(by_joint(["thumb_proximal", "thumb_intermediate", "thumb_distal"], thumb)) == thumb


def test_the_shape_of_a_hand_stands_in_for_names():
    shape = {
        "joint_a": JointLabel(
            finger="index", segment="pip", motion="flex", finger_confidence=0.8, segment_confidence=0.9
        )
    }
    assert by_joint(["IndexPIPStretch", "RingPIPStretch"], ["joint_a"], shape=shape) == {"joint_a": "IndexPIPStretch"}
    assert not by_joint(["RingPIPStretch"], ["joint_a"], shape=shape)


def test_of_two_hands_in_one_topic_each_urdf_gets_its_own_names():
    both = [f"{side}_{j}" for side in ("left", "right") for j in OURS]
    for side in ("left", "right"):
        assert by_joint(both, OURS, side=side) == {j: f"{side}_{j}" for j in OURS}
    assert not by_joint(both, OURS)  # nothing says which


def test_two_that_are_alike_in_the_same_way_are_left_to_a_person():
    found = match_joints(["index_mcp_1", "index_mcp_1b"], ["index_mcp_flex"])
    assert not any(m.is_used for m in found)
    assert not any(m.is_used for m in match_joints(["shoulder_x"], ["shoulder_y", "shoulder_z"]))


def test_middle_is_a_finger_or_a_segment():
    found = label_joints(["middle_middle", "index_middle", "middle_distal", "MiddleIndexAb"])
    assert [(m.finger, m.segment) for m in found.values()] == [
        ("middle", "pip"), ("index", "pip"), ("middle", "dip"), ("middle", ""),
    ]  # fmt: skip


def test_sides_are_read_in_every_spelling():
    left = [
        "left_hand",
        "LeftHand",
        "lefthand",
        "hand_l",
        "hand_L",
        "lh_palm",
        "l_index",
        "LIndex",
        "lindex",
        "lhand",
        "/tf#lwrist",
    ]
    assert {side_of(n) for n in left} == {"left"}
    assert {side_of(n.replace("left", "right").replace("Left", "Right")) for n in left[:3]} == {"right"}
    assert {side_of(n) for n in ("palm", "ring", "rear", "label", "roll", "lower", "upright", "lr", "world")} == {""}
    assert common_side(["l_a", "l_b", "c"]) == "left"
    assert common_side(["l_a", "r_a"]) == ""
