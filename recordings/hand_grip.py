"""What the two grips share: a hand comes to a thing, closes on it twice, squeezes, opens and goes away."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from hand_motion import FINGERS, GLOVE_TOPIC, WRIST_TOPIC, glove, load_hand, tracker, unsteady
from mcap_files import Recording
from motion import Restless, through
from turns import transforms

FRAMES = 720
RATE = 60.0


class Grip(NamedTuple):
    """One grip.

    ``scene``: the scene file; ``seed``; ``grasped``: (3,) point of the thing in the world that the palm comes to;
    ``from_wrist``: (3,) the same point seen from the palm's frame when the palm almost touches; ``turn``: the palm's
    quaternion; ``postures``: ``open`` and ``closed`` in degrees; ``aside``: (3,) where the hand waits, from its
    place at the thing, in the world.
    """

    scene: Path
    seed: int
    grasped: tuple[float, float, float]
    from_wrist: tuple[float, float, float]
    turn: np.ndarray
    postures: dict[str, dict[str, float]]
    aside: tuple[float, float, float]
    note: str


def bent(thumb: tuple[float, ...], **fingers: tuple[float, float, float]) -> dict[str, float]:
    """A posture in degrees: the thumb's four joints, and MCP, PIP, DIP of every finger."""
    joints = ("thumb_cmc_abd", "thumb_cmc_flex", "thumb_mcp_flex", "thumb_ip_flex")
    posture = {"wrist_flex": -8.0, "wrist_dev": 4.0, "index_mcp_abd": 3.0, "ring_mcp_abd": 2.0, "little_mcp_abd": 4.0}
    for finger in FINGERS:
        for joint, angle in zip(("mcp", "pip", "dip"), fingers[finger], strict=True):
            posture[f"{finger}_{joint}_flex"] = angle
    return posture | dict(zip(joints, thumb, strict=True))


FINGER_KEYS = [
    (0.0, "open"), (2.2, "open"), (3.2, "closed"), (5.0, "closed"), (5.9, "open"), (6.3, "open"), (7.1, "closed"),
    (9.2, "closed"), (10.0, "open"),
]  # fmt: skip
# how far the palm is from touching, along its normal (m); below zero it is pressed in
GAP_KEYS = [
    (0.0, 0.16), (0.6, 0.16), (2.2, 0.001), (5.0, 0.001), (5.9, 0.002), (7.1, 0.002), (7.8, -0.006), (8.8, -0.006),
    (9.4, 0.002), (10.0, 0.003), (11.6, 0.17),
]  # fmt: skip


def grip(what: Grip) -> Recording:
    """The recording of a grip, ready to be written."""
    t = np.arange(FRAMES) / RATE
    restless = Restless(what.seed, t)
    near = through(t, [(1.2, 0.0), (2.2, 1.0), (10.0, 1.0), (11.0, 0.0)])
    hand = load_hand()
    angles = glove(hand, restless, FINGER_KEYS, 1.0 - 0.75 * near, what.postures)
    links = hand.forward(angles, FRAMES)
    turns = unsteady(restless, np.tile(what.turn, (FRAMES, 1)), 0.3)

    held = np.tile(np.array(what.from_wrist), (FRAMES, 1))
    held[:, 2] -= through(t, GAP_KEYS)
    reach = np.einsum("nij,nj->ni", transforms(np.zeros((FRAMES, 3)), turns)[:, :3, :3], held)
    sway = restless.drift(0.004) * (1.0 - 0.9 * near)[:, None] + restless.tremor(0.0001)
    palm = np.array(what.grasped) - reach + (1.0 - near)[:, None] * np.array(what.aside) + sway
    poses = {WRIST_TOPIC: tracker(transforms(palm, turns), links, what.scene)}
    return Recording(RATE, poses, {GLOVE_TOPIC: angles}, what.note)
