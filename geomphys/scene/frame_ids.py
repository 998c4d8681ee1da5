"""Makes the frame ids of the output's ``/tf`` unique."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from geomphys.scene.findings import RenamedFrame

if (
    TYPE_CHECKING
):  # the names are needed to read an output too, where loading what makes a scene would take most of the time
    from geomphys.scene.trees import Tree

WORLD = "world"
RECORDED_PREFIX = "recorded/"


def make_frame_ids_unique(trees: Sequence[Tree]) -> tuple[RenamedFrame, ...]:
    """Rename links whose frame id is ambiguous to AVATAR/LINK, in place; returns the renamed ones.

    An id is ambiguous if another body has it, or if it is the world's or that of a recorded (uncorrected) frame. Names
    of objects and avatars are unique and contain no slash, so the new ids differ from each other; if one equals the
    plain name of another link, that link is renamed too.
    """
    bodies = [(tree, body) for tree in trees for body in tree.bodies]
    renamed: list[RenamedFrame] = []
    while True:
        # viewers ignore a leading slash
        counts = Counter(body.frame.lstrip("/") for _, body in bodies)
        ambiguous = [
            (tree, body)
            for tree, body in bodies
            if tree.skeleton is not None
            and body.frame != body.name
            and (counts[plain := body.frame.lstrip("/")] > 1 or plain == WORLD or plain.startswith(RECORDED_PREFIX))
        ]
        if not ambiguous:
            return tuple(renamed)
        for _, body in ambiguous:
            link, body.frame = body.frame, body.name
            renamed.append(RenamedFrame(body.name, link, body.frame))
