"""Finds the files of the recorded experiments and decodes their frames."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geomphys.config import Config
from geomphys.engine.frame_buffer import FRAMES
from geomphys.errors import ConfigError
from geomphys.load import load_world
from geomphys.recording.frames import FrameSource
from geomphys.results import Frame
from geomphys.scene.world import World

Floats = NDArray[np.float64]

BUNDLED_EXPERIMENTS = {
    "gallery": ("recordings/gallery_hand.mcap", "assets/scenes/gallery.toml"),
    "wall_slide": ("recordings/wall_slide.mcap", "assets/scenes/wall_slide.toml"),
    "finger_snip": ("recordings/finger_snip.mcap", "assets/scenes/finger_snip.toml"),
    "two_arms": ("recordings/two_arms.mcap", "assets/scenes/two_arms.toml"),
    "avatar_box": ("recordings/avatar_box.mcap", "assets/scenes/avatar_box.toml"),
    "hand_mug": ("recordings/hand_mug.mcap", "assets/scenes/hand_mug.toml"),
    "hand_ball": ("recordings/hand_ball.mcap", "assets/scenes/hand_ball.toml"),
    "hand_lift": ("recordings/hand_lift.mcap", "assets/scenes/hand_lift.toml"),
    "mug_lift": ("recordings/mug_lift.mcap", "assets/scenes/mug_lift.toml"),
    "two_hands": ("recordings/two_hands.mcap", "assets/scenes/two_hands.toml"),
    "gripper_cube": ("recordings/gripper_cube.mcap", "assets/scenes/gripper_cube.toml"),
}
"""Name -> log and scene in the checkout."""

SHARED_EXPERIMENTS = {
    "door": ("recordings/adroit_door_00_ros2.mcap", "checks/scenes/door_rigid.toml"),
    "door_chains": ("recordings/adroit_door_00_ros2.mcap", "checks/scenes/door_chains.toml"),
    "table_grab": ("recordings/leap_grab_protobuf.mcap", "checks/scenes/table_grab.toml"),
    "table_pinch": ("recordings/leap_pinch_57fps_json.mcap", "checks/scenes/table_pinch.toml"),
    "claps": ("recordings/leap_three_claps_ros2.mcap", "checks/scenes/claps_rigid.toml"),
}
"""Name -> log and scene in the folder of real recordings: $GEOMPHYS_SHARED, or `shared` beside the checkout."""

GRIPS = ("hand_lift", "mug_lift", "two_hands", "gripper_cube")
"""Experiments in which driven bodies grip a simulated one: peers hold the driven bodies by the virtual coupling."""

NAMES = (*BUNDLED_EXPERIMENTS, *SHARED_EXPERIMENTS)


@dataclass(frozen=True, kw_only=True)
class ExperimentFiles:
    """Files of an experiment."""

    name: str
    log: Path
    scene: Path

    @property
    def exists(self) -> bool:
        """Whether both are there."""
        return self.log.exists() and self.scene.exists()


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A world and the decoded frames to replay in it."""

    name: str
    world: World
    frames: list[Frame]
    decode_ns: Floats  # (n,) ns a frame took to decode, mean of its batch; empty for frames that were made up


def experiment_files(folder: Path | None, only: Sequence[str]) -> list[ExperimentFiles]:
    """Files of the experiments, in the order of `NAMES`.

    Parameters
    ----------
    folder
        Holds `recordings` and `assets`; None: the folder that holds the package, the root of a checkout.
    only
        Names; empty: all.

    Raises
    ------
    ConfigError
        A name is not among `NAMES`.
    """
    unknown = [name for name in only if name not in NAMES]
    if unknown:
        raise ConfigError(f"experiment = {unknown[0]!r}: expected one of {', '.join(NAMES)}")
    checkout = folder if folder is not None else Path(__file__).resolve().parents[2]
    real = Path(os.environ.get("GEOMPHYS_SHARED", checkout.parent / "shared"))
    rows = [(name, checkout, files) for name, files in BUNDLED_EXPERIMENTS.items()] + [
        (name, real, files) for name, files in SHARED_EXPERIMENTS.items()
    ]
    return [
        ExperimentFiles(name=name, log=root / log, scene=root / scene)
        for name, root, (log, scene) in rows
        if not only or name in only
    ]


def load_experiment(files: ExperimentFiles, config: Config) -> Experiment:
    """Read the scene and decode the whole log.

    Raises
    ------
    InputError
        The log, the scene or a model is wrong.
    """
    world = load_world(files.scene, mode=config.mode, seed=config.seed)
    frames: list[Frame] = []
    times: list[float] = []
    with FrameSource(files.log, world, config) as source:
        frames_left = iter(source)
        while True:
            start = time.perf_counter_ns()
            batch = [frame for _, frame in zip(range(FRAMES), frames_left, strict=False)]
            if not batch:
                break
            times += [(time.perf_counter_ns() - start) / len(batch)] * len(batch)
            frames += batch
    return Experiment(name=files.name, world=world, frames=frames, decode_ns=np.array(times))
