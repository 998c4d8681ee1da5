"""Measures of a recorded motion against closed forms, and the gate made of them."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import geomphys
from geomphys.analysis.junit import Claim, write_junit
from geomphys.errors import LogError
from tests.cli.press import DEEPEST_M, FRAMES, SCENE, write_log
from tests.made import Results

RADIUS_M = 0.05
DEPTH_M = -DEEPEST_M * np.cos(2.0 * np.pi * 30 / (FRAMES - 1))
"""Of the deepest frame: the turning point lies between two."""


def test_a_pressed_ball_is_as_deep_as_it_was_recorded(pressed: Results) -> None:
    report = geomphys.audit_motion(pressed.log, pressed.scene)
    assert report.max_penetration_m == pytest.approx(DEPTH_M, rel=1e-9)
    (pair,) = report.pairs
    assert {pair.body_a, pair.body_b} == {"finger", "table"}
    assert pair.frame == report.deepest_frame
    assert pair.frames == report.frames_penetrating
    assert not pair.same_avatar
    cap = np.pi * DEPTH_M**2 * (RADIUS_M - DEPTH_M / 3.0)
    assert report.intersection_volume_m3 == pytest.approx(cap, rel=0.05), "the ball is tessellated"
    (statistics,) = geomphys.statistics_of([pressed.out]).outputs
    assert statistics.motion.intersection_volume_m3 == pytest.approx(report.intersection_volume_m3, rel=1e-5)
    depths = np.array([r.metrics.recorded_penetration_m for r in geomphys.replay(pressed.log, pressed.scene)])
    assert report.share_deep == pytest.approx((depths > 2e-3).mean())
    assert report.frames == len(depths)


def test_a_motion_that_touches_nothing_is_free(tmp_path: Path) -> None:
    write_log(tmp_path / "press.mcap")
    (tmp_path / "scene.toml").write_text(SCENE.replace("position = [0.0, 0.0, -0.05]", "position = [0.0, 0.0, -3.05]"))
    report = geomphys.audit_motion(tmp_path / "press.mcap", tmp_path / "scene.toml")
    assert (report.max_penetration_m, report.frames_penetrating, report.share_deep) == (0.0, 0, 0.0)
    assert (report.deepest_frame, report.intersection_volume_m3, report.pairs) == (None, 0.0, ())
    with pytest.raises(LogError, match="gave no frame"):
        geomphys.audit_motion(
            tmp_path / "press.mcap", tmp_path / "scene.toml", config=geomphys.Config(start=100.0, end=101.0)
        )


def test_junit_has_a_case_for_each_claim(tmp_path: Path) -> None:
    path = tmp_path / "report.xml"
    write_junit(path, [Claim("a.mcap", "free", ""), Claim("b\x00.mcap", "free", "2 mm <deep> & more")])
    suite = ElementTree.parse(path).getroot().find("testsuite")
    assert (suite.get("tests"), suite.get("failures")) == ("2", "1")
    good, bad = suite.findall("testcase")
    assert good.find("failure") is None
    assert bad.find("failure").get("message") == "2 mm <deep> & more"
    assert (good.get("classname"), bad.get("classname")) == ("a.mcap", "b?.mcap")


@pytest.mark.parametrize(("limit", "code"), [("25", 0), ("15", 4), (None, 0)])
def test_the_gate_on_a_log(pressed: Results, tmp_path: Path, capsys, limit: str | None, code: int) -> None:
    from geomphys_cli.main import run

    claim = [] if limit is None else ["--max-penetration", limit, "--junit", str(tmp_path / "j.xml")]
    assert run(["audit", str(pressed.log), "--scene", str(pressed.scene), "--json", *claim]) == code
    said = capsys.readouterr()
    assert json.loads(said.out)["max_penetration_m"] == pytest.approx(DEPTH_M, rel=1e-9)
    assert ("allowed are 15 mm" in said.err) == (code == 4)
    if limit is not None:
        case = ElementTree.parse(tmp_path / "j.xml").getroot().find("testsuite/testcase")
        assert case.get("name") == f"penetration at most {limit} mm"
        assert (case.find("failure") is not None) == (code == 4)


def test_the_gate_on_an_output(pressed: Results, tmp_path: Path, capsys) -> None:
    from geomphys_cli.main import run

    out = str(pressed.out)
    assert run(["audit", out, "--junit", str(tmp_path / "j.xml")]) == 0
    assert ElementTree.parse(tmp_path / "j.xml").getroot().find("testsuite/testcase").get("name") == "free of overlaps"
    assert run(["audit", out, "--recorded", "--max-penetration", "19"]) == 4
    assert run(["audit", out, "--recorded", "--max-penetration", "25"]) == 0
    capsys.readouterr()


def test_what_cannot_be_audited_is_wrong_usage(pressed: Results, tmp_path: Path, capsys) -> None:
    from geomphys_cli.main import run

    log, scene = str(pressed.log), str(pressed.scene)
    for arguments, text in (
        ([log, "-s", scene, "--recorded"], "--recorded is for outputs"),
        ([log, "-s", scene, "--junit", str(tmp_path / "j.xml")], "nothing to claim"),
        ([log, "-s", scene, "--max-penetration", "1", "--junit", log], "is an input"),
    ):
        assert run(["audit", *arguments]) == 2
        assert text in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
