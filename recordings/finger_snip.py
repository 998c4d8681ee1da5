"""A finger snips a ball off a table, 960 frames at 120 Hz.

The hand comes down over the table, curls its forefinger, and straightens it within 70 ms: the fingertip, at up to
1.5 m/s, hits a ball of 2 cm radius, which rolls off the edge. The hand stays where it is for a moment and goes away.
"""

from __future__ import annotations

import tomllib

import numpy as np
from hand_motion import ASSETS, GLOVE_TOPIC, WRIST_TOPIC, glove, load_hand, palm_links, tracker, turned, unsteady
from mcap_files import Recording
from motion import Restless, softened, through, turned_through
from turns import euler, transforms

FRAMES = 960
RATE = 120.0
SCENE = ASSETS / "scenes" / "finger_snip.toml"
TABLE_TOP = 0.74
SNIP = 3.0  # s, the flick begins
BALL_FROM_WRIST = np.array([-0.042, 0.140])  # where the ball lies, seen from the wrist of the waiting hand

AWAY = euler(80, 0, 25)
WAITING = euler(90, 8, 0)

FINGER_KEYS = [
    (0.0, "relaxed"), (1.0, "relaxed"), (2.2, "cocked"), (SNIP, "cocked"), (SNIP + 0.07, "flicked"),
    (4.0, "flicked"), (5.2, "relaxed"),
]  # fmt: skip
PLACE_KEYS = [
    (0.0, (0.16, -0.24)), (0.6, (0.15, -0.22)), (2.2, (0.0, 0.0)), (3.6, (0.0, 0.0)), (5.0, (0.12, -0.20)),
    (8.0, (0.15, -0.23)),
]  # fmt: skip
HEIGHT_KEYS = [(0.0, 0.16), (0.8, 0.15), (2.3, 0.005), (3.6, 0.005), (4.8, 0.14), (8.0, 0.17)]
TURN_KEYS = [(0.0, AWAY), (0.8, AWAY), (2.2, WAITING), (3.6, WAITING), (5.2, AWAY)]


def make() -> Recording:
    """The recording, ready to be written."""
    t = np.arange(FRAMES) / RATE
    restless = Restless(20043, t)
    still = through(t, [(1.4, 0.0), (2.2, 1.0), (3.6, 1.0), (4.4, 0.0)])
    hand = load_hand()
    angles = glove(hand, restless, FINGER_KEYS, 1.0 - 0.85 * still)
    links = hand.forward(angles, FRAMES)
    turns = unsteady(restless, turned_through(t, TURN_KEYS), 0.5)

    reach = softened(hand.lowest(turned(palm_links(links), turns)), 0.15 * RATE)
    sway = restless.drift(0.004) * (1.0 - 0.9 * still)[:, None] + restless.tremor(0.0001)
    ball = next(o for o in tomllib.loads(SCENE.read_text(encoding="utf-8"))["object"] if o["name"] == "ball")
    palm = np.empty((FRAMES, 3))
    palm[:, :2] = np.array(ball["position"][:2]) - BALL_FROM_WRIST + through(t, PLACE_KEYS) + sway[:, :2]
    palm[:, 2] = TABLE_TOP + through(t, HEIGHT_KEYS) - reach + 0.35 * sway[:, 2]

    poses = {WRIST_TOPIC: tracker(transforms(palm, turns), links, SCENE)}
    return Recording(RATE, poses, {GLOVE_TOPIC: angles}, "finger snip: the forefinger flicks a ball off a table")
