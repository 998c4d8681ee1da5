"""Ranks the poses of a log as candidates for the root of an avatar, by names, sides and rates."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from geomphys.recording.name_words import side_of, words

_NO_MEANING = {"joint", "link", "frame", "the", "finger", "hand", "human", "left", "right"}
_ROOT_WORDS = {"wrist", "hand", "palm", "root", "base", "pelvis", "hips", "hip", "forearm", "torso", "body"}
_TRACKER_WORDS = {"tracker", "glove", "mocap", "vicon", "optitrack", "vive", "leap", "qualisys"}
_COMMAND_WORDS = {
    "target",
    "targets",
    "goal",
    "desired",
    "command",
    "commands",
    "cmd",
    "reference",
    "setpoint",
    "action",
}
_OBJECT_WORDS = {"object", "objects", "scene", "door", "handle", "head", "hmd", "camera", "table"}


@dataclass(frozen=True)
class PoseCandidate:
    """A pose of a log that a root or an object could follow."""

    name: str  # as in a scene file: `topic` or `topic#child`
    messages: int
    low: tuple[float, float, float]  # m, corner of the box of its positions
    high: tuple[float, float, float]


def rank_root_poses(
    candidates: Sequence[PoseCandidate],
    root_link: str,
    names: Iterable[str],
    joints_topic: str,
    messages: int,
    side: str = "",
) -> list[tuple[float, PoseCandidate]]:
    """Poses ranked as the root of an avatar, best first.

    Parameters
    ----------
    candidates
    root_link
        Name of the URDF's root link.
    names
        What else tells which avatar it is: the name of its file.
    joints_topic
        The topic of its joints, "" if there is none, with this many `messages`.
    side
        ``left`` or ``right`` if the avatar is of a side for sure.
    """
    avatar_names = [root_link, *names]
    sides = {side} if side else {s for s in map(side_of, [*avatar_names, joints_topic]) if s}
    avatar_words = {w for name in avatar_names for w in words(name)} - _NO_MEANING
    scored = []
    for candidate in candidates:
        candidate_words = words(candidate.name)
        score = (
            2.0 * len(avatar_words & set(candidate_words))
            + 2.0 * bool(_ROOT_WORDS & set(candidate_words))
            + bool(_TRACKER_WORDS & set(candidate_words))
        )
        if candidate.name.rsplit("#", 1)[-1].rsplit("/", 1)[-1] == root_link:
            score += 6.0
        score -= 4.0 * bool((_COMMAND_WORDS | _OBJECT_WORDS) & set(candidate_words))
        if candidate.messages < 2:
            score -= 6.0
        elif messages and abs(candidate.messages - messages) <= 0.2 * messages:
            score += 1.0
        its_side = side_of(candidate.name)
        if its_side and sides:
            score += 3.0 if its_side in sides else -20.0
        scored.append((score, candidate))
    return sorted(scored, key=lambda item: (-item[0], item[1].name))


def is_command_topic(topic: str) -> bool:
    """Whether a topic's name is that of a command or target, not of a measurement."""
    return bool(_COMMAND_WORDS & set(words(topic)))
