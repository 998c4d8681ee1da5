"""A log and a scene small enough to replay in a test, and the command line run in this process or in one of its own."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from mcap.writer import Writer

FRAMES = 60
DEEPEST_M = 0.02

SCENE = """
[scene]
name = "press"

[[object]]
name = "table"
class = "fixed"
box = [1.0, 1.0, 0.1]
position = [0.0, 0.0, -0.05]
material = "wood"

[[object]]
name = "finger"
class = "driven"
sphere = 0.05
topic = "/tracker/finger"
material = "human"
mass = 0.4
"""


@dataclass(frozen=True)
class Case:
    """A sphere of 5 cm that goes 2 cm deep into a table and comes out again, in 60 frames of 1/60 s."""

    folder: Path
    log: Path
    scene: Path


def write_log(path: Path, frames: int = FRAMES, topic: str = "/tracker/finger") -> None:
    """Write poses of the sphere as JSON messages of Foxglove's shape."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("foxglove.PoseInFrame", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel(topic, "json", schema)
        for frame in range(frames):
            ns = 1_000_000_000 + round(frame * 1e9 / 60)
            height = 0.05 + DEEPEST_M * math.cos(2.0 * math.pi * frame / (frames - 1))
            message = {
                "timestamp": {"sec": ns // 10**9, "nsec": ns % 10**9},
                "frame_id": "world",
                "pose": {
                    "position": {"x": 0.001 * frame, "y": 0.0, "z": height},
                    "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
                },
            }
            writer.add_message(channel, ns, json.dumps(message).encode(), ns, frame)
        writer.finish()


def command_line(*words: object, code: str = "", **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the command line in a process of its own; `code` runs there before it."""
    script = f"import sys\nfrom geomphys_cli.main import main\n{code}\nmain()"
    return subprocess.run(
        [sys.executable, "-c", script, *map(str, words)],
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "NO_COLOR": "1", **environment},
    )
