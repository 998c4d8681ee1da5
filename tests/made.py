"""Small results of real replays, made once: a sphere pressed into a table, and a recorded hand that comes down on one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import geomphys
from tests.cli.press import SCENE, write_log

RAISED_M = 0.001
WINDOW = geomphys.Config(start=32.7, end=33.9)
"""Where the hand of the gallery comes down on the table."""


@dataclass(frozen=True)
class Results:
    """Results of one log in a scene, and in the same scene with the table raised by 1 mm."""

    log: Path
    scene: Path
    out: Path
    raised_scene: Path
    raised: Path


def make_pressed(folder: Path) -> Results:
    """A sphere of 5 cm that goes 2 cm deep into a table, 60 frames."""
    log = folder / "press.mcap"
    write_log(log)
    return _made(
        folder, log, SCENE, ("position = [0.0, 0.0, -0.05]", "position = [0.0, 0.0, -0.049]"), geomphys.Config()
    )


def make_landed(folder: Path, root: Path) -> Results:
    """The hand of the gallery, 73 frames."""
    text = (root / "assets" / "scenes" / "gallery.toml").read_text().replace('"../', f'"{root / "assets"}/')
    change = ("position = [2.0, 1.5, 0.0]", "position = [2.0, 1.5, 0.001]")
    return _made(folder, root / "recordings" / "gallery_hand.mcap", text, change, WINDOW)


def _made(folder: Path, log: Path, text: str, change: tuple[str, str], config: geomphys.Config) -> Results:
    assert change[0] in text
    scene, raised_scene = folder / "scene.toml", folder / "raised.toml"
    scene.write_text(text)
    raised_scene.write_text(text.replace(*change))
    out, raised = folder / "out.mcap", folder / "raised.mcap"
    geomphys.run(log, scene, out=out, config=config)
    geomphys.run(log, raised_scene, out=raised, config=config)
    return Results(log, scene, out, raised_scene, raised)
