"""A glove that drives a robot hand, recorded with y up and a tilted tracker, 240 frames at 60 Hz.

The hand goes down on a table, palm first, presses on it, and is lifted again. What makes it hard is how it was recorded: in
the space of an optical system (y up), with the tracker tilted on the back of the hand, with the glove's own joint names, in
degrees, and with a finger that the robot does not have.
"""

from __future__ import annotations

import numpy as np
from mcap_files import Recording
from motion import Restless, through
from turns import euler, inverse, quaternions, transforms

FRAMES = 240
RATE = 60.0
TABLE_TOP = 0.75
TRACKER_TOPIC = "/optitrack/right_hand"
GLOVE_TOPIC = "/glove/joint_states"
TRACKER = np.array([0.03, 0.0, 0.035])  # of the tracker, seen from the wrist
TILT = 25.0  # degrees, the tracker's pitch against the palm
SPREAD, STRETCH = 4.0, (18.0, 22.0, 12.0)  # degrees, of a relaxed finger

HEIGHT_KEYS = [(0.0, 0.16), (0.5, 0.15), (1.6, 0.004), (2.4, 0.002), (3.5, 0.17)]
BEND_KEYS = [(0.0, 2.2), (1.5, 0.6), (2.5, 0.5), (3.6, 2.6)]


def make() -> Recording:
    """The recording, ready to be written."""
    t = np.arange(FRAMES) / RATE
    restless = Restless(20051, t)
    sway = restless.drift(0.01) + restless.tremor(0.0001)
    palm = np.empty((FRAMES, 3))
    palm[:, 0] = 0.1 + through(t, [(0.0, 0.0), (3.9, 0.22)]) + sway[:, 0]
    palm[:, 1] = through(t, [(0.0, -0.3), (3.9, 0.3)]) + sway[:, 1]
    palm[:, 2] = TABLE_TOP + through(t, HEIGHT_KEYS) + 0.1 * sway[:, 2]
    level = np.tile(euler(20, 0, 0), (FRAMES, 1))
    tracker_on_palm = transforms(TRACKER[None], euler(0, TILT, 0)[None])
    world_from_tracker = transforms(palm, level) @ tracker_on_palm
    space_from_world = inverse(transforms(np.zeros((1, 3)), euler(0, 0, 90)[None]))
    tracked = space_from_world @ world_from_tracker

    bend = through(t, BEND_KEYS)
    angles = {}
    for k, finger in enumerate(("Thumb", "Index", "Middle", "Ring", "Pinky")):
        angles[f"{finger}MCPSpread"] = SPREAD * (1.5 - 0.7 * k) + restless.wander(0.5, 0.1, 0.7)
        for segment, stretch in zip(("MCP", "PIP", "DIP"), STRETCH, strict=True):
            share = 0.5 if finger == "Thumb" else 1.0
            angles[f"{finger}{segment}Stretch"] = share * stretch * bend + k + restless.wander(0.8, 0.1, 0.7)
    poses = {TRACKER_TOPIC: (tracked[:, :3, 3], quaternions(tracked))}
    return Recording(
        RATE, poses, {GLOVE_TOPIC: angles}, "robot glove: y up, a tilted tracker, a glove's names in degrees"
    )
