"""Guesses which recorded joint is which joint of a URDF, by their names.

A guess is for a person to confirm, so every one comes with how sure it is. Guesses are one to one: of all ways to pair the
names, the one whose scores sum up highest.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import linear_sum_assignment

from geomphys.recording.display_names import LENGTH
from geomphys.recording.joint_labels import WRIST, JointMeaning, joint_meanings
from geomphys.recording.name_words import FINGERS, side_of, words_of_all

LIKELY = 0.5
"""Score from which on two names may mean the same joint."""
SURE = 0.7
"""Score from which on a guess is used unless a person says no."""
COMPARED = 400
"""Names of each side that are guessed among."""

_ONLY_ALIKE = 0.65
"""Highest score of names that have words or letters in common and no more."""
_TIE = 0.01
_NO_MEANING = {"joint", "j", "angle", "pos", "position", "state", "states", "the", "finger", "hand", "human", "glove"}
_TELLING = {*FINGERS, WRIST, "cmc", "mcp", "pip", "dip", "ip", "flex", "abd", "rot", "left", "right"}

How = Literal["name", "spelling", "guess"]


@dataclass(frozen=True)
class JointMatch:
    """A recorded joint and the joint of the URDF it is, or may be."""

    recorded: str
    joint: str
    how: How  # equal; equal but for spelling and synonyms; a guess
    score: float = 1.0  # 0 to 1, how sure

    @property
    def is_used(self) -> bool:
        """Whether a drafted scene goes by it; else it stands in a comment."""
        return self.how != "guess" or self.score >= SURE


def match_joints(
    recorded: Iterable[str],
    joints: Iterable[str],
    *,
    side: str = "",
    shape: Mapping[str, JointMeaning] | None = None,
) -> tuple[JointMatch, ...]:
    """Pair recorded names with the joints of a URDF, each at most once: the surest first.

    Parameters
    ----------
    recorded, joints
        Names of each.
    side
        ``left`` or ``right`` if the URDF is a hand of that side: names of the other side are then not looked at.
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

    def take(name: str, joint: str, how: How, score: float = 1.0) -> None:
        found.append(JointMatch(name, joint, how, score))
        del free_recorded[name], free_joints[joint]

    for name in [n for n in free_joints if n in free_recorded]:
        take(name, name, "name")
    if side:
        for name in [n for n in free_recorded if side_of(n) not in ("", side)]:
            del free_recorded[name]
    meant = joint_meanings(free_recorded), joint_meanings(order, shape)
    for name, joint in list(_spelled_alike(free_recorded, free_joints, side)):
        if _likeness(meant[0][name], meant[1][joint]) != 0.0:
            take(name, joint, "spelling")
    for name, joint, score in _assigned(list(free_recorded)[:COMPARED], list(free_joints)[:COMPARED], meant, side):
        take(name, joint, "guess", score)
    return tuple(sorted(found, key=lambda m: order[m.joint]))


def _spelled_alike(recorded: Iterable[str], joints: Iterable[str], side: str) -> Iterable[tuple[str, str]]:
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
    """The words of names that tell them apart: a word that all have and no other side's name has, is a prefix."""
    keys = {n: frozenset(w for w in found if w not in ignored) for n, found in words_of_all(names).items()}
    theirs = [frozenset(w for w in found if w not in ignored) for found in words_of_all(others).values()]
    if len(keys) < 3 or len(theirs) < 3 or frozenset.intersection(*theirs):
        return keys
    prefix = frozenset.intersection(*keys.values()) - _TELLING - frozenset.union(*theirs)
    return {n: key - prefix for n, key in keys.items()}


def _assigned(
    recorded: Sequence[str],
    joints: Sequence[str],
    meant: tuple[Mapping[str, JointMeaning], Mapping[str, JointMeaning]],
    side: str,
) -> list[tuple[str, str, float]]:
    """The pairs whose scores sum up highest, those below `LIKELY` left out."""
    if not recorded or not joints:
        return []
    two_sides = not side and len({meant[0][n].side for n in recorded} - {""}) == 2
    scores = np.array([[_score(name, joint, meant, two_sides) for joint in joints] for name in recorded])
    rows, columns = linear_sum_assignment(scores, maximize=True)
    partner = dict(zip(rows.tolist(), columns.tolist(), strict=True))
    unpaired = [r for r in range(len(recorded)) if partner.get(r) is None or scores[r, partner[r]] < LIKELY]
    idle = [c for c in range(len(joints)) if c not in {p for r, p in partner.items() if scores[r, p] >= LIKELY}]
    pairs = []
    for row, column in partner.items():
        score = float(scores[row, column])
        if score < LIKELY:
            continue
        tied = (scores[unpaired, column] >= score - _TIE).any() or (scores[row, idle] >= score - _TIE).any()
        pairs.append((recorded[row], joints[column], min(score, _ONLY_ALIKE) if tied else score))
    return pairs


def _score(
    name: str, joint: str, meant: tuple[Mapping[str, JointMeaning], Mapping[str, JointMeaning]], two_sides: bool
) -> float:
    """How sure it is that a recorded name and a joint are the same, 0 to 1."""
    one, other = meant[0][name], meant[1][joint]
    if one.side and other.side and one.side != other.side:
        return 0.0
    score = _likeness(one, other)
    if score is None:
        score = min(_alike(name, joint, one, other), _ONLY_ALIKE)
    return 0.9 * _ONLY_ALIKE * score if two_sides and one.side and not other.side else score


def _likeness(one: JointMeaning, other: JointMeaning) -> float | None:
    """How much two joints of fingers are the same, 0 to 1: 0 if they are surely not. None if neither is of a finger."""
    if not one.finger and not other.finger:
        return None
    if one.finger != other.finger:
        return 0.0
    score = 0.4 * min(one.finger_sure, other.finger_sure)
    if one.segment == other.segment:
        score += 0.35 * min(one.segment_sure, other.segment_sure)
    elif one.segment and other.segment:
        return 0.0
    else:
        score += 0.1
    if one.motion == other.motion:
        score += 0.25 * min(one.motion_sure, other.motion_sure)
    elif one.motion and other.motion:
        if one.finger != "thumb" or "flex" in (one.motion, other.motion):
            return 0.0
        score += 0.1  # abduction and rotation of a thumb go by each other's names
    else:
        score += 0.1
    return score


def _alike(a: str, b: str, one: JointMeaning, other: JointMeaning) -> float:
    """How much two names have in common, 0 to 1; 0 if they are of different numbers."""
    keys = [m.rest | ({m.motion} - {""}) | ({m.number} - {""}) for m in (one, other)]
    if one.number != other.number or not keys[0] or not keys[1]:
        return 0.0
    common = len(keys[0] & keys[1]) / len(keys[0] | keys[1])
    spelled = difflib.SequenceMatcher(None, a.lower()[:LENGTH], b.lower()[:LENGTH], autojunk=False)
    if spelled.real_quick_ratio() < 0.85:
        return common
    ratio = spelled.ratio()
    return max(common, ratio) if ratio >= 0.85 else common
