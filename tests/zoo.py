"""Any URDF from a log made for it to an audited result, as a user would go: init, check, replay, audit.

The log is written by the formats' own writers from what the URDF says, read without the project: every joint that moves
swings within its limits while the root goes round.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

import geomphys
from geomphys.analysis.audit import audit_output
from geomphys.authoring.scene_draft import draft_scene
from geomphys.load import load_world
from geomphys.recording.check import check_log
from recordings.mcap_files import Recording, write
from tests.cli.press import command_line

RATE = 30.0
COUNT = 20
ROOT, JOINTS = "/tracker/root", "/glove/joint_states"


def swinging(urdf: Path, still: bool = False) -> dict[str, np.ndarray]:
    """Angles (COUNT,) of the joints of a URDF that move on their own: within their limits, or 0 where that lies in them."""
    angles = {}
    for k, joint in enumerate(ElementTree.parse(urdf).getroot().findall("joint")):
        if joint.get("type") not in ("revolute", "continuous", "prismatic") or joint.find("mimic") is not None:
            continue
        limit = joint.find("limit")
        low, high = (-0.5, 0.5) if limit is None else (float(limit.get(end, "0")) for end in ("lower", "upper"))
        if joint.get("type") == "continuous":
            low, high = -0.5, 0.5
        middle, reach = 0.5 * (low + high), 0.0 if still else 0.3 * (high - low)
        if still:
            middle = min(max(0.0, low), high)
        phase = 2.0 * math.pi * np.arange(COUNT) / COUNT + 0.3 * k
        angles[joint.get("name", "")] = middle + reach * np.sin(phase)
    return angles


def made_log(path: Path, urdf: Path, encoding: str = "ros2", still: bool = False) -> Path:
    """A log of `COUNT` frames in which the model's root goes round and its joints swing, or rest."""
    phase = 2.0 * math.pi * np.arange(COUNT) / COUNT
    position = np.stack([0.1 * np.cos(phase), 0.1 * np.sin(phase), 1.0 + 0.02 * np.sin(phase)], axis=1)
    quaternion = np.stack([np.zeros(COUNT), np.zeros(COUNT), np.sin(0.1 * phase), np.cos(0.1 * phase)], axis=1)
    angles = swinging(urdf, still)
    write(path, Recording(RATE, {ROOT: (position, quaternion)}, {JOINTS: angles} if angles else {}, "made"), encoding)
    return path


@dataclass(frozen=True)
class Outcome:
    """What the four commands said."""

    scene: str
    check: dict[str, Any]
    replay: dict[str, Any]
    audit: dict[str, Any]
    out: Path


def through_all(urdf: Path, folder: Path) -> Outcome:
    """Go the whole way with a URDF, in this process; the check must find no error."""
    log, scene, out = made_log(folder / "made.mcap", urdf), folder / "made.toml", folder / "made_out.mcap"
    draft_scene(log, [urdf], folder=folder).write(scene)
    world = load_world(scene)
    report = check_log(log, world)
    assert not report.errors, report.errors
    summary = geomphys.run(log, world, out=out)
    audit = audit_output(out)
    said = (json.loads(json.dumps(part.as_dict())) for part in (report, summary, audit))
    return Outcome(scene.read_text(), *said, out)


def through_commands(urdf: Path, folder: Path) -> Outcome:
    """The same by the command line; each command must end well."""
    log, scene, out = made_log(folder / "made.mcap", urdf), folder / "made.toml", folder / "made_out.mcap"
    said = []
    for words in (
        ("init", log, "--urdf", urdf, "-o", scene),
        ("check", log, "-s", scene, "--json"),
        ("replay", log, "-s", scene, "-o", out, "--json"),
        ("audit", out, "--json"),
    ):
        done = command_line(*words)
        assert done.returncode == 0, f"{words[0]} of {urdf}: {done.stdout[-600:]}{done.stderr[-600:]}"
        assert "Traceback" not in done.stderr
        said.append(done.stdout)
    return Outcome(scene.read_text(), *(json.loads(text) for text in said[1:]), out)
