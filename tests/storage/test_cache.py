"""Where costly things are kept."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from geomphys.jit.folder import _sources_of_machine_code
from geomphys.storage import cache
from tests.house.sources import modules


@pytest.fixture(autouse=True)
def forgotten() -> Iterator[None]:
    """No folder is remembered from before, nor after."""
    cache.user_cache_folder.cache_clear()
    yield
    cache.user_cache_folder.cache_clear()


def test_machine_code_is_named_after_every_module_with_a_kernel() -> None:
    kernels = {
        name
        for name, text in cache.sources().items()
        if re.search(rb"^@(kernel|outlined|inlined)$", text, re.MULTILINE)
    }
    assert "geomphys.engine.step" in kernels
    assert kernels <= {name for name, _ in _sources_of_machine_code()}


def test_the_users_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache.user_cache_folder("pieces") == tmp_path / "geomphys" / "pieces"
    assert (tmp_path / "geomphys" / "pieces").is_dir()


def test_a_home_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(tmp_path / "temp"))
    folder = cache.user_cache_folder("pieces")
    assert folder.parent.parent == tmp_path / "temp"
    assert folder.is_dir()


def test_nobody_elses_folder_in_a_place_for_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(cache.tempfile, "tempdir", str(tmp_path))
    shared = tmp_path / f"geomphys-{os.getuid()}"
    shared.mkdir()
    shared.chmod(0o777)
    assert not cache.user_cache_folder("kernels").is_relative_to(shared)
    cache.user_cache_folder.cache_clear()
    shared.chmod(0o700)
    assert cache.user_cache_folder("kernels") == shared / "kernels"
    cache.user_cache_folder.cache_clear()
    (shared / "kernels").rmdir()
    shared.rename(tmp_path / "another")
    shared.symlink_to(tmp_path / "another")
    assert not cache.user_cache_folder("kernels").is_relative_to(shared)


def test_sources_are_those_of_the_whole_package() -> None:
    """Machine code and scenes in the cache are found by them: what is left out could change unnoticed."""
    names = {"geomphys", *(f"geomphys.{name}" for name in modules("geomphys") if name)}
    assert names <= set(cache.sources())
