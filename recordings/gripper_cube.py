"""A hand-held gripper takes a cube, lifts it, turns it, carries it 30 cm to the side and sets it down; 600 frames at 60 Hz."""

from __future__ import annotations

import numpy as np
from hand_motion import unsteady
from mcap_files import Recording
from motion import Restless, through, turned_through
from turns import euler

FRAMES = 600
RATE = 60.0
TOPIC, JOINT_TOPIC = "/tracker/gripper", "/gripper/joint_states"
GRIP_POINT = 0.075  # m, below the palm
TABLE_TOP, HALF = 0.74, 0.02  # m
OPEN, CLOSED = 0.005, 0.051 - 0.006 - HALF + 0.006  # m: closed, each jaw is commanded 6 mm into the cube

CLOSE_KEYS = [(0.0, OPEN), (1.8, OPEN), (2.4, CLOSED), (8.3, CLOSED), (8.8, OPEN), (10.0, OPEN)]
HEIGHT_KEYS = [
    (0.0, 0.15),
    (0.4, 0.15),
    (1.7, 0.0),
    (2.8, 0.0),
    (3.8, 0.2),
    (6.8, 0.2),
    (8.0, 0.002),
    (8.9, 0.002),
    (9.8, 0.15),
]
SIDE_KEYS = [(0.0, 0.0), (5.2, 0.0), (6.2, 0.3), (10.0, 0.3)]
UPRIGHT, TURNED = euler(0, 0, 0), euler(30, 40, 20)
TURN_KEYS = [(0.0, UPRIGHT), (3.8, UPRIGHT), (4.8, TURNED), (5.4, TURNED), (6.6, UPRIGHT), (10.0, UPRIGHT)]


def make() -> Recording:
    """The recording, ready to be written."""
    t = np.arange(FRAMES) / RATE
    restless = Restless(20052, t)
    turns = unsteady(restless, turned_through(t, TURN_KEYS), 0.3)
    grip = np.zeros((FRAMES, 3)) + restless.tremor(0.0001)
    grip[:, 0] += through(t, SIDE_KEYS)
    grip[:, 2] += TABLE_TOP + HALF + 0.002 + through(t, HEIGHT_KEYS)
    x, y, z, w = turns.T
    up = np.stack([2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)], axis=1)
    closed = through(t, CLOSE_KEYS) + np.abs(restless.wander(1e-5, 2.0, 5.0))
    return Recording(
        RATE, {TOPIC: (grip + GRIP_POINT * up, turns)}, {JOINT_TOPIC: {"close": closed}},
        "gripper and cube: lifts it, turns it, carries it to the side, sets it down",
    )  # fmt: skip
