"""The demonstration's files are found in a checkout and where a wheel puts them."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import geomphys
from geomphys.authoring import demo_files as module
from geomphys.errors import LogError

ROOT = Path(__file__).resolve().parents[2]


def test_in_a_checkout() -> None:
    files = geomphys.demo_files()
    assert (files.log, files.scene) == (ROOT / "recordings/gallery_hand.mcap", ROOT / "assets/scenes/gallery.toml")


def test_as_a_wheel_installs_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The folders of the packages `geomphys_demo.*` beside each other: the scene's relative paths hold there."""
    import tomllib

    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    site = tmp_path / "site"
    for package, folder in setuptools["package-dir"].items():
        if package.startswith("geomphys_demo"):
            for pattern in setuptools["package-data"][package]:
                for source in (ROOT / folder).glob(pattern):
                    target = site.joinpath(*package.split(".")) / source.relative_to(ROOT / folder)
                    target.parent.mkdir(parents=True, exist_ok=True)
                    shutil.copy(source, target)
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.setattr(module, "__file__", str(tmp_path / "elsewhere/geomphys/authoring/demo_files.py"))
    files = module.demo_files()
    assert files.log.is_relative_to(site)
    assert files.log.read_bytes() == (ROOT / "recordings/gallery_hand.mcap").read_bytes()
    assert len(geomphys.load_world(files.scene).body_names) > 40


def test_where_they_are_not_it_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "__file__", str(tmp_path / "geomphys/authoring/demo_files.py"))
    monkeypatch.setattr(module, "find_spec", lambda name: None)
    with pytest.raises(LogError, match="not installed"):
        module.demo_files()
