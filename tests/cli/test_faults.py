"""Replays that are killed at any moment, run out of disk, or lose who reads them: the output's name never holds a part of it."""

from __future__ import annotations

import hashlib
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from geomphys_cli.main import run

import geomphys
from tests.cli.press import Case, command_line, write_log

FRAMES = 2400
KILLS, SEED = 50, 1


@pytest.mark.parametrize("kills", [9, pytest.param(KILLS, marks=pytest.mark.slow)])
def test_a_replay_that_is_killed_leaves_no_part_under_the_name(case: Case, tmp_path: Path, kills: int) -> None:
    """Signals of three kinds, spread over a replay; and disks that are full sooner or later."""
    frames = FRAMES if kills == KILLS else FRAMES // 2
    write_log(tmp_path / "long.mcap", frames=frames)
    (tmp_path / "results").mkdir()
    script = Path(__file__).with_name("faults.py")
    words = [script, tmp_path / "long.mcap", case.scene, tmp_path / "results", kills, SEED, "no"]
    outcome = subprocess.run(
        [sys.executable, *map(str, words)],
        capture_output=True,
        text=True,
        timeout=600,
        env={**os.environ, "NO_COLOR": "1"},
    )
    assert outcome.returncode == 0, outcome.stderr
    runs = [json.loads(line) for line in outcome.stdout.splitlines() if line.startswith('{"signal"')]
    assert len(runs) == kills + 4
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
        assert set(one["left"]) == {"out.mcap"} or one["code"] != 0, (
            one
        )  # and what a SIGKILL before left hidden has gone
        if one["signal"] != signal.SIGKILL and one["code"] > 0:  # one that was stopped before it looked leaves that
            assert set(one["left"]) - set(one["before"]) <= {"out.mcap", "out.partial.mcap"}, one
        if one["signal"] is None:
            assert not one["left"], one
    whole = [geomphys.open_output(path) for path in (tmp_path / "results" / "kept").glob("*.out.mcap")]
    assert whole
    assert all(log.complete and sum(1 for _ in log.frames()) == frames for log in whole)
    parts = [geomphys.open_output(path) for path in (tmp_path / "results" / "kept").glob("*.out.partial.mcap")]
    assert parts, "no kill came in the middle"
    # a signal between the last frame and the end leaves every frame in a file that is not complete
    assert all(not log.complete and sum(1 for _ in log.frames()) == log.frame_count <= frames for log in parts)
    assert any("partial" in one["said"] for one in runs)


def outputs(folder: Path, suffix: str) -> set[bytes]:
    """Hashes of the files with final names in a folder, and of none that is not complete."""
    files = [path for path in folder.glob(f"*.{suffix}") if ".partial." not in path.name]
    return {hashlib.sha256(path.read_bytes()).digest() for path in files}


def same_recording(one: Path, other: Path) -> None:
    """The viewer finds two recordings equal; chunks may be cut elsewhere."""
    words = [sys.executable, "-m", "rerun", "rrd", "compare", "--unordered", str(one), str(other)]
    outcome = subprocess.run(words, capture_output=True, text=True, timeout=120)
    assert outcome.returncode == 0, one


@pytest.mark.parametrize("kills", [3, pytest.param(KILLS, marks=pytest.mark.slow)])
def test_with_a_recording_for_rerun_neither_name_holds_a_part(case: Case, tmp_path: Path, kills: int) -> None:
    """What stands under a final name is a whole replay; a run over the leavings of a kill is as any other."""
    write_log(tmp_path / "long.mcap", frames=FRAMES // (4 if kills == KILLS else 8))
    folder = tmp_path / "results"
    folder.mkdir()
    script = Path(__file__).with_name("faults.py")
    words = [script, tmp_path / "long.mcap", case.scene, folder, kills, SEED, "rrd"]
    outcome = subprocess.run([sys.executable, *map(str, words)], capture_output=True, text=True, timeout=900)
    assert outcome.returncode == 0, outcome.stderr
    runs = [json.loads(line) for line in outcome.stdout.splitlines() if line.startswith('{"signal"')]
    assert len(runs) == kills
    for one in runs:
        assert "Traceback" not in one["said"], one
        assert {"out.mcap", "out.rrd"} <= set(one["left"]) or one["code"] != 0, one
        hidden = {name for name in one["left"] if name.startswith(".")}
        assert all(re.fullmatch(r"\.out\.(mcap|rrd)\.[0-9a-f]{8}\.tmp", name) for name in hidden), one
    assert len(outputs(folder / "kept", "mcap")) == 1
    whole = folder / "kept" / "0.out.rrd"
    for path in [path for path in (folder / "kept").glob("*.out.rrd") if path != whole]:
        same_recording(path, whole)
    assert run(["replay", str(words[1]), "-s", str(case.scene), "-o", str(folder / "out.mcap"), "--rrd",
                str(folder / "out.rrd"), "--no-timing", "-q"]) == 0  # fmt: skip
    same_recording(folder / "out.rrd", whole)
    assert not list(folder.glob(".out*"))


@pytest.mark.parametrize("kills", [1, pytest.param(KILLS, marks=pytest.mark.slow)])
def test_a_batch_that_is_killed_leaves_whole_outputs_and_is_resumed(case: Case, tmp_path: Path, kills: int) -> None:
    """The quick one writes no recordings for rerun; that those are whole is seen in the slow one and above."""
    (tmp_path / "logs").mkdir()
    names, rrd = ("abc", ["--rrd"]) if kills == KILLS else ("ab", [])
    for name in names:
        write_log(tmp_path / "logs" / f"{name}.mcap", frames=FRAMES // 8)
    folder, chance = tmp_path / "out", random.Random(SEED)

    def batch(into: Path, *more: str) -> subprocess.Popen[str]:
        script = "from geomphys_cli.main import main; main()"
        words = [
            "batch",
            str(tmp_path / "logs"),
            "-s",
            str(case.scene),
            "-O",
            str(into),
            "-j",
            "2",
            "--no-timing",
            *rrd,
        ]
        return subprocess.Popen([sys.executable, "-c", script, *words, *more], stderr=subprocess.PIPE, text=True,
                                stdout=subprocess.DEVNULL)  # fmt: skip

    begin = time.monotonic()
    first = batch(tmp_path / "whole")
    assert "Traceback" not in first.communicate(timeout=300)[1]
    assert first.returncode == 0
    seconds = time.monotonic() - begin
    whole = {path.name: path.read_bytes() for path in (tmp_path / "whole").glob("*.*") if path.suffix != ".json"}
    assert len(whole) == len(names) * (1 + len(rrd))
    for _ in range(kills):
        child = batch(folder, "--force")
        time.sleep(chance.uniform(0.3, 1.0) * seconds)
        number = chance.choice((signal.SIGKILL, signal.SIGTERM, signal.SIGINT))
        child.send_signal(number)
        said = child.communicate(timeout=300)[1]
        assert child.returncode in (0, -number, 128 + number), said
        # a worker that is just starting when SIGKILL takes its parent is cut off by Python's own words
        assert number == signal.SIGKILL or "Traceback" not in said
        for path in folder.glob("[abc].*"):
            if path.suffix == ".rrd" and ".partial." not in path.name:
                same_recording(path, tmp_path / "whole" / path.name)
            assert ".partial." in path.name or path.suffix == ".rrd" or path.read_bytes() == whole[path.name], path
        manifest = folder / "manifest.json"
        assert not manifest.exists() or json.loads(manifest.read_text())["format"] == 1
    resumed = batch(folder, "--resume")
    assert "Traceback" not in resumed.communicate(timeout=300)[1]
    assert resumed.returncode == 0
    left = {path.name: path.read_bytes() for path in folder.glob("[abc].*") if ".partial." not in path.name}
    assert left.keys() == whole.keys()
    for name, data in whole.items():
        if name.endswith(".mcap"):
            assert left[name] == data
        else:
            same_recording(folder / name, tmp_path / "whole" / name)
    assert not (folder / ".running").exists()


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A folder on a disk of 64 KiB; skipped where nothing may be mounted."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("a file system cannot be mounted here")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.parametrize("outputs", [["-o", "out.mcap"], ["--rrd", "out.rrd"], ["-o", "out.mcap", "--rrd", "out.rrd"]])
def test_a_disk_that_is_full_leaves_one_line_and_no_file(
    case: Case, tmp_path: Path, small_disk: Path, outputs: list[str]
) -> None:
    write_log(tmp_path / "long.mcap", frames=FRAMES)
    placed = [str(small_disk / word) if word.startswith("out") else word for word in outputs]
    outcome = command_line("replay", tmp_path / "long.mcap", "-s", case.scene, *placed, "-q")
    assert outcome.returncode == 1
    (line,) = outcome.stderr.splitlines()
    assert line.startswith(f"geomphys: error: {small_disk}")
    assert "is the disk full" in line
    assert not [path.name for path in small_disk.iterdir() if "partial" not in path.name]


def test_ctrl_c_ahead_of_the_first_frame_leaves_a_readable_part_or_none(case: Case, tmp_path: Path) -> None:
    """A part without frames has its metadata, says that it is not complete, and reads as one."""
    words = ("replay", case.log, "-s", case.scene, "-o", tmp_path / "out.mcap", "--rrd", tmp_path / "out.rrd")
    code = (
        "import geomphys.engine.pipeline as p, os, signal\n"
        "p.Pipeline.__init__ = lambda *a, **k: os.kill(os.getpid(), signal.SIGINT)\n"
    )
    outcome = command_line(*words, code=code)
    assert outcome.returncode == 130, outcome.stderr
    assert "Traceback" not in outcome.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.partial.mcap", "out.partial.rrd"]
    part = geomphys.open_output(tmp_path / "out.partial.mcap")
    assert not part.complete
    assert part.frame_count == 0
    assert list(part.frames()) == []


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
    assert outcome.returncode == 0
    assert "Traceback" not in outcome.stderr
    assert "Exception" not in outcome.stderr
    assert geomphys.open_output(tmp_path / "out.mcap").complete
