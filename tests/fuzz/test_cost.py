"""Processor time for each byte of a file: it stays within a bound, however large a file that was made to take long."""

from __future__ import annotations

import gc
import time
from pathlib import Path

import pytest

from geomphys.errors import MeshError
from geomphys.recording.transform_tree import MAX_STEPS, FrameError, Link, TransformTree
from geomphys.scene.gltf_file import MAX_DEPTH
from geomphys.scene.meshes import load_mesh
from tests.fuzz.growing import FAMILIES, LARGE, OVERLAPPING, Family, nested_nodes
from tests.fuzz.targets import TARGETS

SECONDS = 0.4
"""What any file may take beside its bytes."""


def check(family: Family, size: int, folder: Path) -> None:
    target, data = TARGETS[family.target], family.make(size)
    target(family.make(2), folder)  # loads what it needs
    gc.disable()  # going through all that other tests have left is not its time
    try:
        start = time.process_time()
        target(data, folder)
        spent = time.process_time() - start
    finally:
        gc.enable()
    assert spent < SECONDS + 1e-6 * family.microseconds * len(data), f"{spent:.2f} s for {len(data)} bytes"


@pytest.mark.parametrize("name", FAMILIES)
def test_the_time_of_a_byte_is_bounded(tmp_path: Path, name: str) -> None:
    check(FAMILIES[name], FAMILIES[name].size, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", LARGE)
def test_the_time_of_a_byte_is_bounded_in_large_files_too(tmp_path: Path, name: str) -> None:
    check(FAMILIES[name], LARGE[name], tmp_path)


@pytest.mark.slow
def test_chunks_that_overlap_are_read_in_the_order_of_time_without_a_search(tmp_path: Path) -> None:
    check(OVERLAPPING, OVERLAPPING.size, tmp_path)


def test_nodes_of_a_gltf_are_read_to_some_depth(tmp_path: Path) -> None:
    path = tmp_path / "deep.glb"
    path.write_bytes(nested_nodes(MAX_DEPTH - 1, translation=[0, 0, 1]))
    assert load_mesh(path).vertices[:, 2].min() == MAX_DEPTH - 2
    path.write_bytes(nested_nodes(MAX_DEPTH))
    with pytest.raises(MeshError, match=f"has nodes {MAX_DEPTH + 1} deep in one another, at most {MAX_DEPTH} are read"):
        load_mesh(path)


def test_frames_are_followed_for_some_transforms() -> None:
    def tree(count: int) -> TransformTree:
        links = {f"f{k + 1}": {f"f{k}": Link(["/tf"])} for k in range(count)}
        return TransformTree(links, {f"f{k}" for k in range(count + 1)})

    assert len(tree(MAX_STEPS).path_to_root(f"f{MAX_STEPS}", "")) == MAX_STEPS
    with pytest.raises(FrameError, match=f"the frame 'f{MAX_STEPS + 1}' lies more than {MAX_STEPS} transforms below"):
        tree(MAX_STEPS + 1).path_to_root(f"f{MAX_STEPS + 1}", "")
