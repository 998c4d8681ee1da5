"""The right arm of a standing person swings into the left one three times, 900 frames at 60 Hz.

Both forearms are held ahead. The right one is turned inwards and goes 1 to 4 cm into the left forearm and hand.
"""

from __future__ import annotations

import numpy as np
from body_motion import JOINTS_TOPIC, PELVIS_TOPIC, load_body, moved, pelvis
from mcap_files import Recording
from motion import Restless

FRAMES = 900
RATE = 60.0

STANDING = {"right_elbow": 12.0, "left_elbow": 14.0, "right_shoulder_y": 4.0, "left_shoulder_y": 3.0, "neck_y": 4.0}
LEFT_AHEAD = {
    "left_shoulder_y": 20.0,
    "left_shoulder_x": -4.0,
    "left_shoulder_z": 58.0,
    "left_elbow": 84.0,
    "left_wrist_z": 10.0,
    "neck_y": 14.0,
}


def right_arm(y: float, x: float, z: float, elbow: float, neck: float, waist: float) -> dict[str, float]:
    """The left arm ahead; degrees of the right shoulder (raised, sideways, turned in), its elbow, and the trunk."""
    arm = {"right_shoulder_y": y, "right_shoulder_x": x, "right_shoulder_z": z, "right_elbow": elbow}
    return LEFT_AHEAD | arm | {"neck_z": neck, "waist_z": waist}


POSTURES: dict[str, dict[str, float]] = {
    "standing": STANDING,
    "ready": right_arm(22, 10, -20, 88, neck=-8, waist=-6),
    "swing": right_arm(26, 0, 37, 84, neck=4, waist=0),
    "high": right_arm(48, 22, -10, 84, neck=-4, waist=-4),
    "chop": right_arm(28, 2, 33, 78, neck=4, waist=2),
    "push": right_arm(26, -1, 42, 84, neck=6, waist=3),
}
KEYS = [
    (0.0, "standing"), (0.8, "standing"), (2.0, "ready"), (2.4, "ready"), (3.2, "swing"), (4.0, "swing"),
    (4.9, "ready"), (5.2, "ready"), (6.0, "high"), (6.8, "chop"), (7.6, "chop"), (8.4, "high"), (9.0, "ready"),
    (9.4, "ready"), (10.6, "push"), (12.0, "push"), (13.0, "ready"), (14.4, "standing"),
]  # fmt: skip


def make() -> Recording:
    """The recording, ready to be written."""
    restless = Restless(20044, np.arange(FRAMES) / RATE)
    angles = moved(load_body(), restless, POSTURES, KEYS)
    note = "two arms: the right arm swings into the left"
    return Recording(RATE, {PELVIS_TOPIC: pelvis(restless)}, {JOINTS_TOPIC: angles}, note)
