"""Outputs of every recording without stage times, and their hashes: ``python tests/house/golden.py FOLDER [NAME…]``.

The recordings of the checkout, and the real ones where they are (see ``geomphys.bench.experiments``). Run before and after
a change, at the same checkout, as outputs name meshes by their paths; then compare ``FOLDER/SHA256SUMS``.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import geomphys  # noqa: E402
from geomphys.bench.experiments import ExperimentFiles, experiment_files  # noqa: E402

GLOVE = ExperimentFiles(
    name="robot_glove", log=ROOT / "recordings/robot_glove.mcap", scene=ROOT / "assets/scenes/robot_glove.toml"
)


def write_outputs(folder: Path, experiments: list[ExperimentFiles]) -> None:
    """Replay each experiment whose files are there into ``NAME.mcap``; their hashes go into ``SHA256SUMS``."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = []
    for files in experiments:
        if files.exists:
            out = folder / f"{files.name}.mcap"
            geomphys.run(files.log, files.scene, out=out, options=geomphys.OutputOptions(timing=False), force=True)
            lines.append(f"{hashlib.sha256(out.read_bytes()).hexdigest()}  {out.name}\n")
            sys.stdout.write(lines[-1])
            sys.stdout.flush()
    (folder / "SHA256SUMS").write_text("".join(lines))


if __name__ == "__main__":
    every = [*experiment_files(ROOT, ()), GLOVE]
    write_outputs(Path(sys.argv[1]), [files for files in every if not sys.argv[2:] or files.name in sys.argv[2:]])
