"""``geomphys batch`` as a user meets it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from geomphys_cli import cmd_batch
from geomphys_cli.main import run

from tests.cli.press import SCENE, write_log


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two logs and a scene."""
    (tmp_path / "logs").mkdir()
    write_log(tmp_path / "logs" / "a.mcap")
    write_log(tmp_path / "logs" / "b.mcap", frames=90)
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


def words(folder: Path, *more: str) -> list[str]:
    """A command line, one job at a time."""
    return [
        "batch",
        str(folder / "logs"),
        "-s",
        str(folder / "scene.toml"),
        "-O",
        str(folder / "out"),
        "-j",
        "1",
        *more,
    ]


def test_a_line_a_log_and_the_sum(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(words(folder, "--rrd", "--no-timing")) == 0
    lines = capsys.readouterr().out.splitlines()
    (row,) = [line for line in lines if line.startswith("b.mcap")]
    assert row.split()[:3] == ["b.mcap", "done", "90"]
    assert "20 mm" in row
    assert re.fullmatch(r"2 logs: 2 done; [0-9.]+ logs/s, [0-9.]+ times real time", lines[-1])
    assert {path.name for path in (folder / "out").iterdir()} == {
        "a.mcap", "a.rrd", "b.mcap", "b.rrd", "manifest.json"
    }  # fmt: skip
    assert run(words(folder, "--rrd", "--no-timing", "--resume")) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "2 logs: 2 done; 2 of them before"


def test_of_many_logs_those_are_listed_that_failed_or_were_corrected_most(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cmd_batch, "LISTED", 3)
    write_log(folder / "logs" / "0.mcap", frames=2)  # free in both
    (folder / "logs" / "d.mcap").write_bytes(b"no log")
    assert run(words(folder)) == 3
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1:4]] == ["a.mcap", "b.mcap", "d.mcap"]
    assert lines[4].startswith("and 1 log more, all in ")
    assert lines[-1].startswith("4 logs: 3 done; 1 failed")


def test_a_broken_log_is_3_after_the_others(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "logs" / "a.mcap").write_bytes(b"no log")
    assert run(words(folder, "--json")) == 3
    output = capsys.readouterr()
    report = json.loads(output.out)
    assert [entry["status"] for entry in report["entries"]] == ["failed", "done"]
    assert len(output.err.splitlines()) == 2
    assert all("a.mcap" in line or "manifest.json" in line for line in output.err.splitlines())


def test_a_broken_threshold_is_4(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(words(folder, "--fail-on-penetration", "0.01")) == 0
    manifest = folder / "out" / "manifest.json"
    content = json.loads(manifest.read_text())
    content["logs"][1]["metrics"]["residual_penetration_max_m"] = 2e-5
    manifest.write_text(json.dumps(content))
    capsys.readouterr()
    assert run(words(folder, "--fail-on-penetration", "0.01", "--resume")) == 4
    assert "0.02 mm" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (["--jobs", "0"], "0"),
        (["--scheduler", "tcp://127.0.0.1:9"], "--jobs"),
        (["--end", "1", "--start", "2"], "end"),
        (["{folder}/logs/a.mcap", "{folder}/other/a.mcap"], "a.mcap"),
        (["{folder}/nothing.mcap"], "nothing.mcap"),
    ],
)
def test_wrong_usage_is_2(folder: Path, more: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "other").mkdir()
    write_log(folder / "other" / "a.mcap")
    assert run(words(folder, *(word.format(folder=folder) for word in more))) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert says in error
    assert not (folder / "out").exists()


def test_outputs_that_exist_are_2(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(words(folder)) == 0
    assert run(words(folder)) == 2
    assert "--resume or --force" in capsys.readouterr().err


def test_a_wrong_scene_is_1_before_any_log(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "scene.toml").write_text(SCENE.replace("wood", "cheese"))
    assert run(words(folder)) == 1
    assert "cheese" in capsys.readouterr().err
    assert not (folder / "out").exists()
