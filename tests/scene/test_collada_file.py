"""What is known of a COLLADA file before it is parsed: its size, however often its nodes name each other."""

from __future__ import annotations

import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from geomphys.errors import MeshError
from geomphys.scene.collada_file import check_collada
from geomphys.scene.meshes import load_mesh
from tests.fuzz.growing import collada, defined_later, doubling, named, node

pytest.importorskip("collada")


def test_nodes_that_are_named_again_are_read_each_time(tmp_path: Path) -> None:
    path = tmp_path / "a.dae"
    moved = "".join(node(k, f"<translate>{2 * k} 0 0</translate>{named(9)}") for k in range(3))
    path.write_bytes(collada(moved, node(9, "{mesh}")))
    mesh = load_mesh(path)
    assert len(mesh.faces) == 12
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx([5, 1, 1])


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (doubling(10), "has a scene of 3072 nodes and meshes, at most 2000 are read"),
        (doubling(2_000), "has a scene of more than a billion nodes and meshes, at most 8004 are read"),
        (collada(node(0, 300 * "{mesh}"), "", 5_000), "has up to 1500000 triangles, at most 1000000 are read"),
        (defined_later(400), "before they are defined"),
        (collada(named(0), node(0, named(1)) + node(1, named(0))), "ValueError"),
    ],
)  # fmt: skip
def test_what_grows_beyond_measure_is_refused_before_it_is_parsed(tmp_path: Path, data: bytes, says: str) -> None:
    path = tmp_path / "a.dae"
    path.write_bytes(data)
    with pytest.raises(MeshError, match=says):
        load_mesh(path)


def test_numbers_are_counted_as_the_parser_counts_them() -> None:
    many = collada(node(0, "{mesh}"), "", 7).replace(b" 2 1", b"\n\t2   1 ")
    assert check_collada(many, 7).problem == ""
    assert check_collada(many, 6).problem.startswith("has up to 7 triangles")


def test_an_archive_is_no_collada_file(tmp_path: Path) -> None:
    packed = BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("a.dae", collada(node(0, "{mesh}")))
    for data in (packed.getvalue(), collada(node(0, "{mesh}")) + packed.getvalue()):
        with pytest.raises(ValueError, match="archive"):
            check_collada(data, 1)
