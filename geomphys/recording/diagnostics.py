"""Diagnostics of a recording: a line of text for people, with a stable key for programs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, Literal

DiagnosticKey = Literal[
    "damaged", "input", "no_frames", "times", "mixed_kinds", "single_message_clock", "position_unit", "up_axis", "angle_unit",
    "no_angles", "angle_sign", "unmatched_recorded", "unmatched_joints", "joints_without_topic", "recorded_mimics",
    "unknown_rename", "unknown_ignore", "several_gloves", "held", "unplaced", "bad_messages", "bad_samples", "late",
    "lost_frames", "out_of_order", "duplicates", "outside_limits", "files", "uneven_joints", "other_frames", "fit",
    "scene",
]  # fmt: skip

MEANINGS: Final[dict[DiagnosticKey, str]] = {
    "damaged": "the log is damaged",
    "input": "a topic, frame or joint that the scene follows is not there or cannot be read",
    "no_frames": "the log gives no frame",
    "times": "stamps that were replaced, or that jump",
    "mixed_kinds": "a topic has messages of another kind, which are not used",
    "single_message_clock": "the frame clock has one message",
    "position_unit": "positions look as if they were in another unit than `[recording]` says",
    "up_axis": "another axis looks up than `[recording]` says",
    "angle_unit": "angles look as if they were in the other unit",
    "no_angles": "joint values fit in neither radians nor degrees",
    "angle_sign": "joints that would be within their limits with the opposite sign",
    "unmatched_recorded": "recorded joints that no joint of the scene takes",
    "unmatched_joints": "joints of an avatar that its topic does not have: they stand still",
    "joints_without_topic": "an avatar follows no joint topic though the log has one: its joints stand still",
    "recorded_mimics": "recorded values of joints that follow another are not used",
    "unknown_rename": "`rename` speaks of a name that the log does not have",
    "unknown_ignore": "a pattern of `ignore` that fits no joint",
    "several_gloves": "a topic has gloves of several sides, and the scene names none",
    "held": "frames in which a stream had no good sample near them",
    "unplaced": "poses without a transform of their frame near enough in time",
    "bad_messages": "messages that cannot be decoded",
    "bad_samples": "samples that are not finite or have no unit quaternion",
    "late": "messages that came after the frames of their time had been made",
    "lost_frames": "late messages of the frame clock: no frame came of them",
    "out_of_order": "messages that were put in their place",
    "duplicates": "messages of a time that their stream had already",
    "outside_limits": "joints recorded outside of their limits",
    "files": "parts of a bag folder that are not as its metadata says",
    "uneven_joints": "joint messages that have not one position for each name",
    "other_frames": "poses of other frames on a topic that is followed for one",
    "fit": "points of a hand or body that its links do not fit, or joints that they do not show",
    "scene": "anything of the scene itself: the size of a mesh, what is shown and cannot touch",
}
"""Key -> its meaning, as listed in the documentation."""


class Diagnostic(str):
    """A line of text; `key` is its category."""

    key: DiagnosticKey

    def __new__(cls, text: str, key: DiagnosticKey = "scene") -> Diagnostic:
        """Make it of its text."""
        diagnostic = super().__new__(cls, text)
        diagnostic.key = key
        return diagnostic


def as_records(errors: Iterable[str], warnings: Iterable[str]) -> list[dict[str, str]]:
    """Errors and warnings as plain values: key, level, text. What has no key of its own is of the scene."""
    levels = [("error", text) for text in errors] + [("warning", text) for text in warnings]
    return [
        {"key": text.key if isinstance(text, Diagnostic) else "scene", "level": level, "text": str(text)}
        for level, text in levels
    ]
