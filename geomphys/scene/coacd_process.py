"""Runs CoACD in a subprocess: ``python -m geomphys.scene.coacd_process IN.npz OUT.npz PARENT``.

CoACD is C++ behind ctypes: it writes to the standard output, cannot be interrupted, and a crash ends its process. In a
subprocess none of this affects a replay. The subprocess never outlives its parent.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from itertools import pairwise
from threading import Event
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import MeshError
from geomphys.storage.child_process import end_with_parent
from geomphys.storage.temporary_folders import TemporaryFolder

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TIMEOUT = 900.0
"""s; a mesh that takes longer is refused"""
POLL_INTERVAL = 0.1
"""s between two checks whether it is to stop"""
SEARCHES = {
    "thorough": {"mcts_iterations": 60, "mcts_nodes": 20, "mcts_max_depth": 3, "resolution": 2000},
    "medium": {"mcts_iterations": 60, "mcts_nodes": 20, "mcts_max_depth": 3, "resolution": 1000},
    "quick": {"mcts_iterations": 30, "mcts_nodes": 10, "mcts_max_depth": 2, "resolution": 1000},
}
"""CoACD's search for each cut: number of trials, planes an axis, cuts ahead; and points by which a concavity is measured.
Its defaults 150, 20 and 3 take twice as long as the thorough one for pieces that protrude as far. Half the points take two
thirds of the time: as many pieces of large meshes, but up to twice as many of a few triangles."""


class CutOptions(NamedTuple):
    """How CoACD cuts a mesh."""

    threshold: float  # concavity (0.01 to 1, of half the longest side) that a part may keep
    seed: int
    search: str = "thorough"  # one of `SEARCHES`
    remesh: bool = (
        False  # cut a surface of voxels, a hundredth of the size, in place of a mesh that cuts through itself
    )


def convex_parts(
    name: str,
    vertices: Floats,
    faces: Ints,
    cut: CutOptions,
    *,
    threads: int = 1,
    stop: Event | None = None,
) -> list[Floats]:
    """Convex decomposition of a closed mesh by CoACD: vertices (k, 3) of each part's hull, m.

    `threads` changes no part. Raises MeshError if CoACD fails, takes longer than
    `TIMEOUT`, or gives nothing or NaN, or if `stop` is set.
    """
    hint = 'simplify or repair it, or use decomposition = "hull"'
    with TemporaryFolder() as folder:
        source, target = folder / "mesh.npz", folder / "parts.npz"
        np.savez(source, vertices=vertices, faces=faces, **cut._asdict())
        command = [sys.executable, "-P", "-m", __name__, str(source), str(target), str(os.getpid())]
        code = _run_until_exit(command, threads, stop or Event())
        if code is None:
            raise MeshError(f"{name}: convex decomposition took more than {TIMEOUT:.0f} s: {hint}")
        if code or not target.is_file():
            raise MeshError(f"{name}: convex decomposition failed (CoACD ended with {code}): {hint}")
        with np.load(target, allow_pickle=False) as archive:
            points, starts = archive["points"], archive["starts"]
    if len(starts) < 2:
        raise MeshError(f"{name}: convex decomposition gave no pieces: {hint}")
    if not np.isfinite(points).all():
        raise MeshError(f"{name}: convex decomposition gave pieces that are NaN or infinite: {hint}")
    return [points[a:b] for a, b in pairwise(starts)]


def _run_until_exit(command: list[str], threads: int, stop: Event) -> int | None:
    """Run a command; returns its exit code, or None after `TIMEOUT`. The process is killed if `stop` is set."""
    environment = os.environ | {"OMP_NUM_THREADS": str(threads), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment
    ) as process:
        deadline = time.monotonic() + TIMEOUT
        try:
            while time.monotonic() < deadline and not stop.is_set():
                try:
                    return process.wait(POLL_INTERVAL)
                except subprocess.TimeoutExpired:
                    continue
            return -9 if stop.is_set() else None
        finally:
            process.kill()


def _main(source: str, target: str, parent: str) -> None:
    end_with_parent(int(parent))
    import coacd

    with np.load(source, allow_pickle=False) as archive:
        mesh = coacd.Mesh(archive["vertices"], archive["faces"].astype(np.int32))
        threshold, seed, search = float(archive["threshold"]), int(archive["seed"]), SEARCHES[str(archive["search"])]
        preprocess = "auto" if archive["remesh"] else "off"
    coacd.set_log_level("off")
    parts = [
        np.asarray(points, dtype=np.float64)
        for points, _ in coacd.run_coacd(mesh, threshold=threshold, seed=seed, preprocess_mode=preprocess, **search)
    ]
    starts = np.concatenate([[0], np.cumsum([len(p) for p in parts])]).astype(np.int64)
    np.savez(target, points=np.concatenate([np.zeros((0, 3)), *parts]), starts=starts)


if __name__ == "__main__":
    _main(*sys.argv[1:])
