"""A standing person reaches into a box twice, 960 frames at 120 Hz.

First the right hand goes up to 8 cm into its front, then hand and forearm sink up to 7 cm into its top.
"""

from __future__ import annotations

import numpy as np
from body_motion import JOINTS_TOPIC, PELVIS_TOPIC, load_body, moved, pelvis
from mcap_files import Recording
from motion import Restless, through

FRAMES = 960
RATE = 120.0

POSTURES: dict[str, dict[str, float]] = {
    "standing": {"right_elbow": 12, "left_elbow": 14, "right_shoulder_y": 4, "left_shoulder_y": 3, "neck_y": 4},
    "ready": {"right_shoulder_y": -16, "right_elbow": 106, "left_elbow": 20, "left_shoulder_y": -4, "neck_y": 16},
    "reach": {"right_shoulder_y": 5, "right_elbow": 87, "left_elbow": 16, "neck_y": 16, "waist_y": 2, "waist_z": 6},
    "raised": {"right_shoulder_y": 10, "right_elbow": 132, "left_elbow": 22, "left_shoulder_y": -6, "neck_y": 14},
    "lowered": {"right_shoulder_y": -20, "right_elbow": 70, "left_elbow": 18, "neck_y": 8},
    "over": {"right_shoulder_y": 66, "right_elbow": 72, "left_elbow": 22, "neck_y": 14, "waist_y": 0},
    "lean": {"right_shoulder_y": 62, "right_elbow": 22, "left_elbow": 22, "neck_y": 18, "waist_y": 6, "waist_z": 4},
}
KEYS = [
    (0.0, "standing"), (0.5, "standing"), (0.9, "lowered"), (1.3, "ready"), (2.0, "reach"), (2.9, "reach"),
    (3.5, "ready"), (4.0, "raised"), (4.6, "over"), (5.3, "lean"), (6.1, "lean"), (6.7, "over"),
    (7.1, "raised"), (7.5, "lowered"), (7.95, "standing"),
]  # fmt: skip


def make() -> Recording:
    """The recording, ready to be written."""
    restless = Restless(20045, np.arange(FRAMES) / RATE)
    angles = moved(load_body(), restless, POSTURES, KEYS)
    ahead = through(restless.t, [(0.0, 0.0), (4.2, 0.0), (5.2, 0.015), (6.4, 0.015), (7.4, 0.0)])
    note = "avatar and box: the right arm reaches into a box"
    return Recording(RATE, {PELVIS_TOPIC: pelvis(restless, ahead)}, {JOINTS_TOPIC: angles}, note)
