"""Matches recorded joint names to the joints of a URDF, with a confidence for each match.

Matches are for a person to confirm, so each has a score. They are one to one: the assignment with the highest total score
(Hungarian algorithm).
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Literal

import numpy as np

from geomphys.recording.display_names import MAX_LENGTH
from geomphys.recording.joint_labels import WRIST, JointLabel, label_joints
from geomphys.recording.name_words import FINGERS, side_of, words_of_all

MIN_SCORE = 0.5
"""Score from which on two names may mean the same joint."""
ACCEPTED_SCORE = 0.7
"""Least score of a match that a drafted scene uses."""
MAX_NAMES = 400
"""Names of each side that are guessed among."""

_TEXT_SCORE_LIMIT = 0.65
"""Highest score of names that have words or letters in common and no more."""
_TIE = 0.01
_NO_MEANING = {"joint", "j", "angle", "pos", "position", "state", "states", "the", "finger", "hand", "human", "glove"}
_TELLING = {*FINGERS, WRIST, "cmc", "mcp", "pip", "dip", "ip", "flex", "abd", "rot", "left", "right"}

MatchMethod = Literal["name", "spelling", "guess"]


@dataclass(frozen=True)
class JointMatch:
    """A recorded joint and the joint of the URDF it is, or may be."""

    recorded: str
    joint: str
    how: MatchMethod  # equal; equal but for spelling and synonyms; a guess
    score: float = 1.0  # confidence, 0 to 1

    @property
    def is_used(self) -> bool:
        """Whether a drafted scene uses the match; else it is written as a comment."""
        return self.how != "guess" or self.score >= ACCEPTED_SCORE


def match_joints(
    recorded: Iterable[str],
    joints: Iterable[str],
    *,
    side: str = "",
    shape: Mapping[str, JointLabel] | None = None,
) -> tuple[JointMatch, ...]:
    """Pair recorded names with the joints of a URDF, each at most once: the surest first.

    Parameters
    ----------
    recorded, joints
        Names of each.
    side
        ``left`` or ``right`` if the URDF is a hand of that side: names of the other side are then ignored.
    shape
        Joint of the URDF -> what its tree of links says it is.

    Returns
    -------
    tuple of JointMatch
        In the order of `joints`.
    """
    free_recorded, free_joints = dict.fromkeys(recorded), dict.fromkeys(joints)
    order = {joint: i for i, joint in enumerate(free_joints)}
    found: list[JointMatch] = []

    def add_match(name: str, joint: str, how: MatchMethod, score: float = 1.0) -> None:
        found.append(JointMatch(name, joint, how, score))
        del free_recorded[name], free_joints[joint]

    for name in [n for n in free_joints if n in free_recorded]:
        add_match(name, name, "name")
    if side:
        for name in [n for n in free_recorded if side_of(n) not in ("", side)]:
            del free_recorded[name]
    labels = label_joints(free_recorded), label_joints(order, shape)
    for name, joint in list(_with_same_words(free_recorded, free_joints, side)):
        if _label_similarity(labels[0][name], labels[1][joint]) != 0.0:
            add_match(name, joint, "spelling")
    for name, joint, score in _assigned(list(free_recorded)[:MAX_NAMES], list(free_joints)[:MAX_NAMES], labels, side):
        add_match(name, joint, "guess", score)
    return tuple(sorted(found, key=lambda m: order[m.joint]))


def _with_same_words(recorded: Iterable[str], joints: Iterable[str], side: str) -> Iterable[tuple[str, str]]:
    """Names that are the same words, each the only one of its words."""
    sides = {side_of(n) for n in (*recorded, *joints)} - {""}
    ignored = _NO_MEANING | ({"left", "right"} if side or len(sides) == 1 else set())
    keys: dict[frozenset[str], list[str]] = {}
    for name, key in _keys(recorded, joints, ignored).items():
        keys.setdefault(key, []).append(name)
    by_joint: dict[frozenset[str], list[str]] = {}
    for joint, key in _keys(joints, recorded, ignored).items():
        by_joint.setdefault(key, []).append(joint)
    for key, names in by_joint.items():
        if key and len(names) == 1 and len(keys.get(key, ())) == 1:
            yield keys[key][0], names[0]


def _keys(names: Iterable[str], others: Iterable[str], ignored: Set[str]) -> dict[str, frozenset[str]]:
    """The distinguishing words of names: a word that all of them have, and none of `others`, is dropped as a prefix."""
    keys = {n: frozenset(w for w in found if w not in ignored) for n, found in words_of_all(names).items()}
    other_keys = [frozenset(w for w in found if w not in ignored) for found in words_of_all(others).values()]
    if len(keys) < 3 or len(other_keys) < 3 or frozenset.intersection(*other_keys):
        return keys
    prefix = frozenset.intersection(*keys.values()) - _TELLING - frozenset.union(*other_keys)
    return {n: key - prefix for n, key in keys.items()}


def _assigned(
    recorded: Sequence[str],
    joints: Sequence[str],
    labels: tuple[Mapping[str, JointLabel], Mapping[str, JointLabel]],
    side: str,
) -> list[tuple[str, str, float]]:
    """The assignment with the highest total score (Hungarian algorithm), without pairs below `MIN_SCORE`."""
    if not recorded or not joints:
        return []
    from scipy.optimize import linear_sum_assignment

    two_sides = not side and len({labels[0][n].side for n in recorded} - {""}) == 2
    scores = np.array([[_score(name, joint, labels, two_sides) for joint in joints] for name in recorded])
    rows, columns = linear_sum_assignment(scores, maximize=True)
    partner = dict(zip(rows.tolist(), columns.tolist(), strict=True))
    unpaired = [r for r in range(len(recorded)) if partner.get(r) is None or scores[r, partner[r]] < MIN_SCORE]
    unmatched = [c for c in range(len(joints)) if c not in {p for r, p in partner.items() if scores[r, p] >= MIN_SCORE}]
    pairs = []
    for row, column in partner.items():
        score = float(scores[row, column])
        if score < MIN_SCORE:
            continue
        tied = (scores[unpaired, column] >= score - _TIE).any() or (scores[row, unmatched] >= score - _TIE).any()
        pairs.append((recorded[row], joints[column], min(score, _TEXT_SCORE_LIMIT) if tied else score))
    return pairs


def _score(
    name: str, joint: str, labels: tuple[Mapping[str, JointLabel], Mapping[str, JointLabel]], two_sides: bool
) -> float:
    """Score that a recorded name and a joint are the same, 0 to 1."""
    a_label, b_label = labels[0][name], labels[1][joint]
    if a_label.side and b_label.side and a_label.side != b_label.side:
        return 0.0
    score = _label_similarity(a_label, b_label)
    if score is None:
        score = min(_text_similarity(name, joint, a_label, b_label), _TEXT_SCORE_LIMIT)
    return 0.9 * _TEXT_SCORE_LIMIT * score if two_sides and a_label.side and not b_label.side else score


def _label_similarity(a_label: JointLabel, b_label: JointLabel) -> float | None:
    """How much two joints of fingers are the same, 0 to 1: 0 if they are surely not. None if neither is of a finger."""
    if not a_label.finger and not b_label.finger:
        return None
    if a_label.finger != b_label.finger:
        return 0.0
    score = 0.4 * min(a_label.finger_confidence, b_label.finger_confidence)
    if a_label.segment == b_label.segment:
        score += 0.35 * min(a_label.segment_confidence, b_label.segment_confidence)
    elif a_label.segment and b_label.segment:
        return 0.0
    else:
        score += 0.1
    if a_label.motion == b_label.motion:
        score += 0.25 * min(a_label.motion_confidence, b_label.motion_confidence)
    elif a_label.motion and b_label.motion:
        if a_label.finger != "thumb" or "flex" in (a_label.motion, b_label.motion):
            return 0.0
        score += 0.1  # abduction and rotation of a thumb go by each other's names
    else:
        score += 0.1
    return score


def _text_similarity(a: str, b: str, a_label: JointLabel, b_label: JointLabel) -> float:
    """How much two names have in common, 0 to 1; 0 if they are of different numbers."""
    keys = [m.other_words | ({m.motion} - {""}) | ({m.number} - {""}) for m in (a_label, b_label)]
    if a_label.number != b_label.number or not keys[0] or not keys[1]:
        return 0.0
    common = len(keys[0] & keys[1]) / len(keys[0] | keys[1])
    spelled = difflib.SequenceMatcher(None, a.lower()[:MAX_LENGTH], b.lower()[:MAX_LENGTH], autojunk=False)
    if spelled.real_quick_ratio() < 0.85:
        return common
    ratio = spelled.ratio()
    return max(common, ratio) if ratio >= 0.85 else common
