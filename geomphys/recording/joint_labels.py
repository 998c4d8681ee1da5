"""What the name of a joint says: side, finger, segment, motion. Numbers are read by their order within a finger.

Segments are told by the joint at their near end: ``cmc``, ``mcp``, ``pip``, ``dip``, of a thumb ``cmc``, ``mcp``, ``ip``. How
sure each part is goes from 0 to 1: what a name says is 1, what follows from numbers or from the shape of a hand is less.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from geomphys.recording.name_words import FINGERS, words_of_all

WRIST = "wrist"
"""Told as a finger without segments."""

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
"""How many joints of a finger are told apart by numbers alone -> how sure, and what they are from the palm on."""
_HANDS: dict[int, tuple[str, ...]] = {16: ("index", "middle", "ring", "thumb"), 20: FINGERS}
"""Joints of a hand that have numbers only, four a finger -> the fingers in the order that is usual."""


class JointMeaning(NamedTuple):
    """What a joint is."""

    side: str = ""
    finger: str = ""  # one of FINGERS, "wrist", or ""
    segment: str = ""
    motion: str = ""
    number: str = ""
    rest: frozenset[str] = frozenset()  # other words
    finger_sure: float = 1.0
    segment_sure: float = 1.0
    motion_sure: float = 1.0


def joint_meanings(names: Iterable[str], shape: Mapping[str, JointMeaning] | None = None) -> dict[str, JointMeaning]:
    """What the names of one log or URDF mean, each seen beside the others.

    Parameters
    ----------
    names
    shape
        Joint -> what the tree of links says it is; fills in what its name does not say.
    """
    listed = list(names)
    spelled = words_of_all(listed)
    if len(listed) > 2:
        common = set.intersection(*(set(w) for w in spelled.values())) - {*FINGERS, *_SEGMENTS, *_MOTIONS, WRIST}
        common -= {"left", "right", *(w for w in common if w.isdigit())}
        spelled = {n: [w for w in found if w not in common] for n, found in spelled.items()}
    meant = {n: _parse(found) for n, found in spelled.items()}
    for name, hint in (shape or {}).items():
        if name in meant:
            meant[name] = _filled(meant[name], hint)
    _number_a_hand(meant)
    for members in _by_finger(meant).values():
        _order(meant, members)
        _thumb_segments(meant, members)
        _motions(meant, members)
    return meant


def usual_order(finger: str, count: int) -> list[tuple[str, str]]:
    """Segment and motion of the `count` joints of a finger from the palm on, as most hands have them; [] if unusual."""
    orders = _THUMB_ORDER if finger == "thumb" else _FINGER_ORDER
    return orders.get(count, (0.0, []))[1]


def _parse(found: list[str]) -> JointMeaning:
    """What words say by themselves. ``middle`` is a finger unless one is named before it: then it is a segment."""
    side = [w for w in found if w in ("left", "right")]
    fingers = [w for w in found if w in FINGERS]
    segments = [w for w in found if w in _SEGMENTS]
    motions = [w for w in found if w in _MOTIONS]
    if "middle" in fingers[1:] and not segments and "abd" not in motions:
        segments = ["pip"]
    finger = fingers[0] if fingers else WRIST if WRIST in found else ""
    told = {*side, *fingers, *segments, *motions, WRIST, *_NO_MEANING}
    numbers = [w.lstrip("0") or "0" for w in found if w.isdigit()]
    return JointMeaning(
        side=side[0] if len(set(side)) == 1 else "",
        finger=finger,
        segment=segments[-1] if segments else "",
        motion=motions[-1] if motions else "",
        number=".".join(numbers),
        rest=frozenset(w for w in found if w not in told and not w.isdigit()),
    )


def _filled(said: JointMeaning, hint: JointMeaning) -> JointMeaning:
    """A meaning with what is missing taken from a hint, where the two are of the same finger."""
    if said.finger and hint.finger and said.finger != hint.finger:
        return said
    filled = said
    if not filled.finger and hint.finger:
        filled = filled._replace(finger=hint.finger, finger_sure=hint.finger_sure)
    if not filled.segment and hint.segment:
        filled = filled._replace(segment=hint.segment, segment_sure=hint.segment_sure)
    if not filled.motion and hint.motion:
        filled = filled._replace(motion=hint.motion, motion_sure=hint.motion_sure)
    return filled


def _by_finger(meant: Mapping[str, JointMeaning]) -> dict[tuple[str, str], list[str]]:
    """Names of each finger of each side."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name, meaning in meant.items():
        if meaning.finger:
            groups.setdefault((meaning.side, meaning.finger), []).append(name)
    return groups


def _number_a_hand(meant: dict[str, JointMeaning]) -> None:
    """Fingers of joints that have only numbers, of a hand with as many joints as is usual."""
    for side in ("", "left", "right"):
        members = [n for n, m in meant.items() if m.side == side]
        bare = [n for n in members if not meant[n].finger and not meant[n].segment and meant[n].number]
        numbers = {meant[n].number: n for n in bare}
        if len(bare) != len(members) or len(numbers) != len(bare) or len(bare) not in _HANDS:
            continue
        for place, number in enumerate(sorted(numbers, key=_numbers)):
            name = numbers[number]
            finger = _HANDS[len(bare)][place // 4]
            meant[name] = meant[name]._replace(finger=finger, finger_sure=0.35)


def _order(meant: dict[str, JointMeaning], members: list[str]) -> None:
    """Segments of the joints of a finger that have numbers only, from the palm on."""
    bare = [n for n in members if not meant[n].segment and not meant[n].motion and meant[n].number]
    if len(bare) != len([n for n in members if not meant[n].segment]) or len({meant[n].number for n in bare}) < len(
        bare
    ):
        return
    finger = meant[bare[0]].finger if bare else ""
    orders = _WRIST_ORDER if finger == WRIST else _THUMB_ORDER if finger == "thumb" else _FINGER_ORDER
    if len(bare) != len(members) or len(bare) not in orders:
        return
    down = bool(_COUNTS_DOWN.search(bare[0]))
    sure, order = orders[len(bare)]
    if finger == WRIST and not down:
        sure = 0.4
    for name, (segment, motion) in zip(
        sorted(bare, key=lambda n: _numbers(meant[n].number), reverse=down), order, strict=True
    ):
        meant[name] = meant[name]._replace(segment=segment, motion=motion, segment_sure=sure, motion_sure=sure)


def _thumb_segments(meant: dict[str, JointMeaning], members: list[str]) -> None:
    """A thumb has no pip: three segments told as those of a finger are its cmc, mcp and ip."""
    if meant[members[0]].finger != "thumb":
        return
    told = {meant[n].segment for n in members} - {""}
    if {"mcp", "pip", "dip"} <= told and not {"cmc", "ip"} & told:
        change = {"mcp": "cmc", "pip": "mcp", "dip": "ip"}
    elif "mcp" in told and "pip" in told and not {"dip", "ip"} & told:
        change = {"pip": "ip"}
    else:
        change = {"dip": "ip"} if "ip" not in told else {}
    for name in members:
        segment = meant[name].segment
        meant[name] = meant[name]._replace(segment=change.get(segment, segment))


def _motions(meant: dict[str, JointMeaning], members: list[str]) -> None:
    """A segment whose motion is not named bends; the first of two such joints spreads."""
    for segment in _SEGMENTS:
        here = [n for n in members if meant[n].segment == segment and not meant[n].motion]
        if len(here) == 1:
            sure = 0.95 if segment in ("pip", "dip", "ip") else 0.85
            meant[here[0]] = meant[here[0]]._replace(motion="flex", motion_sure=sure)
        elif len(here) == 2 and len({meant[n].number for n in here}) == 2:
            for name, motion in zip(
                sorted(here, key=lambda n: _numbers(meant[n].number)), ("abd", "flex"), strict=True
            ):
                meant[name] = meant[name]._replace(motion=motion, motion_sure=0.5)


def _numbers(text: str) -> list[int]:
    return [int(part) for part in text.split(".") if part]
