"""Parses joint names into side, finger, segment and motion.

Segments are named by the joint at their proximal end: ``cmc``, ``mcp``, ``pip``, ``dip``; of a thumb ``cmc``, ``mcp``, ``ip``.
Numbers are read by their order within a finger. Each part has a confidence from 0 to 1: 1 where the name states it, less
where it follows from numbers or from the shape of the hand.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from geomphys.recording.name_words import FINGERS, words_of_all

WRIST = "wrist"
"""Labelled as a finger without segments."""

_NO_MEANING = {"joint", "joints", "j", "jnt", "angle", "pos", "position", "state", "states", "the", "finger", "hand", "human",
               "glove", "q"}  # fmt: skip
_SEGMENTS = ("cmc", "mcp", "pip", "dip", "ip")
_MOTIONS = ("flex", "abd", "rot")
_COUNTS_DOWN = re.compile(r"(?:^|[^a-z])(?:ff|mf|rf|lf|th|wr)_?j_?\d", re.IGNORECASE)
"""Names in the style of the Shadow hand, FFJ4 to FFJ1: the largest number is nearest to the palm."""

_FINGER_ORDER: dict[int, tuple[float, list[tuple[str, str]]]] = {
    1: (0.7, [("mcp", "flex")]),
    2: (0.8, [("mcp", "flex"), ("pip", "flex")]),
    3: (0.8, [("mcp", "flex"), ("pip", "flex"), ("dip", "flex")]),
    4: (0.9, [("mcp", "abd"), ("mcp", "flex"), ("pip", "flex"), ("dip", "flex")]),
    5: (0.8, [("cmc", "flex"), ("mcp", "abd"), ("mcp", "flex"), ("pip", "flex"), ("dip", "flex")]),
}
_THUMB_ORDER: dict[int, tuple[float, list[tuple[str, str]]]] = {
    1: (0.6, [("mcp", "flex")]),
    2: (0.7, [("mcp", "flex"), ("ip", "flex")]),
    3: (0.7, [("cmc", "flex"), ("mcp", "flex"), ("ip", "flex")]),
    4: (0.8, [("cmc", "abd"), ("cmc", "flex"), ("mcp", "flex"), ("ip", "flex")]),
    5: (0.8, [("cmc", "rot"), ("cmc", "flex"), ("mcp", "abd"), ("mcp", "flex"), ("ip", "flex")]),
}
_WRIST_ORDER: dict[int, tuple[float, list[tuple[str, str]]]] = {2: (0.8, [("", "abd"), ("", "flex")])}
"""Number of joints of a finger that are named by numbers alone -> confidence, and their labels from the palm on."""
_NUMBERED_HANDS: dict[int, tuple[str, ...]] = {16: ("index", "middle", "ring", "thumb"), 20: FINGERS}
"""Joints of a hand that have numbers only, four a finger -> the fingers in the order that is usual."""


class JointLabel(NamedTuple):
    """What a joint is."""

    side: str = ""
    finger: str = ""  # one of FINGERS, "wrist", or ""
    segment: str = ""
    motion: str = ""
    number: str = ""
    other_words: frozenset[str] = frozenset()  # other words
    finger_confidence: float = 1.0
    segment_confidence: float = 1.0
    motion_confidence: float = 1.0


def label_joints(names: Iterable[str], shape: Mapping[str, JointLabel] | None = None) -> dict[str, JointLabel]:
    """What the names of one log or URDF mean, each seen beside the others.

    Parameters
    ----------
    names
    shape
        Joint -> what the tree of links says it is; fills in what its name does not say.
    """
    join_names = list(names)
    words_by_name = words_of_all(join_names)
    if len(join_names) > 2:
        common = set.intersection(*(set(w) for w in words_by_name.values())) - {*FINGERS, *_SEGMENTS, *_MOTIONS, WRIST}
        common -= {"left", "right", *(w for w in common if w.isdigit())}
        words_by_name = {n: [w for w in found if w not in common] for n, found in words_by_name.items()}
    labels = {n: _label_of_words(found) for n, found in words_by_name.items()}
    for name, hint in (shape or {}).items():
        if name in labels:
            labels[name] = _with_hint(labels[name], hint)
    _label_numbered_hand(labels)
    for members in _by_finger(labels).values():
        _label_by_order(labels, members)
        _thumb_segments(labels, members)
        _infer_motions(labels, members)
    return labels


def standard_order(finger: str, count: int) -> list[tuple[str, str]]:
    """Segment and motion of the `count` joints of a finger from the palm on, as most hands have them; [] if unusual."""
    orders = _THUMB_ORDER if finger == "thumb" else _FINGER_ORDER
    return orders.get(count, (0.0, []))[1]


def _label_of_words(found: list[str]) -> JointLabel:
    """Label of a name by its words. ``middle`` is a finger unless a finger is named before it: then it is a segment."""
    side = [w for w in found if w in ("left", "right")]
    fingers = [w for w in found if w in FINGERS]
    segments = [w for w in found if w in _SEGMENTS]
    motions = [w for w in found if w in _MOTIONS]
    if "middle" in fingers[1:] and not segments and "abd" not in motions:
        segments = ["pip"]
    finger = fingers[0] if fingers else WRIST if WRIST in found else ""
    recognized = {*side, *fingers, *segments, *motions, WRIST, *_NO_MEANING}
    numbers = [w.lstrip("0") or "0" for w in found if w.isdigit()]
    return JointLabel(
        side=side[0] if len(set(side)) == 1 else "",
        finger=finger,
        segment=segments[-1] if segments else "",
        motion=motions[-1] if motions else "",
        number=".".join(numbers),
        other_words=frozenset(w for w in found if w not in recognized and not w.isdigit()),
    )


def _with_hint(label: JointLabel, hint: JointLabel) -> JointLabel:
    """A label with missing parts taken from a hint, where the two are of the same finger."""
    if label.finger and hint.finger and label.finger != hint.finger:
        return label
    filled = label
    if not filled.finger and hint.finger:
        filled = filled._replace(finger=hint.finger, finger_confidence=hint.finger_confidence)
    if not filled.segment and hint.segment:
        filled = filled._replace(segment=hint.segment, segment_confidence=hint.segment_confidence)
    if not filled.motion and hint.motion:
        filled = filled._replace(motion=hint.motion, motion_confidence=hint.motion_confidence)
    return filled


def _by_finger(labels: Mapping[str, JointLabel]) -> dict[tuple[str, str], list[str]]:
    """Names of each finger of each side."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name, meaning in labels.items():
        if meaning.finger:
            groups.setdefault((meaning.side, meaning.finger), []).append(name)
    return groups


def _label_numbered_hand(labels: dict[str, JointLabel]) -> None:
    """Fingers of joints that have only numbers, of a hand with as many joints as is usual."""
    for side in ("", "left", "right"):
        members = [n for n, m in labels.items() if m.side == side]
        unlabelled = [n for n in members if not labels[n].finger and not labels[n].segment and labels[n].number]
        numbers = {labels[n].number: n for n in unlabelled}
        if len(unlabelled) != len(members) or len(numbers) != len(unlabelled) or len(unlabelled) not in _NUMBERED_HANDS:
            continue
        for index, number in enumerate(sorted(numbers, key=_numbers)):
            name = numbers[number]
            finger = _NUMBERED_HANDS[len(unlabelled)][index // 4]
            labels[name] = labels[name]._replace(finger=finger, finger_confidence=0.35)


def _label_by_order(labels: dict[str, JointLabel], members: list[str]) -> None:
    """Segments of the joints of a finger that have numbers only, from the palm on."""
    unlabelled = [n for n in members if not labels[n].segment and not labels[n].motion and labels[n].number]
    if len(unlabelled) != len([n for n in members if not labels[n].segment]) or len(
        {labels[n].number for n in unlabelled}
    ) < len(unlabelled):
        return
    finger = labels[unlabelled[0]].finger if unlabelled else ""
    orders = _WRIST_ORDER if finger == WRIST else _THUMB_ORDER if finger == "thumb" else _FINGER_ORDER
    if len(unlabelled) != len(members) or len(unlabelled) not in orders:
        return
    counts_down = bool(_COUNTS_DOWN.search(unlabelled[0]))
    confidence, order = orders[len(unlabelled)]
    if finger == WRIST and not counts_down:
        confidence = 0.4
    for name, (segment, motion) in zip(
        sorted(unlabelled, key=lambda n: _numbers(labels[n].number), reverse=counts_down), order, strict=True
    ):
        labels[name] = labels[name]._replace(
            segment=segment, motion=motion, segment_confidence=confidence, motion_confidence=confidence
        )


def _thumb_segments(labels: dict[str, JointLabel], members: list[str]) -> None:
    """Rename segments of a thumb, which has no pip: mcp, pip, dip of other fingers are its cmc, mcp, ip."""
    if labels[members[0]].finger != "thumb":
        return
    recognized = {labels[n].segment for n in members} - {""}
    if {"mcp", "pip", "dip"} <= recognized and not {"cmc", "ip"} & recognized:
        change = {"mcp": "cmc", "pip": "mcp", "dip": "ip"}
    elif "mcp" in recognized and "pip" in recognized and not {"dip", "ip"} & recognized:
        change = {"pip": "ip"}
    else:
        change = {"dip": "ip"} if "ip" not in recognized else {}
    for name in members:
        segment = labels[name].segment
        labels[name] = labels[name]._replace(segment=change.get(segment, segment))


def _infer_motions(labels: dict[str, JointLabel], members: list[str]) -> None:
    """Segments without a named motion are flexion; of two such joints the first is abduction."""
    for segment in _SEGMENTS:
        members_here = [n for n in members if labels[n].segment == segment and not labels[n].motion]
        if len(members_here) == 1:
            confidence = 0.95 if segment in ("pip", "dip", "ip") else 0.85
            labels[members_here[0]] = labels[members_here[0]]._replace(motion="flex", motion_confidence=confidence)
        elif len(members_here) == 2 and len({labels[n].number for n in members_here}) == 2:
            for name, motion in zip(
                sorted(members_here, key=lambda n: _numbers(labels[n].number)), ("abd", "flex"), strict=True
            ):
                labels[name] = labels[name]._replace(motion=motion, motion_confidence=0.5)


def _numbers(text: str) -> list[int]:
    return [int(part) for part in text.split(".") if part]
