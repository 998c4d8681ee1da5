"""What `import geomphys` offers, and what it costs."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

import geomphys


def test_every_public_name_is_declared_for_type_checkers_and_found() -> None:
    declared = set(geomphys._HOME)
    assert declared == set(geomphys.__all__) == set(dir(geomphys))
    assert sorted(geomphys.__all__) == geomphys.__all__


@pytest.mark.parametrize("name", geomphys.__all__)
def test_public_names_resolve(name: str) -> None:
    assert getattr(geomphys, name) is not None
    if name in geomphys._HOME:
        home = importlib.import_module(f"geomphys.{geomphys._HOME[name]}")
        assert getattr(geomphys, name) is getattr(home, name)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'reply'"):
        _ = geomphys.reply


def test_import_costs_nothing() -> None:
    code = "import sys, geomphys; print(*sorted({m.split('.')[0] for m in sys.modules}))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"numpy", "numba", "pydantic", "rerun", "trimesh", "mcap"} & set(loaded)


def test_the_call_behind_every_command_is_public_and_documented(root: Path) -> None:
    guide = (root / "assets" / "docs" / "library.md").read_text()
    rows = dict(re.findall(r"^\| `(\w+)` \| (.+) \|$", guide, flags=re.MULTILINE))
    modules = {path.stem.removeprefix("cmd_"): path for path in (root / "cli").glob("cmd_*.py")}
    assert rows.keys() == modules.keys() - {"completion"}
    for command, text in rows.items():
        calls = [name for name in re.findall(r"(\w+)\(", text) if name != "load_world"]
        assert calls[0] in modules[command].read_text(), command
        for name in calls:
            assert name in geomphys.__all__, name
            assert (getattr(geomphys, name).__doc__ or "").strip(), name
