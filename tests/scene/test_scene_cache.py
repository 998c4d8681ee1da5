"""Worlds kept between runs are the worlds their files would give, or are not taken."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import Mock

import pytest

from geomphys import load
from geomphys.errors import MeshError
from geomphys.output.provenance import sha256_of_world
from geomphys.scene import assembly, scene_cache
from geomphys.scene.world import World
from geomphys.storage import cache
from tests.scene.models import cube, link, stl, urdf

SCENE = '[[object]]\nname = "drawer"\nclass = "fixed"\nurdf = "drawer.urdf"\n'


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A scene of a mesh in a package, beside an empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    cache.user_cache_folder.cache_clear()
    (tmp_path / "a" / "things").mkdir(parents=True)
    (tmp_path / "a" / "scene.toml").write_text(SCENE)
    mesh = '<geometry><mesh filename="package://things/cube.stl" scale="0.1 0.1 0.1"/></geometry>'
    urdf(tmp_path / "a" / "drawer.urdf", link("case", mesh))
    (tmp_path / "things").mkdir()
    stl(tmp_path / "things" / "cube.stl", *cube())
    yield tmp_path / "a" / "scene.toml"
    cache.user_cache_folder.cache_clear()


def read(scene: Path, monkeypatch: pytest.MonkeyPatch, seed: int = 0) -> tuple[World, bool]:
    """A world, and whether its files were read for it."""
    with monkeypatch.context() as patch:
        assemble = Mock(wraps=assembly.assemble)
        patch.setattr(assembly, "assemble", assemble)
        return load.load_world(scene, seed=seed), assemble.called


def test_the_second_time_it_is_the_same_world(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, was_read = read(scene, monkeypatch)
    assert was_read
    second, was_read = read(scene, monkeypatch)
    assert not was_read
    assert sha256_of_world(second) == sha256_of_world(first)
    assert (second.path, second.urdfs, second.file) == (first.path, first.urdfs, first.file)
    assert all((a == b).all() for one, other in zip(first.triangles, second.triangles, strict=True)
               for a, b in zip(one, other, strict=True) if hasattr(a, "shape"))  # fmt: skip


@pytest.mark.parametrize("file", ["scene.toml", "drawer.urdf", "../things/cube.stl"])
def test_a_file_that_changed_is_read(scene: Path, file: str, monkeypatch: pytest.MonkeyPatch) -> None:
    first, _ = read(scene, monkeypatch)
    path = scene.parent / file
    before = path.stat()
    if path.suffix == ".stl":
        stl(path, cube()[0] * 1.5, cube()[1])
    else:
        old, new = ("0.1 0.1 0.1", "0.2 0.1 0.1") if path.suffix == ".urdf" else ('"drawer"', '"box"')
        path.write_text(path.read_text().replace(old, new))
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    changed, was_read = read(scene, monkeypatch)
    assert was_read
    assert sha256_of_world(changed) != sha256_of_world(first)


def test_a_package_that_is_found_earlier_now_is_read(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, _ = read(scene, monkeypatch)
    stl(scene.parent / "things" / "cube.stl", cube()[0] * 1.5, cube()[1])
    changed, was_read = read(scene, monkeypatch)
    assert was_read
    assert sha256_of_world(changed) != sha256_of_world(first)


def test_a_file_that_is_gone_is_missed(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read(scene, monkeypatch)
    (scene.parent.parent / "things" / "cube.stl").unlink()
    with pytest.raises(MeshError, match="things"):
        read(scene, monkeypatch)


def test_other_options_make_another_world(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read(scene, monkeypatch)
    load.load_world(scene, seed=1)
    load.load_world(scene, mode="chains")
    assert len(list((scene.parent.parent / "cache" / "geomphys" / "worlds").iterdir())) == 3


def test_a_damaged_one_is_made_again(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, _ = read(scene, monkeypatch)
    (kept,) = (scene.parent.parent / "cache" / "geomphys" / "worlds").iterdir()
    data = kept.read_bytes()
    for broken in (data[:-1], data[:20], b"", data[:500] + bytes([data[500] ^ 1]) + data[501:]):
        kept.write_bytes(broken)
        again, was_read = read(scene, monkeypatch)
        assert was_read
        assert sha256_of_world(again) == sha256_of_world(first)
    assert not read(scene, monkeypatch)[1]


def test_another_version_of_the_package_makes_its_own(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read(scene, monkeypatch)
    monkeypatch.setattr(scene_cache, "installed_state", lambda *libraries: "other")
    assert read(scene, monkeypatch)[1]


def test_few_are_kept_and_none_of_a_scene_alone(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene_cache, "MAX_WORLDS", 2)
    for seed in range(4):
        load.load_world(scene, seed=seed)
    folder = scene.parent.parent / "cache" / "geomphys" / "worlds"
    assert len(list(folder.iterdir())) == 2
    assert not read(scene, monkeypatch, 3)[1]
    alone = scene.with_name("alone.toml")
    alone.write_text('[[object]]\nname = "ball"\nclass = "fixed"\nsphere = 0.1\n')
    before = set(folder.iterdir())
    load.load_world(alone)
    assert set(folder.iterdir()) == before
