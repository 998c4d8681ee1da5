"""Two people take a box between their right hands, lift it, carry it 30 cm and set it down; 600 frames at 60 Hz."""

from __future__ import annotations

import numpy as np
from hand_motion import ASSETS, GLOVE_TOPIC, WRIST_TOPIC, glove, load_hand, tracker, unsteady
from mcap_files import Recording
from motion import Restless, through
from turns import euler, transforms

FRAMES = 600
RATE = 60.0
SCENE = ASSETS / "scenes" / "two_hands.toml"
BOX = (0.0, 0.0, 0.80)  # m, where its centre rests
HALF = 0.08  # m, of the box between the hands
FROM_WRIST = (0.085, 0.0, -0.0135)  # m, in the palm's frame: what the middle of a side of the box touches
HANDS = {"near": 0.0, "far": 180.0}  # deg about z: the second faces the first

PRESSED = 0.012  # m, so deep palm and fingers are recorded in the box
GAP_KEYS = [(0.0, 0.09), (0.6, 0.09), (1.8, 0.003), (2.5, -PRESSED), (8.4, -PRESSED), (9.0, 0.004), (9.8, 0.09)]
LIFT_KEYS = [(0.0, 0.0), (2.8, 0.0), (4.0, 0.2), (6.9, 0.2), (8.1, 0.001), (10.0, 0.001)]
SIDE_KEYS = [(0.0, 0.0), (4.4, 0.0), (5.6, 0.3), (10.0, 0.3)]


def make() -> Recording:
    """The recording, ready to be written."""
    t = np.arange(FRAMES) / RATE
    hand = load_hand()
    near = through(t, [(0.9, 0.0), (1.8, 1.0), (9.0, 1.0), (9.8, 0.0)])
    poses, joints = {}, {}
    for k, (name, around) in enumerate(HANDS.items()):
        restless = Restless(20060 + k, t)
        angles = glove(hand, restless, [(0.0, "flat")], 1.0 - 0.9 * near)
        links = hand.forward(angles, FRAMES)
        turns = unsteady(restless, np.tile(euler(around, 0, 90), (FRAMES, 1)), 0.3)
        turn = transforms(np.zeros((FRAMES, 3)), turns)[:, :3, :3]
        inwards = np.array([0.0, 1.0, 0.0]) if around == 0.0 else np.array([0.0, -1.0, 0.0])
        reach = np.einsum("nij,j->ni", turn, np.array(FROM_WRIST))
        sway = restless.drift(0.004) * (1.0 - 0.9 * near)[:, None] + restless.tremor(0.0001)
        palm = np.array(BOX) - reach - inwards * (HALF + through(t, GAP_KEYS))[:, None] + sway
        palm[:, 0] += through(t, SIDE_KEYS)
        palm[:, 2] += through(t, LIFT_KEYS)
        poses[f"/{name}{WRIST_TOPIC}"] = tracker(transforms(palm, turns), links, SCENE)
        joints[f"/{name}{GLOVE_TOPIC}"] = angles
    return Recording(RATE, poses, joints, "two hands and a box: lift it, carry it to the side, set it down")
