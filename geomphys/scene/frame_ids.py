"""Frame ids of the output: one for each body, none of them the world's or a recorded ghost's."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from geomphys.scene.findings import RenamedFrame
from geomphys.scene.trees import Tree

WORLD = "world"
RECORDED_PREFIX = "recorded/"


def make_frame_ids_unique(trees: Sequence[Tree]) -> tuple[RenamedFrame, ...]:
    """Give links whose frame id is another frame's too the id AVATAR/LINK; returns which.

    Names of objects and avatars differ and hold no slash, so the ids that this gives differ from each other; where one
    of them is the plain name of another link, that link gets a longer one too.
    """
    bodies = [(tree, body) for tree in trees for body in tree.bodies]
    renamed: list[RenamedFrame] = []
    while True:
        # Viewers take a leading slash for none.
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
