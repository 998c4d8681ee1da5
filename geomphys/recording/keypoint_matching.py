"""Matches the points of a topic with the links of a tree: by the scene's `links`, then by finger and segment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from geomphys.recording.channels import kind_of
from geomphys.recording.decoders import BadMessageError
from geomphys.recording.display_names import add_names
from geomphys.recording.name_words import common_side, side_of
from geomphys.recording.point_labels import (
    WHOLE_HAND,
    Label,
    label_manus_nodes,
    label_names,
    layout_labels,
    links_of_labels,
    points_of_side,
)
from geomphys.recording.point_reader import make_point_reader
from geomphys.recording.reader import LogChannel, LogReader
from geomphys.scene.topic_sources import KeypointSource

NAMED_MESSAGES = 300
"""Messages from which the names of points are taken."""
TIP_WEIGHT = 2.0
"""Of fingertips: where bone lengths are not quite those of the model, they are what has to be right."""
PALM_WEIGHT = 0.3
"""Of the palm, which no two models have at one place."""


class PointMatches(NamedTuple):
    """Which points have which links."""

    links: dict[str, str]  # `Pose.child` of a point -> link
    weights: tuple[float, ...]  # of these points in the fit
    oriented: tuple[bool, ...]  # of these points: whether it is the wrist or the palm, whose orientation may count
    left_out: list[str]  # points without a link


def match_points(
    reader: LogReader,
    channels: tuple[LogChannel, ...],
    source: KeypointSource,
    side: str,
    links: Sequence[str],
    tree: str,
) -> PointMatches:
    """Match the points of a topic with links.

    Parameters
    ----------
    reader, channels
        The log, and the channels of the topic.
    source
        Layout and `links` of the scene: these go first.
    side
        ``left`` or ``right`` if the scene names one (``topic#left``), else that of the links or of `tree` counts.
    links
        Names of the links of the tree, parents first.
    tree
        Name of the avatar.
    """
    names = _names_of(reader, channels)
    kind = kind_of(channels[0])
    content = kind.content if kind is not None else "poses"
    side = side or common_side(links) or side_of(tree)
    labels: dict[str, Label] = {}
    if content == "glove":
        labels = label_manus_nodes(names)
        sides = {label.side for label in labels.values()}
        labels = {n: m for n, m in labels.items() if not side or m.side == side or len(sides) == 1}
    elif source.layout is None:
        labels = {}
    elif content == "poses":
        layout = layout_labels(source.layout, len(names))
        labels = {str(k): Label("", point) for k, point in enumerate(layout)}
    else:
        labels = label_names(names)
    by_label = points_of_side(labels, side)
    matched = {
        by_label[label]: link
        for label, link in links_of_labels(links, side).items()
        if source.layout and label in by_label
    }
    for point, link in source.links.items():
        matched[_named(point, names, by_label)] = link
    points = {n: m.point for n, m in labels.items()}
    found = {name: matched[name] for name in [*points, *matched] if name in matched}
    left_out = [
        f"{n} ({points[n]})" if points[n] else n for n in points if n not in found and _is_of_side(labels[n], side)
    ]
    weights = tuple(_weight(points.get(name) or link) for name, link in found.items())
    oriented = tuple(points.get(name) in WHOLE_HAND for name in found)
    return PointMatches(found, weights, oriented, left_out)


def _is_of_side(label: Label, side: str) -> bool:
    return not side or label.side in ("", side)


def _weight(name: str) -> float:
    label = label_names([name])[name].point
    return TIP_WEIGHT if label.endswith("_tip") else PALM_WEIGHT if label == "palm" else 1.0


def _named(key: str, names: Sequence[str], by_label: dict[str, str]) -> str:
    """`Pose.child` that a key of `links` means: a name of the log, the number of a node, or finger and segment."""
    if key in names:
        return key
    numbered = [n for n in names if n.split("/")[1:2] == [key]]
    if numbered:
        return numbered[0]
    return by_label.get(label_names([key])[key].point, key)


def _names_of(reader: LogReader, channels: tuple[LogChannel, ...]) -> list[str]:
    """Names of the points in the first messages, in the order they come in; those of a list by number."""
    readers = {c.key: make_point_reader(c) for c in channels}
    names: dict[str, None] = {}
    known: set[str] = set()
    keys, left = set(readers), NAMED_MESSAGES
    for raw in reader.read(keys):
        try:
            found = [pose.child for pose in readers[raw.key](raw.data)]
        except BadMessageError:
            found = []
        fresh = [n for n in found if n not in known]
        add_names(known, fresh)
        names.update(dict.fromkeys(n for n in fresh if n in known))
        left -= 1
        if left == 0:
            break
    return list(names)
