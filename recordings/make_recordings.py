"""Writes the recordings of this folder; the same messages on every run.

``python recordings/make_recordings.py`` writes into recordings/, ``--out DIR`` into another folder,
``--only gallery_hand`` one of them.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import avatar_box
import finger_snip
import gallery_hand
import gripper_cube
import hand_ball
import hand_lift
import hand_mug
import keypoint_hands
import mcap_files
import mug_lift
import robot_glove
import two_arms
import two_hands
import wall_slide

EXPERIMENTS = {
    "gallery_hand": (gallery_hand.make, "ros2"),
    "wall_slide": (wall_slide.make, "ros2"),
    "finger_snip": (finger_snip.make, "protobuf"),
    "two_arms": (two_arms.make, "json"),
    "avatar_box": (avatar_box.make, "protobuf"),
    "hand_mug": (hand_mug.make, "ros2"),
    "hand_ball": (hand_ball.make, "json"),
    "hand_lift": (hand_lift.make, "protobuf"),
    "mug_lift": (mug_lift.make, "ros2"),
    "gripper_cube": (gripper_cube.make, "ros2"),
    "two_hands": (two_hands.make, "protobuf"),
    "robot_glove": (robot_glove.make, "ros2"),
}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(__file__).resolve().parent, help="folder to write into")
    parser.add_argument(
        "--only", choices=sorted([*EXPERIMENTS, *keypoint_hands.SOURCES]), help="one recording instead of all"
    )
    options = parser.parse_args()
    for name, (make, encoding) in EXPERIMENTS.items():
        if options.only in (None, name):
            path = options.out / f"{name}.mcap"
            mcap_files.write(path, make(), encoding)
            print(f"{name}: {encoding}, {path.stat().st_size / 1e3:.0f} kB")
    for name in keypoint_hands.SOURCES:
        if options.only in (None, name):
            path = keypoint_hands.write(name, options.out / f"{name}.mcap")
            print(f"{name}: json, {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
