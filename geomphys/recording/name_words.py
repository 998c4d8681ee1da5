"""Splits names of joints, links and topics into normalised words, and finds the side (left, right) in them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable

from geomphys.recording.display_names import MAX_LENGTH

FINGERS = ("thumb", "index", "middle", "ring", "little")

_SAME_WORD = {
    "pinky": "little", "pinkie": "little", "small": "little", "lf": "little", "lfj": "little",
    "forefinger": "index", "pointer": "index", "first": "index", "if": "index", "ff": "index", "ffj": "index",
    "mf": "middle", "mfj": "middle", "mid": "middle", "rf": "ring", "rfj": "ring",
    "th": "thumb", "thj": "thumb", "wrj": "wrist",
    "stretch": "flex", "flexion": "flex", "fle": "flex", "bend": "flex", "curl": "flex", "pitch": "flex",
    "extension": "flex", "ext": "flex",
    "spread": "abd", "abduction": "abd", "adduction": "abd", "abad": "abd", "splay": "abd", "yaw": "abd", "aa": "abd",
    "ab": "abd", "add": "abd", "dev": "abd", "deviation": "abd",
    "rotation": "rot", "rotate": "rot", "roll": "rot", "twist": "rot", "opposition": "rot", "opp": "rot",
    "tm": "cmc", "metacarpal": "cmc", "proximal": "mcp", "prox": "mcp", "knuckle": "mcp", "mpj": "mcp",
    "intermediate": "pip", "medial": "pip", "pij": "pip", "distal": "dip", "dist": "dip", "dij": "dip", "ij": "ip",
    "l": "left", "lh": "left", "r": "right", "rh": "right",
}  # fmt: skip
"""Word -> its normal form; segments of a finger are named by the joint at their proximal end."""

_NAMED = (*FINGERS, "pinky", "pinkie", "pointer", "forefinger")
_SIDED = (*_NAMED, "hand", "glove", "wrist", "palm", "arm", "forearm", "elbow", "shoulder", "finger", "hip", "knee", "ankle",
          "foot", "leg", "toes", "femur", "tibia", "humerus", "radius", "clavicle", "controller")  # fmt: skip
_AFTER_FINGER = {"finger", "tip", "joint", "j", "cmc", "tm", "mcp", "pip", "dip", "ip", "proximal", "intermediate",
                 "middle", "distal", "flex", "flexion", "fle", "bend", "abd", "abduction", "spread", "aa", "rot",
                 "yaw", "pitch", "roll", "l", "r"}  # fmt: skip


_ABBREVIATED = ("ff", "mf", "rf", "lf", "th")
_AFTER_ABBREVIATION = _AFTER_FINGER | {"base", "hub", "knuckle", "metacarpal"}
"""Links in the style of the Shadow and Adroit hands: ``ffproximal``, ``thhub``."""


def words(name: str) -> list[str]:
    """Words of a name in one spelling: ``IndexMCPStretch`` and ``index_mcp_flex`` are the same three."""
    parts = re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|[0-9]+", name[:MAX_LENGTH])
    return [_SAME_WORD.get(w, w) for part in parts for w in _split(part.lower())]


def words_of_all(names: Iterable[str]) -> dict[str, list[str]]:
    """Words of names, without a number that all end in: ``joint_4.0`` among ``joint_0.0`` … is number 4."""
    found = {n: words(n) for n in names}
    while len(found) > 2 and all(len(w) > 1 and w[-1].isdigit() and w[-2].isdigit() for w in found.values()):
        if len({w[-1] for w in found.values()}) > 1:
            break
        found = {n: w[:-1] for n, w in found.items()}
    return found


def side_of(name: str) -> str:
    """``left``, ``right``, or "" for a name with neither or both."""
    sides = {"left", "right"} & set(words(name))
    return sides.pop() if len(sides) == 1 else ""


def common_side(names: Iterable[str]) -> str:
    """The side of at least 90 % of the names that have one; "" if there is none."""
    count = Counter(s for s in map(side_of, names) if s)
    if not count:
        return ""
    side, most = count.most_common(1)[0]
    return side if most >= 0.9 * count.total() else ""


def _split(word: str) -> list[str]:
    """Split compound words: ``lefthand``, ``rindex``, ``indexmcp``."""
    if word in _SAME_WORD or word in _AFTER_FINGER or len(word) < 4:
        return [word]
    for side in ("left", "right"):
        if word.startswith(side) and word[len(side) :] in _SIDED:
            return [side, word[len(side) :]]
    if word[0] in "lr" and word[1:] in _SIDED:
        return [word[0], word[1:]]
    for finger in _NAMED:
        if word.startswith(finger) and word[len(finger) :] in _AFTER_FINGER:
            return [finger, word[len(finger) :]]
    if word[:2] in _ABBREVIATED and word[2:] in _AFTER_ABBREVIATION:
        return [word[:2], word[2:]]
    return [word]
