"""Replays that are killed at any moment, run out of disk, or lose who reads them: the output's name never holds a part of it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import geomphys
from tests.cli.press import Case, command_line, write_log

FRAMES = 2400
KILLS, SEED = 50, 1


def test_a_replay_that_is_killed_leaves_no_part_under_the_name(case: Case, tmp_path: Path) -> None:
    write_log(tmp_path / "long.mcap", frames=FRAMES)
    (tmp_path / "results").mkdir()
    script = Path(__file__).with_name("faults.py")
    words = [script, tmp_path / "long.mcap", case.scene, tmp_path / "results", KILLS, SEED]
    outcome = subprocess.run(
        [sys.executable, *map(str, words)],
        capture_output=True,
        text=True,
        timeout=600,
        env={**os.environ, "NO_COLOR": "1"},
    )
    assert outcome.returncode == 0, outcome.stderr
    runs = [json.loads(line) for line in outcome.stdout.splitlines() if line.startswith('{"signal"')]
    assert len(runs) == KILLS + 4
    expected = {
        signal.SIGINT: (130, -signal.SIGINT),
        signal.SIGTERM: (143, -signal.SIGTERM),
        signal.SIGKILL: (-9,),
        None: (1,),
    }
    for one in runs:
        assert one["code"] == 0 or one["code"] in expected[one["signal"]], one
        assert "Traceback" not in one["said"], one
        lines = one["said"].splitlines()
        assert len(lines) <= 1, one
        assert one["code"] in (0, -9, -2, -15) or lines[0].startswith("geomphys: error: "), one
        assert "out.mcap" in one["left"] or one["code"] != 0, one
        if one["signal"] != signal.SIGKILL and one["code"] > 0:
            assert set(one["left"]) <= {"out.mcap", "out.partial.mcap"}, one
        if one["signal"] is None:
            assert not one["left"], one
    whole = [geomphys.open_output(path) for path in (tmp_path / "results" / "kept").glob("*.out.mcap")]
    assert whole
    assert all(log.complete and sum(1 for _ in log.frames()) == FRAMES for log in whole)
    parts = [geomphys.open_output(path) for path in (tmp_path / "results" / "kept").glob("*.out.partial.mcap")]
    assert parts, "no kill came in the middle"
    assert all(not log.complete and sum(1 for _ in log.frames()) == log.frame_count < FRAMES for log in parts)
    assert any("partial" in one["said"] for one in runs)


def test_a_folder_that_takes_nothing_is_said(case: Case) -> None:
    outcome = command_line("replay", case.log, "-s", case.scene, "-o", "/sys/out.mcap")
    assert outcome.returncode == 1
    (line,) = [line for line in outcome.stderr.splitlines() if "Compiling" not in line]
    assert line.startswith("geomphys: error: /sys/out.mcap: cannot be written")


def test_a_reader_that_went_away_costs_no_output(case: Case, tmp_path: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    script = "from geomphys_cli.main import main; main()"
    words = ["replay", case.log, "-s", case.scene, "-o", tmp_path / "out.mcap", "--json"]
    outcome = subprocess.run(
        [sys.executable, "-c", script, *map(str, words)], stdout=write, stderr=subprocess.PIPE, text=True, timeout=300
    )
    os.close(write)
    assert outcome.returncode == 1
    assert "Traceback" not in outcome.stderr
    assert "Exception" not in outcome.stderr
    assert geomphys.open_output(tmp_path / "out.mcap").complete
