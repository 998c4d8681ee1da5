"""Guesses about a log: which recorded joint is which joint of a URDF, in which unit, which pose is that of its root.

A guess is for a person to confirm, so every one comes with how sure it is or why it was made.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Literal, NamedTuple

from geomphys.recording.naming import COMPARED, LENGTH

LIKELY = 0.5
"""Share of common words from which on two names may mean the same joint."""
OVER = 0.5
"""rad; an angle this far outside its limits is not what people do: it is of the other unit."""

_SAME_WORD = {
    "pinky": "little", "pinkie": "little", "small": "little", "lf": "little", "lfj": "little",
    "forefinger": "index", "ff": "index", "ffj": "index", "mf": "middle", "mfj": "middle",
    "rf": "ring", "rfj": "ring", "th": "thumb", "thj": "thumb", "wrj": "wrist",
    "stretch": "flex", "flexion": "flex", "bend": "flex", "pitch": "flex", "extension": "flex",
    "spread": "abd", "abduction": "abd", "adduction": "abd", "splay": "abd", "yaw": "abd",
    "rotation": "rot", "roll": "rot", "l": "left", "lh": "left", "r": "right", "rh": "right",
}  # fmt: skip
_NO_MEANING = {"joint", "angle", "pos", "position", "state", "states", "the", "finger", "hand", "human"}

_ROOT_WORDS = {"wrist", "hand", "palm", "root", "base", "pelvis", "hips", "hip", "forearm", "torso", "body"}
_TRACKER_WORDS = {"tracker", "glove", "mocap", "vicon", "optitrack", "vive", "leap", "qualisys"}
_OTHER_WORDS = {"target", "targets", "goal", "desired", "command", "commands", "cmd", "reference", "setpoint", "action"}
_THING_WORDS = {"object", "objects", "scene", "door", "handle", "head", "hmd", "camera", "table"}


@dataclass(frozen=True)
class JointMatch:
    """A recorded joint and the joint of the URDF it is, or may be."""

    recorded: str
    joint: str
    how: Literal["name", "spelling", "guess"]  # equal; equal but for spelling and synonyms; only alike


class UnitGuess(NamedTuple):
    """The unit of recorded angles, and what speaks for it."""

    unit: Literal["rad", "deg"]
    reason: str


def words(name: str) -> list[str]:
    """Words of a name in one spelling: ``IndexMCPStretch`` and ``index_mcp_flex`` are the same three."""
    parts = re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|[0-9]+", name[:LENGTH])
    return [_SAME_WORD.get(p.lower(), p.lower()) for p in parts]


def side_of(name: str) -> str:
    """``left``, ``right``, or "" for a name that says neither or both."""
    sides = {"left", "right"} & set(words(name))
    return sides.pop() if len(sides) == 1 else ""


def match_joints(recorded: Iterable[str], joints: Iterable[str]) -> tuple[JointMatch, ...]:
    """Pair recorded names with the joints of a URDF, each at most once: the surest first.

    Returns
    -------
    tuple of JointMatch
        In the order of `joints`.
    """
    free_recorded, free_joints = dict.fromkeys(recorded), dict.fromkeys(joints)
    order = list(free_joints)
    found: list[JointMatch] = []

    def take(name: str, joint: str, how: Literal["name", "spelling", "guess"]) -> None:
        found.append(JointMatch(name, joint, how))
        del free_recorded[name], free_joints[joint]

    for name in [n for n in free_joints if n in free_recorded]:
        take(name, name, "name")
    sides = {side_of(n) for n in (*free_recorded, *free_joints)} - {""}
    ignored = _NO_MEANING | sides if len(sides) == 1 else _NO_MEANING  # nothing to tell apart
    keys: dict[frozenset[str], list[str]] = {}
    for name in free_recorded:
        keys.setdefault(_key(name, ignored), []).append(name)
    by_joint: dict[frozenset[str], list[str]] = {}
    for joint in free_joints:
        by_joint.setdefault(_key(joint, ignored), []).append(joint)
    for key, names in by_joint.items():
        if key and len(names) == 1 and len(keys.get(key, ())) == 1:
            take(keys[key][0], names[0], "spelling")
    rest = sorted(
        (-score, joint, name)
        for joint in list(free_joints)[:COMPARED]
        for name in list(free_recorded)[:COMPARED]
        if (score := _alike(name, joint, ignored)) >= LIKELY
    )
    for _, joint, name in rest:
        if joint in free_joints and name in free_recorded:
            take(name, joint, "guess")
    place = {joint: i for i, joint in enumerate(order)}
    return tuple(sorted(found, key=lambda m: place[m.joint]))


def guess_unit(ranges: Mapping[str, tuple[float, float]], limits: Mapping[str, tuple[float, float]]) -> UnitGuess:
    """Tell radians from degrees.

    Parameters
    ----------
    ranges
        Recorded name -> least and largest value. Only revolute joints.
    limits
        The same names -> lower and upper limit of the joint, rad; infinite where there is none.
    """
    if not ranges:
        return UnitGuess("rad", "there is no angle to judge by")
    name, largest = max(((n, max(-low, high)) for n, (low, high) in ranges.items()), key=lambda x: (x[1], x[0]))
    if largest > 2 * math.pi:
        return UnitGuess("deg", f"{name} reaches {largest:.4g}: as radians that is more than a whole turn")
    outside = [sum(_excess(ranges[n], limits[n], scale) > OVER for n in ranges) for scale in (1.0, math.pi / 180.0)]
    if outside[0] > len(ranges) // 4 and outside[1] == 0:
        what = f"{outside[0]} of {len(ranges)} joints would be far outside their limits as radians"
        return UnitGuess("deg", what + ", as degrees none is")
    return UnitGuess("rad", f"no value is above {largest:.3g}")


@dataclass(frozen=True)
class PoseCandidate:
    """A pose of a log that a root or an object could follow."""

    name: str  # as in a scene file: `topic` or `topic#child`
    messages: int
    low: tuple[float, float, float]  # m, corner of the box of its positions
    high: tuple[float, float, float]


def rank_roots(
    candidates: Sequence[PoseCandidate], root_link: str, names: Iterable[str], joints_topic: str, messages: int
) -> list[tuple[float, PoseCandidate]]:
    """Poses that may be that of an avatar's root, likeliest first.

    Parameters
    ----------
    candidates
    root_link
        Name of the URDF's root link.
    names
        What else tells which avatar it is: the name of its file.
    joints_topic
        The topic of its joints, "" if there is none, with this many `messages`.
    """
    told = [root_link, *names]
    sides = {s for s in map(side_of, [*told, joints_topic]) if s}
    own = {w for name in told for w in words(name)} - _NO_MEANING - {"left", "right"}
    scored = []
    for candidate in candidates:
        here = words(candidate.name)
        score = 2.0 * len(own & set(here)) + 2.0 * bool(_ROOT_WORDS & set(here)) + bool(_TRACKER_WORDS & set(here))
        if candidate.name.rsplit("#", 1)[-1].rsplit("/", 1)[-1] == root_link:
            score += 6.0
        score -= 4.0 * bool((_OTHER_WORDS | _THING_WORDS) & set(here))
        if candidate.messages < 2:
            score -= 6.0
        elif messages and abs(candidate.messages - messages) <= 0.2 * messages:
            score += 1.0
        side = side_of(candidate.name)
        if side and sides:
            score += 3.0 if side in sides else -20.0
        scored.append((score, candidate))
    return sorted(scored, key=lambda item: (-item[0], item[1].name))


def is_request(topic: str) -> bool:
    """Whether a topic's name says that it is what was asked for, not what was measured."""
    return bool(_OTHER_WORDS & set(words(topic)))


def _key(name: str, ignored: Set[str]) -> frozenset[str]:
    """The words of a name that tell joints apart."""
    return frozenset(w for w in words(name) if w not in ignored)


def _alike(a: str, b: str, ignored: Set[str]) -> float:
    """How much two names have in common, 0 to 1; 0 if they are of different sides or numbers."""
    one, other = _key(a, ignored), _key(b, ignored)
    if side_of(a) and side_of(b) and side_of(a) != side_of(b):
        return 0.0
    numbers = [{w for w in k if w.isdigit()} for k in (one, other)]
    if numbers[0] != numbers[1] or not one or not other:
        return 0.0
    common = len(one & other) / len(one | other)
    spelled = difflib.SequenceMatcher(None, a.lower()[:LENGTH], b.lower()[:LENGTH], autojunk=False)
    if spelled.real_quick_ratio() < 0.85:
        return common
    ratio = spelled.ratio()
    return max(common, ratio) if ratio >= 0.85 else common


def _excess(span: tuple[float, float], limits: tuple[float, float], scale: float) -> float:
    """How far values reach outside of limits, rad."""
    return max(limits[0] - scale * span[0], scale * span[1] - limits[1], 0.0)
