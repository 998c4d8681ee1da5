"""``geomphys init``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from geomphys_cli.main import run


@pytest.fixture
def words(root: Path) -> list[str]:
    log, urdf = root / "recordings" / "finger_snip.mcap", root / "assets" / "hand" / "hand.urdf"
    return ["init", str(log), "--urdf", str(urdf)]


def test_init_writes_a_scene_that_check_accepts(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(words) == 0
    told = capsys.readouterr().out
    assert "follows /tracker/wrist" in told
    assert "22 by name from /glove/joint_states, rad" in told
    assert f"geomphys check {words[1]} --scene scene.toml\n" in told
    assert told.rstrip().endswith(f"geomphys calibrate {words[1]} --scene scene.toml --flat T0:T1 --on table --write")
    assert run(["check", words[1], "--scene", "scene.toml", "--strict"]) == 0
    before = Path("scene.toml").read_bytes()
    assert run(words) == 2
    assert "--force" in capsys.readouterr().err
    assert run([*words, "--force"]) == 0
    assert Path("scene.toml").read_bytes() == before


def test_init_prints_the_scene_or_json(words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*words, "-o", "-"]) == 0
    assert "[[avatar]]" in capsys.readouterr().out
    assert run([*words, "-o", str(tmp_path / "s.toml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["avatars"][0]["root"]["name"] == "/tracker/wrist"


def test_init_says_what_mesh_is_missing(words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "hand.urdf").write_text(Path(words[3]).read_text())
    assert run([*words[:3], str(tmp_path / "hand.urdf"), "-o", str(tmp_path / "s.toml")]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert ".obj" in error
    assert "hand.urdf" in error
