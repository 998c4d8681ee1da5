"""A hand closes on a ball from above, 720 frames at 60 Hz; fingertips and palm are recorded up to 15 mm in it."""

from __future__ import annotations

from hand_grip import Grip, bent, grip
from hand_motion import ASSETS
from mcap_files import Recording
from turns import euler

OPEN, STRAIGHT = (14.0, -12.0, 6.0, 6.0), (14.0, 16.0, 10.0)
POSTURES = {
    "open": bent(OPEN, index=STRAIGHT, middle=STRAIGHT, ring=STRAIGHT, little=STRAIGHT),
    "closed": bent((26, 13, 47, 58), index=(47, 60, 40), middle=(45, 54, 38), ring=(42, 52, 34), little=(48, 60, 42)),
}


def make() -> Recording:
    """The recording, ready to be written."""
    what = Grip(
        scene=ASSETS / "scenes" / "hand_ball.toml",
        seed=20047,
        grasped=(0.0, 0.0, 0.836),
        from_wrist=(0.084, 0.004, -0.049),
        turn=euler(90, 0, 0),
        postures=POSTURES,
        aside=(0.05, -0.06, 0.0),
        note="hand and ball: fingers and thumb close on a ball",
    )
    return grip(what)
