"""Finds the recording and the scene of the demonstration: in the installed package, or in a checkout."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from geomphys.errors import LogError

_PACKAGE = "geomphys_demo"
"""Package of a wheel that holds the files, without modules."""


class DemoFiles(NamedTuple):
    """What the demonstration replays."""

    log: Path
    scene: Path


def demo_files() -> DemoFiles:
    """A recorded hand that goes into a table, and the gallery it stands in. Raises LogError if they are not installed."""
    checkout = Path(__file__).resolve().parents[2]
    candidates = [DemoFiles(checkout / "recordings/gallery_hand.mcap", checkout / "assets/scenes/gallery.toml")]
    spec = find_spec(_PACKAGE)
    for folder in map(Path, (spec and spec.submodule_search_locations) or ()):
        candidates.append(DemoFiles(folder / "gallery_hand.mcap", folder / "scenes/gallery.toml"))
    for files in candidates:
        if files.log.is_file() and files.scene.is_file():
            return files
    raise LogError("the files of the demonstration are not installed; install the package again")
