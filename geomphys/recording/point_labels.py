"""Labels tracked points and links of a hand by finger and segment, and finds the link of each point.

A label is ``wrist``, ``palm`` or ``FINGER_SEGMENT``. Segments are named by the joint at their proximal end, which is where the
point of OpenXR and the frame of a link are: ``cmc`` (metacarpal), ``mcp`` (proximal), ``pip`` (intermediate, middle), ``dip``
(distal; of a thumb ``ip``), ``tip``. Nodes of Manus are named by bones too, but for strings that look like joints:
*MCP, PIP, IP, DIP, TIP* are the metacarpal, proximal, intermediate, distal bone and the tip; so they are labelled by
their order in a finger.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from geomphys.recording.message_kinds import HAND_JOINTS
from geomphys.recording.name_words import FINGERS, side_of, words

SEGMENTS = ("cmc", "mcp", "pip", "dip", "tip")
THUMB_SEGMENTS = ("cmc", "mcp", "ip", "tip")
WHOLE_HAND = ("wrist", "palm")
_MANUS_ORDER = ("metacarpal", "mcp", "proximal", "pip", "intermediate", "ip", "distal", "dip", "tip")


class Label(NamedTuple):
    """What a name means."""

    side: str  # "left", "right" or ""
    point: str  # "" if it is none of a hand


def _standard(finger: str) -> tuple[str, ...]:
    return THUMB_SEGMENTS if finger == "thumb" else SEGMENTS


def _openxr() -> tuple[str, ...]:
    """Labels of OpenXR's 26 joints."""
    return tuple(label_names(HAND_JOINTS)[name].point for name in HAND_JOINTS)


def layout_labels(layout: str, count: int) -> tuple[str, ...]:
    """Label of each index in a list of `count` points of a layout.

    WebXR has the joints of OpenXR without the palm: that is a list of 25. Manus has the root of the hand, then the bones
    of each finger from the thumb on.
    """
    if layout == "mediapipe":
        fingers = [f"{f}_{s}" for f in FINGERS for s in (THUMB_SEGMENTS if f == "thumb" else SEGMENTS[1:])]
        return ("wrist", *fingers)
    if layout == "manus" or count == len(HAND_JOINTS) - 1:
        return ("wrist", *(f"{f}_{s}" for f in FINGERS for s in _standard(f)))
    return _openxr()


def label_names(names: Iterable[str]) -> dict[str, Label]:
    """Labels of names of points or links, each seen beside the others.

    ``middle`` is a finger unless one is named before it. A thumb has no intermediate segment: where its names have one,
    all of them are one joint nearer to the palm than they say.
    """
    listed = list(names)
    labels = {name: _label(name) for name in listed}
    for side in ("", "left", "right"):
        thumb = {
            n: m.point.removeprefix("thumb_") for n, m in labels.items() if m.side == side and m.point[:6] == "thumb_"
        }
        shift = {"mcp": "cmc", "pip": "mcp", "dip": "ip"} if "pip" in thumb.values() else {"dip": "ip"}
        for name, segment in thumb.items():
            labels[name] = Label(side, f"thumb_{shift.get(segment, segment)}")
    return labels


def _label(name: str) -> Label:
    found = words(name)
    fingers = [w for w in found if w in FINGERS]
    segments = [w for w in found if w in SEGMENTS or w == "ip"]
    if "middle" in fingers[1:] and not segments:
        segments = ["pip"]
    if fingers:
        return Label(side_of(name), f"{fingers[0]}_{segments[-1]}" if segments else "")
    return Label(side_of(name), next((w for w in WHOLE_HAND if w in found), ""))


def label_manus_nodes(names: Iterable[str]) -> dict[str, Label]:
    """Labels of the nodes of Manus gloves, ``side/number/chain/joint``."""
    labels: dict[str, Label] = {}
    chains: dict[tuple[str, str], list[tuple[int, str]]] = {}
    for name in names:
        parts = name.split("/")
        side, chain = parts[0], " ".join(words(parts[2])) if len(parts) > 2 else ""
        kind = parts[3].lower() if len(parts) > 3 else ""
        if chain in FINGERS and kind in _MANUS_ORDER:
            chains.setdefault((side, chain), []).append((_MANUS_ORDER.index(kind), name))
        else:
            labels[name] = Label(side, "wrist" if chain == "hand" else "")
    for (side, chain), members in chains.items():
        order = _standard(chain)[-len(members) :]
        for (_, name), segment in zip(sorted(members), order, strict=False):
            labels[name] = Label(side, f"{chain}_{segment}")
    return labels


def links_of_labels(links: Iterable[str], side: str) -> dict[str, str]:
    """Label -> link, of links in their order from the root on; of several the last, which all joints of the place move."""
    labels = label_names(links)
    return {
        label.point: link for link, label in labels.items() if label.point and label.side in ("", side, *_any(side))
    }


def _any(side: str) -> tuple[str, ...]:
    return () if side else ("left", "right")


def points_of_side(labels: Mapping[str, Label], side: str) -> dict[str, str]:
    """Label -> name of a point, of one side where points of both have labels."""
    sides = {label.side for label in labels.values() if label.point} - {""}
    taken = {name: m for name, m in labels.items() if m.point and (len(sides) < 2 or m.side in ("", side))}
    found: dict[str, str] = {}
    for name, label in taken.items():
        found.setdefault(label.point, name)
    return found
