"""Chooses the topic of tracked points that an avatar of a drafted scene is fitted to."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from geomphys.recording.inspect import TopicInfo
from geomphys.recording.name_words import FINGERS, side_of
from geomphys.recording.point_labels import label_names, layout_labels, links_of_labels, points_of_side
from geomphys.recording.recorded_space import RecordedSpace
from geomphys.recording.root_candidates import is_command_topic
from geomphys.recording.samples import POINTS
from geomphys.scene.skeleton import Skeleton

MIN_FINGERS = 3
"""Fingers of which points have links, at least."""
_LISTS = {26: "openxr", 25: "openxr", 21: "mediapipe"}
"""Number of poses in a message -> layout."""


@dataclass(frozen=True)
class KeypointDraft:
    """Points that an avatar is fitted to."""

    topic: str
    layout: str
    links: int  # of the avatar that have a point
    boxes: tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...]
    """Boxes of the points, as recorded; none of a glove, whose points are given in the hand."""

    def lowest_height(self, space: RecordedSpace) -> float:
        """Lowest height of a point in the world, m."""
        corners = [
            (box[i][0], box[j][1], box[k][2]) for box in self.boxes for i in (0, 1) for j in (0, 1) for k in (0, 1)
        ]
        return min(space.world_position(corner)[2] for corner in corners)


def find_keypoints(
    skeleton: Skeleton, topics: Sequence[TopicInfo], hand: str, taken: Collection[str]
) -> KeypointDraft | None:
    """The topic with points for most links of a hand; None if there is none.

    Parameters
    ----------
    skeleton
    topics
        Of names that a scene file can hold.
    hand
        The side of the tree, or "".
    taken
        Topics that other avatars are fitted to.
    """
    links = [link.name for link in skeleton.links]
    ranked: list[tuple[tuple[int, bool, int], KeypointDraft]] = []
    for topic in topics:
        side = side_of(topic.topic)
        if topic.kind not in POINTS or not topic.messages or is_command_topic(topic.topic):
            continue
        if (side and hand and side != hand) or topic.topic in taken:
            continue
        layout = (
            _LISTS.get(len(topic.frames), "")
            if topic.kind == "poses"
            else "manus"
            if topic.kind == "glove"
            else "openxr"
        )
        if not layout:
            continue
        if topic.kind in ("poses", "glove"):
            points = dict.fromkeys(layout_labels(layout, len(topic.frames) or 25), "")
        else:
            points = points_of_side(label_names(topic.frames), hand or side)
        found = set(points) & set(links_of_labels(links, hand))
        if sum(any(p.startswith(finger) for p in found) for finger in FINGERS) >= MIN_FINGERS:
            boxes = () if topic.kind == "glove" else tuple(topic.boxes.values())
            draft = KeypointDraft(topic.topic, layout, len(found), boxes)
            ranked.append(((len(found), bool(side), topic.messages), draft))
    return max(ranked, key=lambda item: item[0])[1] if ranked else None
