"""A hand takes a ball, lifts it by 20 cm, turns it over by 50° and back, and sets it down; 660 frames at 60 Hz."""

from __future__ import annotations

import numpy as np
from hand_ball import POSTURES
from hand_motion import ASSETS, GLOVE_TOPIC, WRIST_TOPIC, glove, load_hand, tracker, unsteady
from mcap_files import Recording
from motion import Restless, through, turned_through
from turns import euler, transforms

FRAMES = 660
RATE = 60.0
SCENE = ASSETS / "scenes" / "hand_lift.toml"
BALL = (0.0, 0.0, 0.836)  # m, where its centre rests
FROM_WRIST = (0.084, 0.004, -0.049)  # m, of the ball's centre in the palm's frame when the palm almost touches

FINGER_KEYS = [(0.0, "open"), (2.0, "open"), (2.9, "closed"), (8.6, "closed"), (9.4, "open"), (11.0, "open")]
# how far the palm is from touching, along its normal (m)
GAP_KEYS = [(0.0, 0.16), (0.4, 0.16), (1.9, 0.001), (9.5, 0.001), (10.8, 0.17)]
LIFT_KEYS = [(0.0, 0.0), (3.3, 0.0), (4.5, 0.2), (7.2, 0.2), (8.3, 0.001), (11.0, 0.001)]
OVER, TURNED = euler(90, 0, 0), euler(40, 0, 20)
TURN_KEYS = [(0.0, OVER), (4.6, OVER), (5.6, TURNED), (6.0, TURNED), (7.0, OVER), (11.0, OVER)]


def make() -> Recording:
    """The recording, ready to be written."""
    t = np.arange(FRAMES) / RATE
    restless = Restless(20051, t)
    near = through(t, [(0.9, 0.0), (1.9, 1.0), (9.6, 1.0), (10.6, 0.0)])
    hand = load_hand()
    angles = glove(hand, restless, FINGER_KEYS, 1.0 - 0.9 * near, POSTURES)
    links = hand.forward(angles, FRAMES)
    turns = unsteady(restless, turned_through(t, TURN_KEYS), 0.3)

    held = np.tile(np.array(FROM_WRIST), (FRAMES, 1))
    held[:, 2] -= through(t, GAP_KEYS)
    reach = np.einsum("nij,nj->ni", transforms(np.zeros((FRAMES, 3)), turns)[:, :3, :3], held)
    sway = restless.drift(0.004) * (1.0 - 0.9 * near)[:, None] + restless.tremor(0.0001)
    palm = np.array(BALL) - reach + (1.0 - near)[:, None] * np.array((0.05, -0.06, 0.0)) + sway
    palm[:, 2] += through(t, LIFT_KEYS)
    poses = {WRIST_TOPIC: tracker(transforms(palm, turns), links, SCENE)}
    return Recording(RATE, poses, {GLOVE_TOPIC: angles}, "hand and ball: lifts it, turns it, sets it down")
