"""Outputs of every recording without stage times, and their hashes: ``python tests/house/golden.py FOLDER [NAME…]``.

The recordings of the checkout, and the real ones where they are (see ``geomphys.bench.experiments``). Run before and after
a change, then compare ``FOLDER/SHA256SUMS``. Other versions of
libzstd pack the same content into other bytes: ``FOLDER/CONTENT`` has hashes of what is packed.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema  # noqa: E402
from mcap.stream_reader import StreamReader  # noqa: E402

import geomphys  # noqa: E402
from geomphys.bench.experiments import ExperimentFiles, experiment_files  # noqa: E402

OTHERS = [
    ExperimentFiles(name=name, log=ROOT / f"recordings/{name}.mcap", scene=ROOT / f"assets/scenes/{name}.toml")
    for name in (
        "gripper_cube",
        "hand_lift",
        "isaac_hand",
        "leap_hand",
        "manus_hand",
        "mug_lift",
        "robot_glove",
        "two_hands",
        "webxr_hand",
    )
]
"""Recordings of the checkout that are no experiments."""


def write_outputs(folder: Path, experiments: list[ExperimentFiles]) -> None:
    """Replay each experiment whose files are there into ``NAME.mcap``; their hashes go into ``SHA256SUMS``."""
    folder.mkdir(parents=True, exist_ok=True)
    lines, contents = [], []
    for files in experiments:
        if files.exists:
            out = folder / f"{files.name}.mcap"
            geomphys.run(files.log, files.scene, out=out, options=geomphys.OutputOptions(timing=False), force=True)
            lines.append(f"{hashlib.sha256(out.read_bytes()).hexdigest()}  {out.name}\n")
            contents.append(f"{content_digest(out)}  {out.name}\n")
            sys.stdout.write(lines[-1])
            sys.stdout.flush()
    (folder / "SHA256SUMS").write_text("".join(lines))
    (folder / "CONTENT").write_text("".join(contents))


def content_digest(path: Path) -> str:
    """SHA-256 of what an MCAP file holds in its order: channels, messages, attachments, metadata, however they are packed.

    But for ``world_sha256``: that is the hash of computed arrays, whose last bits go by the versions of libraries.
    """
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        for record in StreamReader(stream, validate_crcs=True).records:
            if isinstance(record, Metadata):
                record.metadata.pop("world_sha256", None)
            if isinstance(record, Header | Schema | Channel | Message | Attachment | Metadata):
                digest.update(repr(record).encode())
    return digest.hexdigest()


if __name__ == "__main__":
    every = [*experiment_files(ROOT, ()), *OTHERS]
    if unknown := set(sys.argv[2:]) - {files.name for files in every}:
        raise SystemExit(f"no recording: {', '.join(sorted(unknown))}")
    write_outputs(Path(sys.argv[1]), [files for files in every if not sys.argv[2:] or files.name in sys.argv[2:]])
