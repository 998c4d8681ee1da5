"""`geomphys bench`: tables, JSON, and what it says of what is not there."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from geomphys_cli.main import run
from jsonschema import Draft202012Validator

import geomphys


def test_one_experiment_as_json_markdown_and_tables(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = ["bench", str(root), "--only", "hand_ball", "--no-depths", "--no-scaling", "--repeats", "1"]
    assert run([*line, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    Draft202012Validator(geomphys.json_schema("bench")).validate(report)
    (experiment,) = report["experiments"]
    assert experiment["name"] == "hand_ball"
    assert 0 < experiment["step"]["median"] <= experiment["step"]["p95"] <= experiment["step"]["p99"]
    assert experiment["residual_m"]["max"] <= 1e-5
    assert {"processor", "cores", "versions"} <= set(report["machine"])
    assert run([*line, "--markdown"]) == 0
    rows = [row for row in capsys.readouterr().out.splitlines() if row.startswith("|")]
    assert any(row.startswith("| hand_ball |") for row in rows)
    assert len({row.count("|") for row in rows[:3]}) == 1
    assert run(line) == 0
    assert "step.overlap" in capsys.readouterr().out


def test_what_is_wrong_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["bench", "--only", "galery"]) == 2
    assert "expected one of gallery" in capsys.readouterr().err
    assert run(["bench", str(tmp_path), "--only", "gallery"]) == 1
    assert "name the folder that holds recordings" in capsys.readouterr().err
    assert run(["bench", "--json", "--markdown"]) == 2
