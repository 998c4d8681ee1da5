"""Every open, write, fsync and rename of an output, failing one after the other: one line, and nothing half done is left."""

from __future__ import annotations

import errno
import io
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from geomphys_cli.main import COMMANDS, run

from geomphys.authoring.demo_files import DemoFiles
from tests.cli.batch_here import run_here
from tests.cli.every_command import every_command
from tests.cli.press import Case
from tests.cli.test_outputs_never_replace_inputs import furnished
from tests.made import Results

__all__ = ["furnished"]


QUICK = ("init", "decompose", "snapshot", "foxglove")
SLOW = ("plot", "diff", "replay", "ros2", "demo", "batch", "export", "lerobot", "video", "calibrate", "audit")
SEVERAL = {"diff", "replay", "ros2", "demo", "batch", "export", "lerobot"}
"""These write several files; one may be whole before the next fails."""


def test_every_command_that_writes_is_walked(
    furnished: Case, pressed: Results, landed: Results, root: Path, tmp_path: Path
) -> None:
    calls = every_command(furnished, pressed, landed, root, tmp_path)
    assert {name for name, call in calls.items() if call.writes} == {*QUICK, *SLOW}


@pytest.mark.parametrize("command", [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)])
def test_any_call_that_fails_is_one_line_and_leaves_what_was_there(
    command: str, furnished: Case, pressed: Results, landed: Results, root: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "outputs"
    folder.mkdir()
    call = every_command(furnished, pressed, landed, root, folder)[command]
    if command == "calibrate":
        name = call.writes
    else:
        (folder / "hand.toml").unlink()
        name = call.writes if command not in ("export", "lerobot") else ""
        if command == "demo":
            name = "demo/press.mcap"
        if name:
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(b"an earlier output")
    script = Path(__file__).with_name("file_faults.py")
    begin = [sys.executable, script, folder, *call.words]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(root), *filter(None, sys.path)])}
    done = subprocess.run([str(word) for word in begin], capture_output=True, text=True, timeout=900, env=environment)
    assert done.returncode == 0, done.stderr
    ends = [json.loads(line) for line in done.stdout.splitlines()]
    assert {end["call"] for end in ends} >= {"open", "fsync", "replace"} | ({"write"} if command != "video" else set())
    for end in ends:
        assert end["code"] in (1, 2, 3), end  # 2: diff in trouble; 3: a log of a batch failed
        assert "Traceback" not in end["said"], end
        assert end["lost"] == end["broken"] == [], end
        assert not [name for name in end["changed"] if name.endswith(".tmp") or name.startswith(".running/")], end
        lines = end["said"].splitlines()
        assert lines[-1].startswith("geomphys: error: "), end
        assert command == "batch" or len(lines) == 1, end
        if command not in SEVERAL:
            is_published = end["call"] == "fsync" and end["number"] == 2  # of the folder, after the rename
            assert end["changed"] == ([name] if is_published else []), end


READS_NO_FILE = {"completion", "schema"}
"""They print a text."""
SLOW_TO_READ = {"calibrate", "bench"}


@pytest.mark.parametrize(
    "command",
    [
        *(name for name in (*COMMANDS, "foxglove") if name not in READS_NO_FILE | SLOW_TO_READ),
        *(pytest.param(name, marks=pytest.mark.slow) for name in sorted(SLOW_TO_READ)),
    ],
)
def test_any_input_that_cannot_be_opened_is_one_line(
    command: str,
    furnished: Case,
    pressed: Results,
    root: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Each file in turn, each time that it is opened: what was there at the first look may be gone at the second.

    A batch runs its jobs in this process, `view` has a viewer that ends at once; no scene comes from the cache, which would
    be passed over for one that is loaded.
    """
    monkeypatch.setattr("geomphys.load.load_cached_world", lambda *given: None)
    monkeypatch.setattr("geomphys.batch.run.run_in_processes", run_here)
    monkeypatch.setattr("geomphys.viewer.view.viewer_command", lambda: ["/bin/true"])
    files = DemoFiles(furnished.log, furnished.scene)
    monkeypatch.setattr("geomphys.authoring.demo_files.demo_files", lambda: files)
    folder = furnished.folder / "outputs"
    folder.mkdir()
    words = every_command(furnished, pressed, pressed, root, folder)[command].words
    inputs = (furnished.folder, pressed.out.parent, root / "recordings", root / "assets")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    left, opens = 0, io.open

    def opened(file: Any, mode: str = "r", *more: Any, **options: Any) -> Any:
        nonlocal left
        if (
            isinstance(file, str | Path)
            and "w" not in mode
            and folder not in Path(file).parents
            and any(map(Path(file).is_relative_to, inputs))
        ):
            left -= 1
            if left == 0:
                raise OSError(errno.EIO, "made to fail", str(file))
        return opens(file, mode, *more, **options)

    monkeypatch.setattr("io.open", opened)
    monkeypatch.setattr("builtins.open", opened)
    for number in range(1, 100):
        left = number
        code = run(words)
        said = capsys.readouterr().err
        if left > 0:
            break
        assert code in (1, 2, 3), (number, said)
        left_there = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
        page = left_there.pop("a.html", b"") if command == "diff" else b""  # one of its two files may be whole
        if b"No pictures" in page:  # it says so itself
            (folder / "a.html").unlink(), (folder / "d.rrd").unlink()
            continue
        assert said.startswith("geomphys: error: "), said
        assert said.count("\n") == 1, said
        if code == 3:
            assert "manifest.json tells why" in said
            (folder / "manifest.json").unlink()
            said = left_there.pop("manifest.json").decode()
        assert "made to fail" in said, said
        assert left_there == before
    assert number > 1, "it opens no file"


@pytest.mark.parametrize("command", ["init", "diff", "plot", "decompose"])
def test_a_disk_that_is_full_leaves_one_line_and_no_file(
    command: str, furnished: Case, pressed: Results, tmp_path: Path
) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=4k", "tmpfs", str(disk)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("a file system cannot be mounted here")
    try:
        (disk / "full").write_bytes(bytes(4096))
        words: dict[str, list[object]] = {
            "init": ["init", furnished.log, "--urdf", furnished.folder / "cup.urdf", "-o", disk / "a.toml"],
            "plot": ["plot", pressed.out, "-o", disk / "a.png"],
            "diff": ["diff", pressed.out, pressed.raised, "--rrd", disk / "d.rrd"],
            "decompose": ["decompose", furnished.folder / "cube.obj", "-o", disk / "a.glb"],
        }
        begin = [sys.executable, "-P", "-m", "geomphys_cli", *words[command], "-q"]
        done = subprocess.run([str(word) for word in begin], capture_output=True, text=True, timeout=300)
        assert done.returncode in (1, 2)
        (line,) = done.stderr.splitlines()
        assert line.startswith(f"geomphys: error: {disk}"), line
        assert "is the disk full" in line
        assert [path.name for path in disk.iterdir()] == ["full"]
    finally:
        subprocess.run(["umount", str(disk)], check=True)


@pytest.mark.parametrize("words", [["view", "--web"], ["video", "-j", "2", "-o", "a.gif"], ["snapshot", "-o", "a.png"]])
def test_a_temporary_folder_that_is_full_is_said(
    pressed: Results,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    words: list[str],
) -> None:
    def write(*given: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("geomphys.output.output_world.write_attachments", write)
    assert run([*words, str(pressed.out)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("(No space left on device); set TMPDIR to another folder")
    assert list(tmp_path.iterdir()) == []


def test_processes_that_find_no_temporary_folder_are_one_line(
    case: Case, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def made() -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("geomphys.storage.process_pool.TemporaryFolder", made)
    assert run(["batch", str(case.log), "-s", str(case.scene), "-O", str(tmp_path / "out"), "-q"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "processes cannot be started (No space left on device); is the disk full?" in line
