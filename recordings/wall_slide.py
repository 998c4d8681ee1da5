"""A hand slides along a wall into a corner and along the next wall, 1,500 frames at 60 Hz.

The palm faces the wall, fingers up and a little aside. It is recorded 5 to 20 mm deep in the first wall, is drawn past
the corner, where it is in both walls, and goes on along the second wall.
"""

from __future__ import annotations

import numpy as np
from hand_motion import ASSETS, GLOVE_TOPIC, WRIST_TOPIC, glove, load_hand, palm_links, tracker, turned, unsteady
from mcap_files import Recording
from motion import Restless, softened, through, turned_through
from turns import euler, product, transforms

FRAMES = 1500
RATE = 60.0
SCENE = ASSETS / "scenes" / "wall_slide.toml"
NORTH = 1.0  # y of the first wall's face; the second wall's face is at x = EAST
EAST = 0.8

# fingers up and the palm to the north, then the same to the east
TO_NORTH = product(euler(90, 0, 0), euler(0, -90, 0))
LEAN_NORTH = product(TO_NORTH, euler(-35, 0, 0))
TO_EAST = product(euler(0, 0, 0), euler(0, -90, 0))
LEAN_EAST = product(TO_EAST, euler(-25, 0, 0))

FINGER_KEYS = [
    (0.0, "relaxed"), (2.0, "flat"), (8.0, "flat"), (10.0, "open"), (12.0, "flat"), (20.5, "flat"), (22.5, "relaxed"),
]  # fmt: skip
TURN_KEYS = [
    (0.0, TO_NORTH), (2.5, LEAN_NORTH), (9.0, LEAN_NORTH), (12.5, LEAN_EAST), (20.0, LEAN_EAST), (22.5, TO_EAST),
]  # fmt: skip
# distance of the hand's nearest point from each face (m): below zero it is in the wall
NORTH_KEYS = [
    (0.0, 0.25), (1.5, 0.20), (3.4, -0.010), (6.0, -0.016), (8.5, -0.009), (10.0, -0.012), (12.0, -0.015),
    (13.2, -0.006), (14.6, 0.10), (16.5, 0.30), (19.0, 0.50), (21.0, 0.55), (24.0, 0.50),
]  # fmt: skip
EAST_KEYS = [
    (0.0, 0.95), (3.2, 0.90), (9.8, 0.02), (11.4, -0.010), (13.5, -0.016), (16.0, -0.009), (18.5, -0.015),
    (20.4, -0.012), (22.0, 0.12), (24.5, 0.25),
]  # fmt: skip
# height of the wrist (m)
RISE_KEYS = [
    (0.0, 1.10), (3.0, 1.25), (7.0, 1.40), (10.0, 1.30), (14.0, 1.38), (18.0, 1.22), (21.0, 1.30), (24.5, 1.05),
]  # fmt: skip


def make() -> Recording:
    """The recording, ready to be written."""
    t = np.arange(FRAMES) / RATE
    restless = Restless(20042, t)
    pressed = through(t, [(2.0, 0.0), (3.2, 1.0), (20.4, 1.0), (21.4, 0.0)])
    hand = load_hand()
    angles = glove(hand, restless, FINGER_KEYS, 1.0 - 0.75 * pressed)
    links = hand.forward(angles, FRAMES)
    turns = unsteady(restless, turned_through(t, TURN_KEYS), 0.9)

    placed = turned(palm_links(links), turns)
    sway = restless.drift(0.004) * (1.0 - 0.8 * pressed)[:, None] + restless.tremor(0.00012)
    palm = np.empty((FRAMES, 3))
    for k, face, keys, towards in ((0, EAST, EAST_KEYS, (-1.0, 0.0, 0.0)), (1, NORTH, NORTH_KEYS, (0.0, -1.0, 0.0))):
        reach = softened(-hand.lowest(placed, towards), 0.15 * RATE)
        palm[:, k] = face - through(t, keys) - reach + 0.4 * sway[:, k]
    palm[:, 2] = through(t, RISE_KEYS) + sway[:, 2]

    poses = {WRIST_TOPIC: tracker(transforms(palm, turns), links, SCENE)}
    return Recording(
        RATE, poses, {GLOVE_TOPIC: angles}, "wall slide: along a wall, through its corner, along the next wall"
    )
