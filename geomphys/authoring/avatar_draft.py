"""Chooses what an avatar of a drafted scene follows: topic, names and unit of its joints, pose of its root."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from geomphys.authoring.finger_joints import label_finger_joints
from geomphys.authoring.keypoint_draft import KeypointDraft
from geomphys.recording.angle_units import UnitGuess, guess_angle_unit, mirrored_joints
from geomphys.recording.inspect import TopicInfo
from geomphys.recording.joint_matching import JointMatch, match_joints
from geomphys.recording.name_words import common_side, side_of
from geomphys.recording.root_candidates import PoseCandidate, is_command_topic, rank_root_poses
from geomphys.scene.skeleton import Skeleton

MIN_ROOT_SCORE = -3.0
"""Least score of a root pose; below it the name says that it is something else."""


@dataclass(frozen=True)
class AvatarDraft:
    """The inputs of an avatar of a drafted scene, and how they were found."""

    name: str
    urdf: str  # path, as the scene file names it
    root_link: str
    tall: bool  # whether it is a body rather than a hand
    hull: bool  # whether a mesh is not closed, so that all collide as convex hulls
    hand: str  # left, right, or "" if unknown
    root: PoseCandidate | None
    root_choices: tuple[str, ...]  # the other poses, likeliest first
    joints_topic: str  # "" if none matches
    joint_choices: tuple[str, ...]  # other topics that match as well
    side: str  # of a glove topic that holds several; else ""
    unit: UnitGuess
    mirrored: tuple[str, ...]  # joints that would fit their limits with the opposite sign
    matches: tuple[JointMatch, ...]
    unmatched_recorded: tuple[str, ...]
    unmatched_joints: tuple[str, ...]
    guessed_topic: str  # topic with only similar joint names; "" if there is a better one or none
    two_sides: bool  # whether the topic has both hands and the side of the avatar is unknown
    chains: tuple[tuple[str, str, str], ...]  # name, base link, tip link
    keypoints: KeypointDraft | None = None  # points that it is fitted to, where no joint values are recorded

    @property
    def used(self) -> tuple[JointMatch, ...]:
        """Matches that the scene uses."""
        return tuple(m for m in self.matches if m.is_used)


@dataclass(frozen=True)
class JointTopic:
    """The best topic for the joints of a tree."""

    topic: TopicInfo
    side: str  # part to name after `#`: of a topic with several gloves
    matches: tuple[JointMatch, ...]
    others: tuple[str, ...]  # topics that match equally well


@dataclass(frozen=True)
class AnglesGuess:
    """The unit of a topic's angles, and the joints whose sign is the opposite."""

    unit: UnitGuess
    mirrored: tuple[str, ...] = ()


def hand_sides(skeletons: Sequence[Skeleton], log_names: Collection[str]) -> list[str]:
    """The side of each avatar, "" if unknown.

    The side is taken from the names of the URDF file, the robot, the links and the joints. Of two hands with one known
    side, the other has the opposite one; a single hand has the side of the poses of the log, if they have only one.

    Parameters
    ----------
    skeletons
    log_names
        Names of the log's poses and joint topics.
    """
    sides = []
    for skeleton in skeletons:
        names = [link.name for link in skeleton.links[1:]] + [j.name for j in skeleton.joints if j is not None]
        likely = [side_of(n) for n in (skeleton.path.stem, skeleton.name, skeleton.links[0].name)]
        sides.append(next((s for s in likely if s), common_side(names)))
    if len(sides) == 2 and sorted(sides)[0] == "" and sorted(sides)[1]:
        known = "".join(sides)
        sides = [s or ("left" if known == "right" else "right") for s in sides]
    if sides == [""]:
        sides = [common_side(log_names)]
    return sides


def find_joints(
    skeleton: Skeleton, topics: Sequence[TopicInfo], hand: str, taken: Collection[tuple[str, str]]
) -> JointTopic | None:
    """The topic with most of a tree's joints, the part to name, and the matches; None if no name is similar.

    Parameters
    ----------
    skeleton
    topics
        With joints, of names a scene file can hold.
    hand
        The tree's side, or "".
    taken
        Topics and parts that other avatars follow.
    """
    shape = label_finger_joints(skeleton)
    ranked: list[tuple[tuple[int, int, int, bool, bool, int], JointTopic]] = []
    for topic in topics:
        if topic.messages == 0:
            continue
        for side in topic.sides if len(topic.sides) > 1 else ("",):
            matches = match_joints(topic.joints, skeleton.dof_names, side=hand, shape=shape)
            if not matches:
                continue
            sides = {side_of(topic.topic) or common_side(topic.joints), *((side,) if side else topic.sides)} - {""}
            is_other_hand = bool(hand and sides and hand not in sides)
            used = sum(m.is_used for m in matches)
            is_free = (topic.topic, side) not in taken
            rank = (-is_other_hand, used, len(matches), not is_command_topic(topic.topic), is_free, topic.messages)
            ranked.append((rank, JointTopic(topic, side, matches, ())))
    if not ranked:
        return None
    rank, best = max(ranked, key=lambda item: item[0])
    others = [
        f"{j.topic.topic}#{j.side}" if j.side else j.topic.topic
        for r, j in ranked
        if r[:2] == rank[:2] and j is not best
    ]
    return JointTopic(best.topic, best.side, best.matches, tuple(o for o in others if not is_command_topic(o)))


def guess_angles(skeleton: Skeleton, topic: TopicInfo | None, matches: Sequence[JointMatch]) -> AnglesGuess:
    """The unit of a topic's angles, and the mirrored joints; revolute and continuous joints only."""
    if topic is None:
        return AnglesGuess(UnitGuess("rad", ""))
    revolute = {j.name for j in skeleton.joints if j is not None and j.type in ("revolute", "continuous")}
    column = {name: i for i, name in enumerate(skeleton.dof_names)}
    used = {m.joint: m.recorded for m in matches if m.joint in revolute and m.recorded in topic.ranges}
    ranges = {joint: topic.ranges[recorded] for joint, recorded in used.items()}
    limits = {j: (float(skeleton.lower[column[j]]), float(skeleton.upper[column[j]])) for j in used}
    guess = guess_angle_unit(ranges, limits)
    if topic.kind == "glove":
        guess = UnitGuess("deg", "gloves of this type send degrees")
    scale = math.pi / 180.0 if guess.unit == "deg" else 1.0
    rad = {j: (scale * low, scale * high) for j, (low, high) in ranges.items()}
    return AnglesGuess(guess, () if guess.doubt else mirrored_joints(rad, limits))


def find_root(
    skeleton: Skeleton, poses: Sequence[PoseCandidate], hand: str, joints: JointTopic | None
) -> tuple[PoseCandidate | None, tuple[str, ...]]:
    """The pose that the root follows, None if none is plausible; and the other poses, best first."""
    matched = joints if joints is not None and any(m.is_used for m in joints.matches) else None
    ranked = rank_root_poses(
        poses,
        skeleton.links[0].name,
        [skeleton.path.stem],
        matched.topic.topic if matched is not None else "",
        matched.topic.messages if matched is not None else 0,
        hand,
    )
    root = ranked[0][1] if ranked and ranked[0][0] > MIN_ROOT_SCORE else None
    return root, tuple(c.name for _, c in ranked if c is not root)


def is_of_either_hand(hand: str, names: Collection[str], joints: Collection[str]) -> bool:
    """Whether names are of both hands while neither `hand` nor the joints of the tree state a side."""
    sides = {side_of(n) for n in names} - {""}
    return not hand and len(sides) == 2 and not any(side_of(j) for j in joints)
