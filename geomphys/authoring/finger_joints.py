"""Labels the joints of a hand by finger, segment and motion from its kinematic tree."""

from __future__ import annotations

from collections import Counter

import numpy as np

from geomphys.recording.joint_labels import JointLabel, label_joints, standard_order
from geomphys.recording.name_words import FINGERS
from geomphys.scene.skeleton import Floats, Skeleton

MAX_FINGER_JOINTS = 7
"""Maximum joints of a finger; a longer chain is an arm."""
SHAPE_CONFIDENCE = 0.8
"""Confidence of a finger that is identified by its position on the palm."""


def label_finger_joints(skeleton: Skeleton) -> dict[str, JointLabel]:
    """Joint name -> label of the joints of fingers, by their kinematic chains.

    A finger is a chain of moving joints from a link with several such chains to a tip. It is identified by names of its
    joints and links, else by position: the thumb is the one that points elsewhere, the others follow from there. Its last
    joints flex about one axis; a joint about another axis abducts.
    """
    poses = skeleton.forward()
    chains = _finger_chains(skeleton)
    fingers = [_finger_by_name(skeleton, chain) for chain in chains]
    confidence = 1.0
    if chains and not any(fingers) and len({_palm(skeleton, chain) for chain in chains}) == 1 and 3 <= len(chains) <= 5:
        fingers, confidence = _fingers_by_position(skeleton, chains, poses), SHAPE_CONFIDENCE
    found: dict[str, JointLabel] = {}
    for chain, finger in zip(chains, fingers, strict=True):
        if finger and fingers.count(finger) == 1:
            for link, segment, motion in _label_chain(skeleton, chain, finger, poses):
                joint = skeleton.joints[link]
                assert joint is not None
                found[joint.name] = JointLabel(
                    finger=finger,
                    segment=segment,
                    motion=motion,
                    finger_confidence=confidence,
                    segment_confidence=0.9,
                    motion_confidence=0.9,
                )
    return found


def _finger_chains(skeleton: Skeleton) -> list[list[int]]:
    """Child links of the moving joints of each finger, from the palm to the tip."""
    children = skeleton.children()
    is_moving = [j is not None and j.dof >= 0 and j.type != "prismatic" for j in skeleton.joints]
    tips_below = [0] * len(skeleton.links)  # tips with a moving joint above them, through or below a link
    for link in reversed(range(len(skeleton.links))):
        tips_below[link] = sum(tips_below[c] for c in children[link]) or int(is_moving[link])
    chains = []
    for link in range(len(skeleton.links)):
        parent = skeleton.parents[link]
        if parent < 0 or tips_below[link] != 1 or tips_below[parent] < 2:
            continue
        chain, link_below = [], link
        while True:
            if is_moving[link_below]:
                chain.append(link_below)
            moving_children = [c for c in children[link_below] if tips_below[c]]
            if not moving_children:
                break
            link_below = moving_children[0]
        if 1 <= len(chain) <= MAX_FINGER_JOINTS:
            chains.append(chain)
    return chains


def _palm(skeleton: Skeleton, chain: list[int]) -> int:
    """The link that a chain starts from, fixed joints skipped."""
    link = skeleton.parents[chain[0]]
    while link > 0 and (joint := skeleton.joints[link]) is not None and joint.dof < 0:
        link = joint.parent
    return link


def _finger_by_name(skeleton: Skeleton, chain: list[int]) -> str:
    """The finger named by most joints and links of a chain; "" if none is."""
    names = [skeleton.links[i].name for i in chain]
    names += [joint.name for i in chain if (joint := skeleton.joints[i]) is not None]
    name_counts = Counter(m.finger for m in label_joints(names).values() if m.finger in FINGERS)
    return name_counts.most_common(1)[0][0] if name_counts else ""


def _fingers_by_position(skeleton: Skeleton, chains: list[list[int]], poses: Floats) -> list[str]:
    """Fingers by position in the zero pose: the thumb points in another direction or is nearer to the wrist."""
    origin = poses[_palm(skeleton, chains[0]), :3, 3]
    bases = np.array([poses[chain[0], :3, 3] for chain in chains]) - origin
    tips = np.array([poses[_tip(skeleton, chain), :3, 3] for chain in chains]) - origin
    directions = tips - bases
    lengths = np.linalg.norm(directions, axis=1)
    if not (lengths > 1e-6).all():
        return [""] * len(chains)
    directions /= lengths[:, None]
    mean_direction = np.median(directions, axis=0)
    mean_direction /= max(float(np.linalg.norm(mean_direction)), 1e-9)
    reach = bases @ mean_direction
    reach_range = max(float(np.ptp(reach)), 1e-9)
    outlier_scores = (1.0 - directions @ mean_direction) + (np.median(reach) - reach) / reach_range
    ranked = np.argsort(-outlier_scores)
    if outlier_scores[ranked[0]] < outlier_scores[ranked[1]] + 0.2:
        return [""] * len(chains)  # no distinct thumb
    thumb = int(ranked[0])
    others = [i for i in range(len(chains)) if i != thumb]
    lateral_axis = int(np.ptp(bases[others], axis=0).argmax())
    thumb_position = (bases[thumb, lateral_axis] + tips[thumb, lateral_axis]) / 2
    others.sort(key=lambda i: float(bases[i, lateral_axis]))
    if abs(bases[others[-1], lateral_axis] - thumb_position) < abs(bases[others[0], lateral_axis] - thumb_position):
        others.reverse()
    names = [""] * len(chains)
    for finger, chain in zip(FINGERS, (thumb, *others), strict=False):
        names[chain] = finger
    return names


def _tip(skeleton: Skeleton, chain: list[int]) -> int:
    """The last link of a chain, fixed links included."""
    children, link_below = skeleton.children(), chain[-1]
    while children[link_below]:
        link_below = children[link_below][0]
    return link_below


def _label_chain(skeleton: Skeleton, chain: list[int], finger: str, poses: Floats) -> list[tuple[int, str, str]]:
    """Link, segment and motion of the joints of a chain: standard order for thumbs and five joints, else by their axes."""
    order = standard_order(finger, len(chain))
    if order and (len(chain) == 5 or (finger == "thumb" and len(chain) == 4)):
        return [(link, *part) for link, part in zip(chain, order, strict=True)]
    axes = []
    for link in chain:
        joint = skeleton.joints[link]
        assert joint is not None
        axes.append(poses[link, :3, :3] @ joint.axis)
    is_flexion = [abs(float(axis @ axes[-1])) > 0.7 for axis in axes]
    names = ("cmc", "mcp", "ip") if finger == "thumb" else ("mcp", "pip", "dip")
    name_counts = sum(is_flexion)
    if finger == "thumb" and name_counts == 2:
        names = ("mcp", "ip", "ip")
    proximal = max(0, name_counts - 3)
    parts, flexions = [], 0
    for link, flexes in zip(chain, is_flexion, strict=True):
        if flexes:
            segment = names[min(flexions - proximal, 2)] if flexions >= proximal else "cmc"
            flexions += 1
            parts.append((link, segment, "flex"))
        else:
            parts.append(
                (
                    link,
                    "cmc" if finger == "thumb" and not flexions else names[min(max(flexions - proximal, 0), 2)],
                    "abd",
                )
            )
    return parts
