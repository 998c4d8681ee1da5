"""What a newcomer gets wrong: every error is one line and tells the next step."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from geomphys_cli.main import run

Said = Callable[..., str]


@pytest.fixture
def folder(root: Path, tmp_path: Path) -> Path:
    """A folder with a log, a scene that fits it, and scenes that do not."""
    shutil.copy(root / "recordings" / "finger_snip.mcap", tmp_path / "hand.mcap")
    text = (root / "assets" / "scenes" / "finger_snip.toml").read_text()
    good = text.replace('"../', f'"{root}/assets/')
    (tmp_path / "hand").mkdir()
    shutil.copy(root / "assets" / "hand" / "hand.urdf", tmp_path / "hand")
    scenes = {
        "scene": good,
        "moved": text,
        "topic": good.replace("/tracker/wrist", "/tracker/rist"),
        "kind": good.replace("/glove/joint_states", "/tracker/wrist"),
        "unit": good.replace('"rad"', '"degrees"'),
        "mesh": good.replace(f'"{root}/assets/hand/hand.urdf"', '"hand/hand.urdf"'),
        "joint": good.replace('unit = "rad"', 'unit = "rad", rename = { index_mcp_flex = "index_mcp_flx" }'),
        "class": good.replace('"fixed"', '"static"'),
        "jelly": good.replace('"wood"', '"jelly"'),
    }
    for name, scene in scenes.items():
        (tmp_path / f"{name}.toml").write_text(scene)
    (tmp_path / "junk.mcap").write_text("{}")
    (tmp_path / "taken.mcap").write_text("x")
    return tmp_path


@pytest.fixture
def said(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Said:
    """Run a command line in the folder; returns what it said on stderr, in one line."""
    monkeypatch.chdir(folder)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)

    def call(line: str, code: int) -> str:
        assert run(line.split()) == code, line
        error = capsys.readouterr().err
        assert error.count("\n") == 1, error
        assert "Traceback" not in error
        return error

    return call


@pytest.mark.parametrize(
    ("line", "code", "step"),
    [
        ("replay hand.mcap", 2, "geomphys init LOG --urdf URDF writes a first one"),
        ("init hand.mcap", 2, "name the URDF"),
        ("-q replay hand.mcap -s topic.toml", 1, "did you mean '/tracker/wrist'?"),
        ("check hand.mcap -s kind.toml", 1, "/glove/joint_states has joint values"),
        ("check hand.mcap -s unit.toml", 1, "expected 'rad' or 'deg'"),
        ("check hand.mcap -s mesh.toml", 1, "paths are relative to the URDF"),
        ("check hand.mcap -s moved.toml", 1, "relative to the scene file"),
        ("check hand.mcap -s joint.toml", 1, "did you mean 'index_mcp_flex'?"),
        ("check hand.mcap -s class.toml", 1, "expected 'fixed', 'simulated' or 'driven'"),
        ("check hand.mcap -s jelly.toml", 1, "add a [[material_pair]]"),
        ("check scene.toml -s hand.mcap", 1, "swapped?"),
        ("info junk.mcap", 1, "expected a recording"),
        ("replay hand.mcap -s scene.toml -o taken.mcap", 2, "--force"),
        ("replay hand.mcap -s scene.toml -o new/out.mcap", 2, "make it first"),
        ("replay hand.mcap -s scene.toml -o out.rrd", 2, "choose another ending"),
        ("replay hand.mcap -s scene.toml --rrd out.mcap", 2, "choose another ending"),
        ("batch hand.mcap -s scene.toml -O out.mcap", 2, "a folder is written there"),
        ("export hand.mcap -o out.csv", 2, "leave out .csv"),
        ("-q replay hand.mcap -s scene.toml --clock /x", 1, "it has /glove/joint_states, /tracker/wrist"),
        ("-q replay hand.mcap -s scene.toml --start 100", 1, "with start = 100 s it has no frames"),
        ("repaly hand.mcap -s scene.toml", 2, "did you mean replay?"),
        ("view hand.mcap", 1, "replay a log first"),
        ("view scene.toml", 1, "neither a rerun recording (.rrd) nor an output log (.mcap)"),
        ("stats hand.mcap", 1, "replay a log first"),
    ],
)
def test_the_error_tells_the_next_step(said: Said, line: str, code: int, step: str) -> None:
    assert step in said(line, code)
    assert not Path("out.mcap").exists()
    assert not Path("out.rrd").exists()


def test_units_that_look_wrong_are_warned_of(folder: Path, root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = (folder / "scene.toml").read_text()
    (folder / "deg.toml").write_text(scene.replace('"rad"', '"deg"'))
    assert run(["check", str(folder / "hand.mcap"), "-s", str(folder / "deg.toml")]) == 0
    assert 'say unit = "rad" if these are radians' in capsys.readouterr().out
    large = f'[[object]]\nname = "big"\nclass = "fixed"\nmesh = "{root}/assets/mug/mug.obj"\nscale = 1000.0\n'
    (folder / "big.toml").write_text(scene + "\n" + large + "position = [0.0, 0.0, 5000.0]\n")
    assert run(["check", str(folder / "hand.mcap"), "-s", str(folder / "big.toml")]) == 0
    assert "is in millimetres, say scale = 1\n" in capsys.readouterr().out
