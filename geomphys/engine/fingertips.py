"""Fingertips of avatars (links with a moving joint above them and none below), and where each is in contact."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.driven.links import Links
from geomphys.recording.name_words import words
from geomphys.scene.arrays import JOINT_FIXED, Scene
from geomphys.scene.world import World

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class TipContacts(NamedTuple):
    """The nearest point of another body to each of F fingertips."""

    gap: Floats  # (F,) m, < 0 inside; inf where nothing is near
    piece: Ints  # (F,) of the other body; undefined, as the fields below, where the gap is inf
    point: Floats  # (F, 3) m, on the other body, world
    normal: Floats  # (F, 3) unit, out of the other body


class Fingertips(NamedTuple):
    """F fingertips, in the order of their links, and scratch for their contacts."""

    link: Ints  # (F,) body
    is_thumb: Ints  # (F,)
    body_start: Ints  # (F + 1,) rows of `bodies`
    bodies: Ints  # (M,) bodies with pieces that are fixed to a fingertip, itself included
    of_body: Ints  # (B,) row of the fingertip that a body is fixed to; -1: none
    recorded: TipContacts  # at the recorded poses
    corrected: TipContacts
    is_retained: Ints  # (F,) 1 for contacts that were recorded and are there


def make_fingertips(scene: Scene, links: Links, is_thumb: Ints | None = None) -> Fingertips:
    """Find the fingertips of a scene; `is_thumb` (B,) marks bodies of thumbs (None: it has none)."""
    has_pieces = np.diff(scene.bodies.piece_start) > 0
    found = [(k, np.flatnonzero((links.weld_body == k) & has_pieces)) for k in np.flatnonzero(links.tip == 1)]
    found = [(k, bodies) for k, bodies in found if len(bodies)]
    link = np.array([k for k, _ in found], np.int64)
    starts = np.cumsum([0, *(len(bodies) for _, bodies in found)]).astype(np.int64)
    bodies = np.concatenate([bodies for _, bodies in found]) if found else np.zeros(0)
    of_body = np.full(len(scene.bodies.role), -1)
    of_body[bodies.astype(np.int64)] = np.repeat(np.arange(len(link)), np.diff(starts))
    thumbs = np.zeros(len(link), np.int64) if is_thumb is None else is_thumb[link]
    recorded, corrected = (
        TipContacts(np.full(len(link), np.inf), np.zeros(len(link), np.int64), *np.zeros((2, len(link), 3)))
        for _ in range(2)
    )
    return Fingertips(
        link, thumbs, starts, bodies.astype(np.int64), of_body, recorded, corrected, np.zeros(len(link), np.int64)
    )


@lru_cache(maxsize=1)
def thumbs_of(world: World) -> Ints:
    """(B,) 1 for the links of thumbs, by the names of links and joints from a fingertip up to where fingers part."""
    bodies = world.scene.bodies
    moves = (bodies.joint != JOINT_FIXED) & (bodies.dof >= 0)
    tips_below = np.zeros(len(bodies.parent), np.int64)
    for body in range(len(bodies.parent) - 1, -1, -1):
        tips_below[body] = max(tips_below[body], int(moves[body]))
        if bodies.parent[body] >= 0:
            tips_below[bodies.parent[body]] += tips_below[body]
    finger = np.arange(len(bodies.parent))  # the first link of the finger that a link belongs to
    is_thumb = np.zeros(len(bodies.parent), np.int64)
    for body, parent in enumerate(bodies.parent):  # parents come first
        if parent >= 0 and tips_below[parent] == 1:
            finger[body] = finger[parent]
        names = [world.body_names[body].rpartition("/")[2]]
        names += [world.dof_names[bodies.dof[body]]] if moves[body] else []
        if tips_below[body] == 1 and any("thumb" in words(name) for name in names):
            is_thumb[finger[body]] = 1
    return is_thumb[finger]
