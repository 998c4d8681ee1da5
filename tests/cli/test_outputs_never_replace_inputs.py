"""No command writes over a file it reads or a device; `-` is standard output; what fails leaves nothing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from geomphys_cli.main import run

import geomphys
from tests.cli.every_command import every_command
from tests.cli.press import SCENE, Case, command_line, write_log
from tests.made import Results

CUBE = """
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
f 1 3 2
f 1 4 3
f 5 6 7
f 5 7 8
f 1 2 6
f 1 6 5
f 2 3 7
f 2 7 6
f 3 4 8
f 3 8 7
f 4 1 5
f 4 5 8
"""

URDF = """
<robot name="cup"><link name="cup"><collision><geometry><mesh filename="cube.obj"/></geometry></collision></link></robot>
"""


@pytest.fixture
def furnished(tmp_path: Path) -> Case:
    """A log and a scene with a mesh and a URDF of its own, in a folder of their own."""
    write_log(tmp_path / "press.mcap")
    (tmp_path / "cube.obj").write_text(CUBE)
    (tmp_path / "cup.urdf").write_text(URDF)
    far = 'class = "fixed"\nmaterial = "wood"\nposition = [5.0, 0.0, 0.0]\n'
    more = f'[[object]]\nname = "block"\nmesh = "cube.obj"\n{far}[[object]]\nname = "cup"\nurdf = "cup.urdf"\n{far}'
    (tmp_path / "press.toml").write_text(SCENE + more)
    return Case(tmp_path, tmp_path / "press.mcap", tmp_path / "press.toml")


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("victim", ["press.mcap", "press.toml", "cube.obj", "cup.urdf"])
@pytest.mark.parametrize("name", ["itself", "hard.mcap", "link.mcap"])
@pytest.mark.parametrize("option", ["-o", "--rrd"])
def test_replay_writes_over_no_file_of_its_scene(
    furnished: Case, victim: str, name: str, option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    target = furnished.folder / victim
    if name != "itself":
        name = name if option == "-o" else name.replace("mcap", "rrd")
        target = furnished.folder / name
        target.symlink_to(victim) if name.startswith("link") else os.link(furnished.folder / victim, target)
    before = contents(furnished.folder)
    assert run(["replay", str(furnished.log), "-s", str(furnished.scene), option, str(target), "--force", "-q"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"geomphys: error: {target}: is an input") or "what is written there ends in" in line
    assert contents(furnished.folder) == before


def test_batch_writes_over_no_file_of_its_scene(furnished: Case, capsys: pytest.CaptureFixture[str]) -> None:
    folder = furnished.folder / "out"
    folder.mkdir()
    os.link(furnished.folder / "cube.obj", folder / "press.mcap")
    before = contents(furnished.folder)
    assert run(["batch", str(furnished.log), "-s", str(furnished.scene), "-O", str(folder), "--force", "-q"]) == 2
    assert "is an input" in capsys.readouterr().err
    assert contents(furnished.folder) == before


def test_a_part_that_is_replayed_is_not_overwritten_by_a_new_part(case: Case, tmp_path: Path) -> None:
    """Ctrl-C on `replay take.partial.mcap -o take.mcap` wrote its part over what it was reading."""
    part = tmp_path / "take.partial.mcap"
    write_log(part)
    before = part.read_bytes()
    code = (
        "import geomphys.engine.pipeline as p, os, signal\n"
        "p.Pipeline.__init__ = lambda *a: os.kill(os.getpid(), signal.SIGINT)\n"
    )
    done = command_line("replay", part, "-s", case.scene, "-o", tmp_path / "take.mcap", "--force", code=code)
    assert done.returncode == 2
    assert "is an input" in done.stderr
    assert part.read_bytes() == before


WRITES = (
    "init", "replay", "ros2", "diff", "plot", "audit", "snapshot", "video", "export", "batch", "foxglove", "decompose", "demo",
)  # fmt: skip
"""Calls that write; `calibrate` into the scene that it reads, and the export to LeRobot into a folder that must be new."""


def test_every_command_that_writes_is_tried(furnished: Case, pressed: Results, root: Path, tmp_path: Path) -> None:
    calls = every_command(furnished, pressed, pressed, root, tmp_path)
    assert {name for name, call in calls.items() if call.writes} == {*WRITES, "calibrate", "lerobot"}


@pytest.mark.parametrize("command", WRITES)
@pytest.mark.parametrize("kind", ["fifo", "folder", "link to a device"])
def test_a_target_that_is_no_regular_file_is_refused(
    command: str, kind: str, furnished: Case, pressed: Results, root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = furnished.folder / "outputs"
    folder.mkdir()
    call = every_command(furnished, pressed, pressed, root, folder)[command]
    target = folder / call.writes
    target.parent.mkdir(exist_ok=True)
    if kind == "fifo":
        os.mkfifo(target)
    elif kind == "folder":
        target.mkdir()
    else:
        target.symlink_to("/dev/null")
    before = target.lstat()
    code = run([*call.words, *(["--force"] if command == "demo" else [])])
    said = capsys.readouterr().err
    assert code == 2, said
    assert ("is a folder" in said or "is a directory" in said) if kind == "folder" else "is no regular file" in said
    assert (target.lstat().st_ino, target.lstat().st_mode) == (before.st_ino, before.st_mode)


@pytest.mark.parametrize("command", ["replay", "diff", "plot", "snapshot", "init", "decompose"])
def test_a_device_is_no_target(
    command: str, furnished: Case, pressed: Results, root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = every_command(furnished, pressed, pressed, root, tmp_path)[command]
    words = ["/dev/null" if word == str(tmp_path / call.writes) else word for word in call.words]
    assert "/dev/null" in words
    assert run(words) == 2
    assert "is no regular file" in capsys.readouterr().err
    assert Path("/dev/null").is_char_device()


@pytest.mark.parametrize("command", [name for name in WRITES if name != "demo"])
@pytest.mark.parametrize("how", ["hard", "symbolic"])
def test_no_command_writes_over_a_file_that_it_reads(
    command: str, how: str, furnished: Case, pressed: Results, root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each input in turn, under the name of the output."""
    folder = furnished.folder / "outputs"
    folder.mkdir()
    call = every_command(furnished, pressed, pressed, root, folder)[command]
    inputs = [Path(word) for word in call.words if Path(word).is_absolute() and Path(word).is_file()]
    if furnished.log in inputs:
        inputs += [furnished.folder / "cup.urdf", furnished.folder / "cube.obj"]
    assert inputs
    for read in dict.fromkeys(inputs):
        words, at_stake = call.words, read
        if not read.is_relative_to(furnished.folder):  # shared with other tests: a copy is at stake
            at_stake = furnished.folder / f"copy{read.suffix}"
            at_stake.write_bytes(read.read_bytes())
            words = [str(at_stake) if word == str(read) else word for word in words]
        target = folder / call.writes
        target.unlink(missing_ok=True)
        target.symlink_to(at_stake) if how == "symbolic" else os.link(at_stake, target)
        before = at_stake.read_bytes()
        code = run(words)
        said = capsys.readouterr().err
        assert code == 2, (read, said)
        assert f"{target}: is an input" in said, read
        assert at_stake.read_bytes() == before


def test_a_part_that_is_there_needs_force(case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out.partial.mcap").write_bytes(b"an hour of work")
    words = ["replay", str(case.log), "-s", str(case.scene), "-o", str(tmp_path / "out.mcap"), "-q"]
    assert run(words) == 2
    assert "out.partial.mcap: exists" in capsys.readouterr().err
    assert run([*words, "--force"]) == 0
    assert (tmp_path / "out.partial.mcap").read_bytes() == b"an hour of work"


def test_a_stretch_without_frames_leaves_no_output(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["-o", str(tmp_path / "out.mcap"), "--rrd", str(tmp_path / "out.rrd"), "--start", "100"]
    assert run(["replay", str(case.log), "-s", str(case.scene), *words, "-q"]) == 1
    assert "start = 100 s it has no frames" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_diff_keeps_both_outputs_apart(pressed: Results, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one = str(tmp_path / "x")
    assert run(["diff", str(pressed.out), str(pressed.raised), "--html", one, "--rrd", one]) == 2
    assert "two outputs" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_standard_output_gets_the_file_and_stderr_the_figures(case: Case, tmp_path: Path) -> None:
    """The bytes are those of a named output: its name is in no output."""
    words = ["replay", case.log, "-s", case.scene, "--no-timing", "--json"]
    script = "from geomphys_cli.main import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", script, *map(str, words), "-o", "-"], capture_output=True, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stderr)["frames"] == 60
    assert list(tmp_path.iterdir()) == []
    assert run([*map(str, words), "-o", str(tmp_path / "out.mcap")]) == 0
    assert done.stdout == (tmp_path / "out.mcap").read_bytes()


@pytest.mark.parametrize(
    "what",
    ["replay", "rrd", "plot", "decompose", "init", "html", "overlay", "junit", "snapshot", "video", "foxglove"],
)
def test_every_command_that_writes_a_file_writes_it_to_standard_output(
    what: str,
    furnished: Case,
    pressed: Results,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfdbinary: pytest.CaptureFixture[bytes],
) -> None:
    replay, video = ["replay", furnished.log, "-s", furnished.scene], ["--to", "0.1", "--size", "64", "64", "-j", "1"]
    words, begin = {
        "replay": ([*replay, "-o", "-"], b"\x89MCAP"),
        "rrd": ([*replay, "--rrd", "-"], b"RRF2"),
        "plot": (["plot", pressed.out, "-o", "-"], b"\x89PNG"),
        "decompose": (["decompose", furnished.folder / "cube.obj", "-o", "-"], b"glTF"),
        "init": (["init", furnished.log, "--urdf", furnished.folder / "cup.urdf", "-o", "-"], b"# "),
        "html": (["diff", pressed.out, pressed.out, "--html", "-"], b"<!doctype html>"),
        "overlay": (["diff", pressed.out, pressed.out, "--rrd", "-"], b"RRF2"),
        "junit": (["audit", pressed.out, "--junit", "-"], b"<?xml"),
        "snapshot": (["snapshot", pressed.out, "-o", "-", "--size", "64", "64"], b"\x89PNG"),
        "video": (["video", pressed.out, "-o", "-", *video], b"GIF89a"),
        "foxglove": (["export", pressed.out, "--foxglove", "-"], b"{"),
    }[what]
    before = contents(furnished.folder)
    monkeypatch.chdir(tmp_path)
    assert run([str(word) for word in words]) == 0
    printed, said = capfdbinary.readouterr()
    assert printed.startswith(begin), printed[:100]
    assert b"error" not in said
    assert b"snapshot -" not in said, "the command would read a file of that name"
    assert contents(furnished.folder) == before


@pytest.mark.parametrize(
    "words", [["export", "-o", "-"], ["export", "--lerobot", "-"], ["batch", "-O", "-"], ["demo", "-O", "-"]]
)
def test_a_folder_is_no_standard_output(
    words: list[str],
    pressed: Results,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    read = {"export": [pressed.out], "batch": [pressed.log, "-s", pressed.scene]}.get(words[0], [])
    assert run([words[0], *map(str, read), *words[1:]]) == 2
    assert "standard output is no folder" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("victim", ["cube.obj", "cup.urdf", "bag/part.mcap"])
@pytest.mark.parametrize("motion", ["log", "output"])
def test_audit_writes_over_no_file_that_it_reads(
    furnished: Case, victim: str, motion: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Under a name that ends as a report does: a link leads to the file."""
    folder = furnished.folder
    (folder / "bag").mkdir()
    os.link(furnished.log, folder / "bag" / "part.mcap")
    parts = "rosbag2_bagfile_information:\n  relative_file_paths: [part.mcap]\n"
    (folder / "bag" / "metadata.yaml").write_text(parts)
    read = folder / "bag"
    if motion == "output":
        read = folder / "out.mcap"
        geomphys.run(furnished.log, furnished.scene, out=read)
        victim = victim.replace("bag/part.mcap", "out.mcap")
    os.link(folder / victim, folder / "report.xml")
    before = contents(folder)
    words = ["audit", read, "-s", furnished.scene, "--max-penetration", 50, "--junit", folder / "report.xml"]
    assert run([*map(str, words), "--force", "-q"]) == 2
    assert "is an input" in capsys.readouterr().err
    assert contents(folder) == before


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (["replay", "LOG", "-s", "SCENE"], "-o"),
        (["replay", "LOG", "-s", "SCENE"], "--rrd"),
        (["init", "LOG", "--urdf", "URDF"], "-o"),
        (["diff", "OUT", "OUT"], "--html"),
        (["diff", "OUT", "OUT"], "--rrd"),
        (["plot", "OUT"], "-o"),
        (["snapshot", "OUT"], "-o"),
        (["video", "OUT"], "-o"),
        (["export", "OUT"], "--foxglove"),
        (["audit", "OUT"], "--junit"),
        (["decompose", "MESH"], "-o"),
    ],
)
@pytest.mark.parametrize("name", ["a.bag", "a"])
def test_another_suffix_is_refused_by_every_output_alike(
    words: list[str], option: str, name: str, furnished: Case, pressed: Results, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = furnished.folder
    names = {"LOG": furnished.log, "SCENE": furnished.scene, "OUT": pressed.out}
    names |= {"URDF": folder / "cup.urdf", "MESH": folder / "cube.obj"}
    before = contents(folder)
    assert run([*(str(names.get(word, word)) for word in words), option, str(folder / name)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{folder / name}: ends in {Path(name).suffix or 'no suffix'}; what is written there ends in ." in line
    assert contents(folder) == before


def test_two_replays_to_one_name_leave_a_whole_output(case: Case, tmp_path: Path) -> None:
    write_log(tmp_path / "long.mcap", frames=1200)
    script = "from geomphys_cli.main import main; main()"
    words = [
        "replay",
        str(tmp_path / "long.mcap"),
        "-s",
        str(case.scene),
        "-o",
        str(tmp_path / "out.mcap"),
        "-q",
        "--force",
    ]
    both = [subprocess.Popen([sys.executable, "-c", script, *words]) for _ in range(2)]
    assert [one.wait(timeout=300) for one in both] == [0, 0]
    log = geomphys.open_output(tmp_path / "out.mcap")
    assert log.complete
    assert sum(1 for _ in log.frames()) == 1200
    assert sorted(path.name for path in tmp_path.iterdir()) == ["long.mcap", "out.mcap"]
