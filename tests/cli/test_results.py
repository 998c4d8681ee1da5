"""``diff``, ``stats``, ``plot`` and ``audit`` as a user meets them: results on stdout, exit codes, one line of error."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from geomphys_cli.cmd_stats import ROWS
from geomphys_cli.main import run

from tests.cli.imported_packages import imported_packages
from tests.cli.press import SCENE
from tests.made import Results


def test_the_same_is_0(pressed: Results, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["diff", str(pressed.out), str(pressed.out)]) == 0
    output = capsys.readouterr()
    assert "the same" in output.out
    assert "60 frames compared" in output.out
    assert output.err == ""
    assert run(["diff", str(pressed.out), str(pressed.out), "--json"]) == 0
    brief = json.loads(capsys.readouterr().out)
    assert brief["channels"]["/tf"]["max_m"] == 0.0
    assert brief["channels"]["/tf"]["bodies"] == {}


def test_different_is_1_and_says_where(pressed: Results, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["diff", str(pressed.out), str(pressed.raised)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert any(line.split() == ["Result", "different"] for line in lines)
    (finger,) = [line.split() for line in lines if line.startswith("finger ") and "|" not in line]
    assert finger[2] == "mm"
    assert 0.9 < float(finger[1]) < 1.6
    assert any(line.startswith("finger | table") for line in lines)
    assert any(line.startswith("world_sha256") for line in lines)


@pytest.mark.parametrize("words", [["stats", "{out}", "--json"], ["diff", "{out}", "{out}"]])
def test_figures_are_read_without_what_computes_motion(pressed: Results, words: list[str]) -> None:
    """Loading the kernels and what makes a scene takes four times as long as reading a short output."""
    imported = imported_packages([word.format(out=pressed.out) for word in words])
    assert not {"numba", "llvmlite", "scipy", "trimesh", "pydantic"} & imported


def test_diff_as_json(landed: Results, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["diff", str(landed.out), str(landed.raised), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["equal"] is False
    motion = found["channels"]["/tf"]
    assert {"max_m", "rms_m", "max_rad", "first_frame", "bodies"} <= set(motion)
    assert motion["bodies"]["palm"]["max_m"] == pytest.approx(0.001, rel=0.1)
    assert set(found["parameters"]) == {"scene_sha256", "world_sha256"}


def test_a_tolerance_makes_them_the_same(pressed: Results, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["diff", str(pressed.out), str(pressed.raised), "--tolerance-m", "0.002", "--tolerance-rad", "0.01"]
    assert run(words) == 0
    assert "within the tolerance" in capsys.readouterr().out
    assert run([*words[:3], "--channel", "/recorded/tf"]) == 0


def test_a_page_and_an_overlay(pressed: Results, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    html, rrd = tmp_path / "report.html", tmp_path / "overlay.rrd"
    words = ["diff", str(pressed.out), str(pressed.raised), "--html", str(html), "--rrd", str(rrd)]
    assert run(words) == 1
    assert html.read_text().startswith("<!doctype html>")
    assert rrd.stat().st_size > 10_000
    assert sorted(path.name for path in tmp_path.iterdir()) == ["overlay.rrd", "report.html"]
    capsys.readouterr()
    assert run(words) == 2
    assert "--force" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ["{out}", "{log}"],
        ["{out}", "{folder}/nothing.mcap"],
        ["{out}"],
        ["{out}", "{out}", "--tolerance-m", "-1"],
        ["{out}", "{out}", "--channel", "/timing"],
        ["{out}", "{out}", "--html", "{out}", "--force"],
        ["{out}", "{raised}", "--rrd", "{folder}/a.rrd", "--scene", "{log}"],
    ],
)
def test_trouble_is_2_and_one_line(
    pressed: Results, tmp_path: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    places = {"out": pressed.out, "raised": pressed.raised, "log": pressed.log, "folder": tmp_path}
    assert run(["diff", *(word.format(**places) for word in words)]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.count("\n") == 1


def test_each_row_of_the_table_of_stats_has_a_name_of_its_own() -> None:
    labels = [label for label, *_ in ROWS.values()]
    assert len(set(labels)) == len(labels) > 10


def test_stats(landed: Results, pressed: Results, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["stats", str(landed.out), str(pressed.out)]) == 0
    text = capsys.readouterr().out
    for word in ("out.mcap", "all 2", "recorded penetration", "speed, correction", "step.overlap", "p99"):
        assert word in text
    assert run(["stats", str(pressed.out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["all"]["frames"] == 60
    assert found["outputs"][0]["values"]["recorded_penetration_m"]["max"] == pytest.approx(0.02, rel=0.01)


@pytest.mark.parametrize("command", ["stats", "audit", "plot"])
def test_what_is_no_output_is_1(
    pressed: Results, tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    more = ["-o", str(tmp_path / "a.png")] if command == "plot" else []
    assert run([command, str(pressed.log), *more]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "press.mcap" in error


def test_plot(pressed: Results, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "a.svg"
    words = ["plot", str(pressed.out), "-o", str(picture)]
    assert run([*words, "--panel", "penetration", "--panel", "contacts"]) == 0
    assert picture.read_text().startswith("<?xml")
    capsys.readouterr()
    assert run(words) == 2
    assert "--force" in capsys.readouterr().err
    assert run(["plot", str(pressed.out), "-o", str(tmp_path / "a.gif")]) == 2
    assert ".gif" in capsys.readouterr().err


def test_audit(pressed: Results, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["audit", str(pressed.out)]) == 0
    assert "free in every frame" in capsys.readouterr().out
    assert run(["audit", str(pressed.out), "--recorded", "--json"]) == 4
    found = json.loads(capsys.readouterr().out)
    assert found["motion"] == "recorded"
    assert {found["deepest"]["body_a"], found["deepest"]["body_b"]} == {"finger", "table"}
    larger = tmp_path / "larger.toml"
    larger.write_text(SCENE.replace("sphere = 0.05", "sphere = 0.052"))
    assert run(["audit", str(pressed.out), "--scene", str(larger)]) == 4
    output = capsys.readouterr()
    assert "finger in table" in output.out or "table in finger" in output.out
    assert "warning" in output.err
