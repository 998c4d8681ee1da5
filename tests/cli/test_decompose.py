"""``geomphys decompose``: the pieces, told and written."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import trimesh
from geomphys_cli.main import run

SIDES = ((1.0, 1.0, 0.1), (0.1, 0.1, 0.8))


@pytest.fixture
def stool(tmp_path: Path) -> Path:
    """A seat and a leg that do not touch: two closed convex parts in one file."""
    seat, leg = (trimesh.creation.box(extents=sides) for sides in SIDES)
    leg.apply_translation((0.0, 0.0, -0.6))
    path = tmp_path / "stool.obj"
    path.write_text(trimesh.util.concatenate([seat, leg]).export(file_type="obj"))
    return path


def test_a_mesh_is_told_and_written(stool: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "pieces.glb"
    assert run(["decompose", str(stool), "-o", str(out), "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)
    assert (told["mesh"], told["triangles"], told["pieces"], told["method"]) == (str(stool), 24, 2, "parts")
    pieces = trimesh.load_scene(out)
    volumes = sorted(piece.volume for piece in pieces.geometry.values())
    assert volumes == pytest.approx([0.008, 0.1])
    assert all(piece.is_watertight for piece in pieces.geometry.values())
    assert run(["decompose", str(stool), "-o", str(out)]) == 2
    assert "--force" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl"])
def test_every_format_holds_the_pieces(stool: Path, tmp_path: Path, suffix: str) -> None:
    out = tmp_path / f"pieces.{suffix}"
    assert run(["decompose", str(stool), "-o", str(out)]) == 0
    assert trimesh.load_mesh(out).volume == pytest.approx(0.108, rel=1e-6)


def test_a_scene_gives_each_mesh_once(stool: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    entry = '[[object]]\nname = "{}"\nclass = "fixed"\nmesh = "stool.obj"\nscale = {}\n'
    scene = tmp_path / "room.toml"
    scene.write_text("\n".join(entry.format(*values) for values in (("a", 1.0), ("b", 1.0), ("c", 2.0))))
    assert run(["decompose", str(scene), "-o", str(tmp_path / "pieces"), "--json"]) == 0
    assert [mesh["scale"][0] for mesh in json.loads(capsys.readouterr().out)] == [1.0, 2.0]
    assert sorted(p.name for p in (tmp_path / "pieces").iterdir()) == ["00_stool.glb", "01_stool.glb"]
    big = trimesh.load_scene(tmp_path / "pieces" / "01_stool.glb")
    assert sum(piece.volume for piece in big.geometry.values()) == pytest.approx(8 * 0.108)


def test_a_person_sees_a_table(stool: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["decompose", str(stool)]) == 0
    heading, row = capsys.readouterr().out.splitlines()
    assert heading.split() == ["mesh", "triangles", "pieces", "how"]
    assert row.split() == ["stool.obj", "24", "2", "convex", "parts"]


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("empty.obj", "", "empty.obj"),
        ("open.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv .1 .1 .1\nf 1 2 5\nf 3 4 5\n", "watertight"),
        ("exact.toml", '[[object]]\nname = "a"\nclass = "fixed"\nsphere = 0.1\n', "nothing to decompose"),
        ("gone.toml", '[[object]]\nname = "a"\nclass = "fixed"\nmesh = "gone.obj"\n', "gone.obj"),
    ],
)
def test_what_cannot_be_cut_is_1_and_one_line(
    tmp_path: Path, name: str, text: str, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_text(text)
    assert run(["decompose", str(tmp_path / name)]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert says in error
