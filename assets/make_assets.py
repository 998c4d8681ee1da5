"""Writes the meshes, robot descriptions and generated scene files of this folder; the same bytes on every run.

``python assets/make_assets.py`` writes into assets/, ``--out DIR`` into another folder.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import gallery
import hand


def make(folder: Path) -> dict[str, int]:
    """Write everything into ``folder``; returns the number of triangles of each set."""
    return {
        "hand": hand.make(folder / "hand"),
        "gallery": gallery.make(folder / "gallery", folder / "ball", folder / "scenes" / "gallery.toml"),
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(__file__).resolve().parent, help="folder to write into")
    for name, triangles in make(parser.parse_args().out).items():
        print(f"{name}: {triangles} triangles")


if __name__ == "__main__":
    main()
