"""Guesses about a log: names, units, roots."""

from __future__ import annotations

import math

import pytest

from geomphys.recording.matching import PoseCandidate, guess_unit, match_joints, rank_roots, side_of, words

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


@pytest.mark.parametrize("factor", [1.0, math.degrees(1.0)])
def test_radians_and_degrees_are_told_apart(factor):
    limits = {f"j{k}": (-0.3, 1.6) for k in range(8)}
    bent = dict.fromkeys(limits, (-0.1 * factor, 1.2 * factor))
    barely = dict.fromkeys(limits, (0.0, 0.1 * factor))  # up to 5.7 as degrees: no whole turn as radians
    for ranges in (bent, barely):
        guess = guess_unit(ranges, limits)
        assert guess.unit == ("rad" if factor == 1.0 else "deg")
        assert guess.reason


def test_joints_without_limits_are_radians_until_they_pass_a_turn():
    limits = {"spin": (-math.inf, math.inf)}
    assert guess_unit({"spin": (0.0, 6.2)}, limits).unit == "rad"
    assert guess_unit({"spin": (-6.4, 0.0)}, limits).unit == "deg"
    assert guess_unit({}, {}).unit == "rad"


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
    ranked = rank_roots([candidate(n) for n in names], root, [file], "/joints", 100)
    assert ranked[0][1].name == first


def test_a_pose_that_came_once_is_no_root_beside_one_that_moves():
    ranked = rank_roots([candidate("/hand/start", 1), candidate("/p")], "hand", [], "", 0)
    assert ranked[0][1].name == "/p"
