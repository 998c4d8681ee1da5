"""``geomphys replay`` from end to end on a sphere that is pressed into a table."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest
from geomphys_cli.main import run
from mcap.reader import make_reader

import geomphys
from tests.cli.imported_packages import imported_packages
from tests.cli.press import DEEPEST_M, FRAMES, Case, command_line, write_log


def metadata(path: Path) -> dict[str, str]:
    """The provenance record of an output."""
    with path.open("rb") as stream:
        return next(record.metadata for record in make_reader(stream).iter_metadata() if record.name == "geomphys")


def metrics_frames(path: Path) -> int:
    """How many frames an output holds."""
    with path.open("rb") as stream:
        return sum(1 for _ in make_reader(stream).iter_messages(topics=["/metrics"]))


def test_json_tells_what_it_came_to(case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, rrd = tmp_path / "out.mcap", tmp_path / "out.rrd"
    words = ["replay", str(case.log), "--scene", str(case.scene), "-o", str(out), "--rrd", str(rrd), "--json"]
    assert run(words) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["frames"] == FRAMES
    assert summary["duration_s"] == pytest.approx((FRAMES - 1) / 60, abs=1e-6)
    assert summary["recorded_penetration_max_m"] == pytest.approx(DEEPEST_M, rel=0.01)
    assert summary["residual_penetration_max_m"] <= 1e-5
    assert summary["correction_max_m"] == pytest.approx(summary["recorded_penetration_max_m"], abs=1e-5)
    assert {summary["deepest"]["body_a"], summary["deepest"]["body_b"]} == {"finger", "table"}
    assert (summary["out"], summary["rrd"]) == (str(out), str(rrd))
    assert metadata(out)["complete"] == "true"
    assert metrics_frames(out) == FRAMES
    assert rrd.stat().st_size > 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.mcap", "out.rrd"]


def test_pandas_is_not_imported_for_the_recording_of_the_viewer(case: Case, tmp_path: Path) -> None:
    """By pyarrow, which looks for it where lists become arrays: a tenth of the time that a short replay takes."""
    words = ["replay", str(case.log), "--scene", str(case.scene), "--rrd", str(tmp_path / "out.rrd")]
    imported = imported_packages(words)
    assert "pyarrow" in imported
    assert "pandas" not in imported


def test_summary_reads_at_a_glance(case: Case, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["replay", str(case.log), "-s", str(case.scene)]) == 0
    text = capsys.readouterr().out
    assert "press.mcap in press.toml" in text
    assert f"{FRAMES} in 0.98 s (60.0 Hz)" in text
    assert "free in every frame" in text
    assert "20 mm" in text
    assert "\x1b" not in text


def test_the_published_method_is_named(case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["replay", str(case.log), "-s", str(case.scene), "--method", "paper"]
    assert run(words) == 0
    assert "Method     as published" in capsys.readouterr().out
    assert run([*words, "-o", str(tmp_path / "out.mcap"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["method"] == "paper"
    assert metadata(tmp_path / "out.mcap")["method"] == "paper"
    assert (
        run(["batch", str(case.log), "-s", str(case.scene), "-O", str(tmp_path / "many"), "--method", "paper", "-q"])
        == 0
    )
    assert metadata(tmp_path / "many" / f"{case.log.stem}.mcap")["method"] == "paper"


def test_start_and_end_cut_the_recording(case: Case, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["replay", str(case.log), "-s", str(case.scene), "--start", "0.2", "--end", "0.4", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == pytest.approx(13, abs=1)


def test_equal_runs_give_equal_bytes(case: Case, tmp_path: Path) -> None:
    for name in ("a.mcap", "b.mcap"):
        assert run(["replay", str(case.log), "-s", str(case.scene), "-o", str(tmp_path / name), "--no-timing"]) == 0
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_force_replaces(case: Case, tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    out.write_bytes(b"old")
    assert run(["replay", str(case.log), "-s", str(case.scene), "-o", str(out), "--force"]) == 0
    assert metadata(out)["complete"] == "true"


def test_a_broken_threshold_is_4_and_the_output_stays(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out.mcap"
    words = ["replay", str(case.log), "-s", str(case.scene), "-o", str(out), "--force", "--fail-on-penetration"]
    assert run([*words, "0.01"]) == 0

    real = geomphys.run
    monkeypatch.setattr(
        geomphys,
        "run",
        lambda *a, **k: dataclasses.replace(
            real(*a, **k), residual_penetration_max_m=2e-5, residual_penetration_frame=7
        ),
    )
    capsys.readouterr()
    assert run([*words, "0.01"]) == 4
    assert "0.02 mm" in capsys.readouterr().err
    assert metadata(out)["complete"] == "true"


@pytest.mark.parametrize(("name", "code", "word"), [("SIGINT", 130, "interrupted"), ("SIGTERM", 143, "terminated")])
def test_a_signal_leaves_the_finished_part(case: Case, tmp_path: Path, name: str, code: int, word: str) -> None:
    out = tmp_path / "out.mcap"
    kill = f"""
import os, signal
import geomphys_cli.signals as command
stop = command.StopAtFrame.at_frame
frames = 0
def at_frame(self):
    global frames
    frames += 1
    if frames == 20:
        os.kill(os.getpid(), signal.{name})
    stop(self)
command.StopAtFrame.at_frame = at_frame
"""
    outcome = command_line("replay", case.log, "-s", case.scene, "-o", out, code=kill)
    assert outcome.returncode == code
    assert word in outcome.stderr
    assert "Traceback" not in outcome.stderr
    assert outcome.stdout == ""
    assert [path.name for path in tmp_path.iterdir()] == ["out.partial.mcap"]
    partial = tmp_path / "out.partial.mcap"
    assert metadata(partial)["complete"] == "false"
    assert metrics_frames(partial) == 20
    assert partial.name in outcome.stderr


def test_a_topic_that_is_not_there_is_said(case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_log(tmp_path / "other.mcap", topic="/tracker/thumb")
    assert run(["replay", str(tmp_path / "other.mcap"), "-s", str(case.scene)]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "/tracker/finger" in error
    assert "/tracker/thumb" in error


def test_a_cut_log_names_recover_and_replays_with_it(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = tmp_path / "cut.mcap"
    write_log(cut, frames=20_000)
    cut.write_bytes(cut.read_bytes()[:-60_000])
    out = tmp_path / "out.mcap"
    assert run(["replay", str(cut), "-s", str(case.scene), "-o", str(out)]) == 1
    error = capsys.readouterr().err
    assert "--recover" in error
    assert error.count("\n") == 1
    assert not out.exists()
    assert run(["replay", str(cut), "-s", str(case.scene), "-o", str(out), "--recover", "--json"]) == 0
    assert any(m["level"] == "warning" for m in json.loads(capsys.readouterr().out)["messages"])
    assert metrics_frames(out) > 1000
