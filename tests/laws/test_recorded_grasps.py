"""Real hands that closed round a door handle carry a rod of its size, where `squeeze` makes up for what a glove does not record.

The handle is a bar of 4 cm; hand and handle moved by half a metre together. A free rod stands in for it, from the moment at
which the hand has closed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.config import Config
from geomphys.load import load_world
from geomphys.replays import replay
from tests.laws.replayed import Run, thing

CLOSED = {
    1: (99, 288),
    6: (117, 225),
    9: (66, 201),
    12: (75, 180),
}  # recording -> frames in which the hand is round the handle
RADIUS, LENGTH, MASS = 0.02, 0.2, 0.1  # m, m, kg
IN_LATCH = (0.1, -0.15, 0.0)  # m, the middle of the handle's bar in the frame of the latch; the bar is along x
FINGERS = {"first": "ffdistal", "middle": "mfdistal", "ring": "rfdistal", "little": "lfdistal", "thumb": "thdistal"}
FRICTION = '[[material_pair]]\nmaterials = ["human", "cork"]\nrestitution = 0.0\nfriction = 0.8\n'


def handle_poses(shared: Path, log: Path, folder: Path) -> np.ndarray:
    """(N, 7) poses of the handle's bar in every frame, its axis along z."""
    door = thing("door", "fixed", urdf=str(shared / "models" / "adroit" / "door.urdf"), topic="/scene/door/frame")
    door += 'joints = { topic = "/scene/door/joint_states" }\n'
    (folder / "door.toml").write_text(f'[scene]\nname = "door"\n{door}')
    world = load_world(folder / "door.toml")
    latch = world.body_names.index("door/latch")
    poses = np.array([r.recorded[latch] for r in replay(log, world, config=Config(clock="/scene/door/joint_states"))])
    turns = Rotation.from_quat(poses[:, 3:])
    along = turns * Rotation.from_euler("y", 90, degrees=True)
    return np.hstack([poses[:, :3] + turns.apply(IN_LATCH), along.as_quat()])


def farthest_off(shared: Path, folder: Path, recording: int, squeeze: float) -> float:
    """How far the rod is from where the handle was recorded when the hand is about to open [m]."""
    (log,) = (shared / "recordings").glob(f"adroit_door_{recording:02d}_*.mcap")
    first, last = CLOSED[recording]
    handle = handle_poses(shared, log, folder)
    urdf = shared / "models" / "adroit" / "adroit_hand.urdf"
    chains = "".join(
        f'[[avatar.chain]]\nname = "{name}"\nbase = "palm"\ntip = "{tip}"\n' for name, tip in FINGERS.items()
    )
    hand = (
        f'[[avatar]]\nname = "hand"\nurdf = "{urdf}"\nmode = "chains"\nmaterial = "human"\n'
        f'root = {{ topic = "/tracker/wrist" }}\njoints = {{ topic = "/glove/joint_states" }}\nsqueeze = {squeeze}\n'
        f"coupling = {{ stiffness = 1000.0, damping = 40.0 }}\n{chains}"
    )
    pose = handle[first]
    rod = thing("rod", capsule=(RADIUS, LENGTH), mass=MASS, material="cork", position=pose[:3], orientation=pose[3:])
    (folder / "rod.toml").write_text(f'[scene]\nname = "rod"\n{FRICTION}{hand}{rod}')
    world = load_world(folder / "rod.toml")
    run = Run(world, list(replay(log, world, config=Config(start=0.01 * first, end=0.01 * last))))
    return float(np.linalg.norm(run.path("rod")[-1, :3] - handle[last, :3]))


@pytest.mark.parametrize("recording", CLOSED)
def test_with_squeeze_the_hand_carries_what_it_was_recorded_round(
    shared_dir: Path, tmp_path: Path, recording: int
) -> None:
    assert farthest_off(shared_dir, tmp_path, recording, 0.01) < 0.045


def test_without_it_the_rod_falls(shared_dir: Path, tmp_path: Path) -> None:
    """As recorded some two links touch the handle, by a millimetre: by a linear program over friction cones, too little."""
    assert farthest_off(shared_dir, tmp_path, 9, 0.0) > 1.0
