"""A hand takes a mug by its handle, lifts it by 20 cm, carries it 25 cm and sets it down; 750 frames at 60 Hz.

Forefinger and middle finger go straight through the handle and curl round its bar, the thumb presses on it from outside.
"""

from __future__ import annotations

import numpy as np
from hand_grip import bent
from hand_motion import ASSETS, GLOVE_TOPIC, WRIST_TOPIC, glove, load_hand, tracker, unsteady
from mcap_files import Recording
from motion import Restless, through, turned_through
from turns import euler, transforms

FRAMES = 750
RATE = 60.0
SCENE = ASSETS / "scenes" / "mug_lift.toml"
MUG = (0.0, 0.0, 0.79)  # m, where the middle of its bottom rests
# the palm from there when straight fingers are through the handle, their backs towards the wall of the mug
THROUGH, TURN_THROUGH = (0.0577, 0.1190, 0.0316), euler(-92.1, 1.7, 83.9)  # m
# and when they press its bar: there forces that the mug's weight and the springs of the joints balance keep it upright
GRIPPING, TURN_GRIPPING = (0.0899, 0.1065, 0.0330), euler(-113.0, -1.6, 79.1)  # m

FIST = (84.0, 80.0, 40.0)  # deg, of the fingers that stay outside
STRAIGHT = (-2.0, 4.0, 3.0)
AWAY = (-20.0, -14.0, 4.0, 4.0)  # of the thumb
POSTURES = {
    "open": bent(AWAY, index=STRAIGHT, middle=STRAIGHT, ring=FIST, little=FIST)
    | {"index_mcp_abd": 0.6, "middle_mcp_abd": 4.4},
    "hooked": bent(AWAY, index=(0.0, 76.0, 70.0), middle=(2.0, 88.0, 70.0), ring=FIST, little=FIST)
    | {"index_mcp_abd": 0.6, "middle_mcp_abd": 4.4},
    "closed": bent(
        (-22.7, -0.1, 20.2, 28.6), index=(18.9, 81.8, 76.9), middle=(13.0, 100.0, 85.9), ring=FIST, little=FIST
    )
    | {"index_mcp_abd": 4.3, "middle_mcp_abd": 3.9},
}

FINGER_KEYS = [
    (0.0, "open"), (1.9, "open"), (2.6, "hooked"), (3.3, "closed"), (10.0, "closed"), (10.5, "hooked"), (11.1, "open"),
]  # fmt: skip
PALM_KEYS = [(0.0, THROUGH), (2.2, THROUGH), (3.2, GRIPPING), (10.0, GRIPPING), (10.7, THROUGH)]
TURN_KEYS = [
    (0.0, TURN_THROUGH), (2.2, TURN_THROUGH), (3.2, TURN_GRIPPING), (10.0, TURN_GRIPPING), (10.7, TURN_THROUGH),
]  # fmt: skip
BESIDE_KEYS = [(0.0, 0.17), (0.4, 0.17), (1.8, 0.0), (11.1, 0.0), (12.2, 0.17)]  # m, along the hole of the handle
LIFT_KEYS = [(0.0, 0.0), (3.4, 0.0), (4.6, 0.203), (8.5, 0.203), (9.7, -0.003), (12.5, -0.003)]
CARRY_KEYS = [(0.0, 0.0), (6.6, 0.0), (7.8, -0.25), (12.5, -0.25)]  # m, along y


def make() -> Recording:
    """The recording, ready to be written."""
    t = np.arange(FRAMES) / RATE
    restless = Restless(20071, t)
    near = through(t, [(0.4, 0.0), (1.4, 1.0), (11.2, 1.0), (12.2, 0.0)])
    hand = load_hand()
    angles = glove(hand, restless, FINGER_KEYS, 1.0 - 0.95 * near, POSTURES)
    links = hand.forward(angles, FRAMES)
    turns = unsteady(restless, turned_through(t, TURN_KEYS), 0.3)
    sway = restless.drift(0.004) * (1.0 - 0.95 * near)[:, None] + restless.tremor(0.0001)
    palm = np.add(MUG, through(t, PALM_KEYS)) + sway
    palm[:, 1] += through(t, BESIDE_KEYS) + through(t, CARRY_KEYS)
    palm[:, 2] += through(t, LIFT_KEYS)
    poses = {WRIST_TOPIC: tracker(transforms(palm, turns), links, SCENE)}
    return Recording(
        RATE, poses, {GLOVE_TOPIC: angles}, "hand and mug: lifts it by its handle, carries it, sets it down"
    )
