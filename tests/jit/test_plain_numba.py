"""Kernels that are noinline, linked and kept on disk give what numba alone gives, bit for bit."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROJECT = Path(__file__).parents[2]

QUERIES = """
import sys
import numpy as np
from scipy.spatial.transform import Rotation
from geomphys.collision.query import query
from geomphys.jit.registry import definitions
from geomphys.scene.pieces import Box, Capsule, Hull, Sphere

random = np.random.default_rng(3)
shapes = [Sphere(0.4), Capsule(0.2, 0.5), Box((0.3, 0.4, 0.5)), Hull(random.normal(size=(20, 3)))]
for _ in range(300):
    a, b = (shapes[k] for k in random.integers(len(shapes), size=2))
    poses = [np.eye(4), np.eye(4)]
    for pose in poses:
        pose[:3, :3] = Rotation.from_quat(random.normal(size=4)).as_matrix()
        pose[:3, 3] = random.normal(scale=0.4, size=3)
    found = query(a, poses[0], b, poses[1])
    for part in (np.array(found.separation), *found[1:]):
        sys.stdout.buffer.write(part.tobytes())
print(any(kernel.noinline for kernel in definitions.values()), file=sys.stderr)
"""

REPLAY = "from geomphys_cli.entry import main; main()"


def run(cache: Path, plain: bool, *arguments: str) -> subprocess.CompletedProcess[bytes]:
    environment = os.environ | {"GEOMPHYS_PLAIN_NUMBA": "1" if plain else "0"}
    if plain:
        environment["XDG_CACHE_HOME"] = str(cache)
    return subprocess.run(
        [sys.executable, "-c", *arguments], cwd=PROJECT, env=environment, capture_output=True, check=True, timeout=3600
    )


def test_separations_of_shapes(tmp_path: Path) -> None:
    linked, plain = (run(tmp_path, plain, QUERIES) for plain in (False, True))
    assert len(linked.stdout) > 300 * 80
    assert plain.stdout == linked.stdout
    assert (linked.stderr.split(), plain.stderr.split()) == ([b"True"], [b"False"])
    assert not list(tmp_path.rglob("*.entry"))


@pytest.mark.slow
def test_a_replay(tmp_path: Path) -> None:
    outputs = []
    for plain in (False, True):
        output = tmp_path / f"{plain}.mcap"
        log, scene = "recordings/gallery_hand.mcap", "assets/scenes/gallery.toml"
        run(tmp_path, plain, REPLAY, "replay", log, "--scene", scene, "--output", str(output), "--no-timing")
        outputs.append(output.read_bytes())
    assert outputs[0] == outputs[1]
