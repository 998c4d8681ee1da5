"""A hand closes on a mug from the side, 720 frames at 60 Hz; fingers are recorded up to 15 mm in its wall."""

from __future__ import annotations

from hand_grip import Grip, bent, grip
from hand_motion import ASSETS
from mcap_files import Recording
from turns import euler

OPEN, STRAIGHT = (18.0, -14.0, 4.0, 4.0), (10.0, 12.0, 8.0)
POSTURES = {
    "open": bent(OPEN, index=STRAIGHT, middle=STRAIGHT, ring=STRAIGHT, little=STRAIGHT),
    "closed": bent((20, 9, 36, 34), index=(36, 48, 22), middle=(38, 52, 26), ring=(33, 48, 20), little=(27, 38, 13)),
}


def make() -> Recording:
    """The recording, ready to be written."""
    what = Grip(
        scene=ASSETS / "scenes" / "hand_mug.toml",
        seed=20046,
        grasped=(0.0, 0.0, 0.795),
        from_wrist=(0.088, 0.0, -0.053),
        turn=euler(90, 0, 90),
        postures=POSTURES,
        aside=(0.02, -0.05, 0.03),
        note="hand and mug: fingers and thumb close on a mug",
    )
    return grip(what)
