"""Writes the meshes, robot descriptions and generated scene files of this folder; the same bytes on every run.

``python assets/make_assets.py`` writes into assets/, ``--out DIR`` into another folder.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import body
import gallery
import hand
import mug
import robot_hand


def make(folder: Path) -> dict[str, str]:
    """Write everything into ``folder``; returns what each set consists of."""
    return {
        "hand": f"{hand.make(folder / 'hand')} triangles",
        "robot_hand": f"{robot_hand.make(folder / 'robot_hand')} joints",
        "mug": f"{mug.make(folder / 'mug')} triangles",
        "body": f"{body.make(folder / 'body')} links",
        "gallery": f"{gallery.make(folder / 'gallery', folder / 'ball', folder / 'scenes' / 'gallery.toml')} triangles",
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(__file__).resolve().parent, help="folder to write into")
    for name, what in make(parser.parse_args().out).items():
        print(f"{name}: {what}")


if __name__ == "__main__":
    main()
