"""What the tree of a hand says of its joints where their names do not: which finger, which segment, which motion."""

from __future__ import annotations

from collections import Counter

import numpy as np

from geomphys.recording.joint_labels import JointLabel, label_joints, standard_order
from geomphys.recording.name_words import FINGERS
from geomphys.scene.skeleton import Floats, Skeleton

MAX_FINGER_JOINTS = 7
"""Joints of a finger; a longer row of joints is an arm."""
SHAPE_CONFIDENCE = 0.8
"""How sure a finger is that is known by where it stands on the palm."""


def label_finger_joints(skeleton: Skeleton) -> dict[str, JointLabel]:
    """What the joints of fingers are, by the chains of links they are in; other joints are not in it.

    A finger is a row of moving joints from a link with several such rows to a tip. It is told by names of its joints and
    links, else by where it stands: the thumb is the one that points elsewhere, the others follow from there. Its last
    joints bend about one axis; what turns about another spreads.
    """
    poses = skeleton.forward()
    rows = _rows(skeleton)
    fingers = [_named(skeleton, row) for row in rows]
    sure = 1.0
    if rows and not any(fingers) and len({_palm(skeleton, row) for row in rows}) == 1 and 3 <= len(rows) <= 5:
        fingers, sure = _placed(skeleton, rows, poses), SHAPE_CONFIDENCE
    found: dict[str, JointLabel] = {}
    for row, finger in zip(rows, fingers, strict=True):
        if finger and fingers.count(finger) == 1:
            for link, segment, motion in _parts(skeleton, row, finger, poses):
                joint = skeleton.joints[link]
                assert joint is not None
                found[joint.name] = JointLabel(
                    finger=finger,
                    segment=segment,
                    motion=motion,
                    finger_confidence=sure,
                    segment_confidence=0.9,
                    motion_confidence=0.9,
                )
    return found


def _rows(skeleton: Skeleton) -> list[list[int]]:
    """Links below moving joints of each finger, from the palm to the tip."""
    children = skeleton.children()
    moves = [j is not None and j.dof >= 0 and j.type != "prismatic" for j in skeleton.joints]
    below = [0] * len(skeleton.links)  # tips with a moving joint above them, through or below a link
    for link in reversed(range(len(skeleton.links))):
        below[link] = sum(below[c] for c in children[link]) or int(moves[link])
    rows = []
    for link in range(len(skeleton.links)):
        parent = skeleton.parents[link]
        if parent < 0 or below[link] != 1 or below[parent] < 2:
            continue
        row, here = [], link
        while True:
            if moves[here]:
                row.append(here)
            onward = [c for c in children[here] if below[c]]
            if not onward:
                break
            here = onward[0]
        if 1 <= len(row) <= MAX_FINGER_JOINTS:
            rows.append(row)
    return rows


def _palm(skeleton: Skeleton, row: list[int]) -> int:
    """The link that a row of joints stands on, fixed joints not counting."""
    link = skeleton.parents[row[0]]
    while link > 0 and (joint := skeleton.joints[link]) is not None and joint.dof < 0:
        link = joint.parent
    return link


def _named(skeleton: Skeleton, row: list[int]) -> str:
    """The finger that most names of a row say; "" if none does."""
    names = [skeleton.links[i].name for i in row]
    names += [joint.name for i in row if (joint := skeleton.joints[i]) is not None]
    count = Counter(m.finger for m in label_joints(names).values() if m.finger in FINGERS)
    return count.most_common(1)[0][0] if count else ""


def _placed(skeleton: Skeleton, rows: list[list[int]], poses: Floats) -> list[str]:
    """Fingers by where they stand in the zero pose: the thumb points elsewhere or stands nearer to the wrist."""
    origin = poses[_palm(skeleton, rows[0]), :3, 3]
    bases = np.array([poses[row[0], :3, 3] for row in rows]) - origin
    tips = np.array([poses[_tip(skeleton, row), :3, 3] for row in rows]) - origin
    directions = tips - bases
    lengths = np.linalg.norm(directions, axis=1)
    if not (lengths > 1e-6).all():
        return [""] * len(rows)
    directions /= lengths[:, None]
    along = np.median(directions, axis=0)
    along /= max(float(np.linalg.norm(along)), 1e-9)
    reach = bases @ along
    spread = max(float(np.ptp(reach)), 1e-9)
    oddness = (1.0 - directions @ along) + (np.median(reach) - reach) / spread
    ranked = np.argsort(-oddness)
    if oddness[ranked[0]] < oddness[ranked[1]] + 0.2:
        return [""] * len(rows)  # no thumb that stands out
    thumb = int(ranked[0])
    others = [i for i in range(len(rows)) if i != thumb]
    across = int(np.ptp(bases[others], axis=0).argmax())
    middle = (bases[thumb, across] + tips[thumb, across]) / 2
    others.sort(key=lambda i: float(bases[i, across]))
    if abs(bases[others[-1], across] - middle) < abs(bases[others[0], across] - middle):
        others.reverse()
    names = [""] * len(rows)
    for finger, row in zip(FINGERS, (thumb, *others), strict=False):
        names[row] = finger
    return names


def _tip(skeleton: Skeleton, row: list[int]) -> int:
    """The last link of a row, fixed ones beyond its last joint counting."""
    children, here = skeleton.children(), row[-1]
    while children[here]:
        here = children[here][0]
    return here


def _parts(skeleton: Skeleton, row: list[int], finger: str, poses: Floats) -> list[tuple[int, str, str]]:
    """Link, segment and motion of the joints of a row: of a thumb, and of many joints, by what is usual, else by their axes."""
    order = standard_order(finger, len(row))
    if order and (len(row) == 5 or (finger == "thumb" and len(row) == 4)):
        return [(link, *part) for link, part in zip(row, order, strict=True)]
    axes = []
    for link in row:
        joint = skeleton.joints[link]
        assert joint is not None
        axes.append(poses[link, :3, :3] @ joint.axis)
    bends = [abs(float(axis @ axes[-1])) > 0.7 for axis in axes]
    names = ("cmc", "mcp", "ip") if finger == "thumb" else ("mcp", "pip", "dip")
    count = sum(bends)
    if finger == "thumb" and count == 2:
        names = ("mcp", "ip", "ip")
    extra = max(0, count - 3)
    parts, bent = [], 0
    for link, bend in zip(row, bends, strict=True):
        if bend:
            segment = names[min(bent - extra, 2)] if bent >= extra else "cmc"
            bent += 1
            parts.append((link, segment, "flex"))
        else:
            parts.append(
                (link, "cmc" if finger == "thumb" and not bent else names[min(max(bent - extra, 0), 2)], "abd")
            )
    return parts
