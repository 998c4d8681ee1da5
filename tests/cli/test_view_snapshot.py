"""``geomphys view`` and ``geomphys snapshot``: what they refuse, and a viewer that fails."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from geomphys_cli.main import run


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A file with the right name and nothing in it."""
    path = tmp_path / "out.rrd"
    path.write_bytes(b"")
    return path


def test_view_without_a_screen_names_the_other_ways(
    recording: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert run(["view", str(recording)]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "--web" in error
    assert "geomphys snapshot" in error


PANIC = "thread 'main' panicked at a.rs:1:2:\\nnote: run with RUST_BACKTRACE=1"
ENDS = {
    "it said nothing": "sys.exit(1)",
    "Error: no display": "sys.stderr.write('a\\n' * 9999 + 'Error: no display\\n   0: inner\\n   1: outer\\n'); sys.exit(1)",
    "thread 'main' panicked at a.rs:1:2:": f'sys.stderr.write("{PANIC}"); sys.exit(101)',
    "[31mred": r"sys.stderr.write('\\x1b[31mred\\r\\n'); sys.exit(1)",
    "\ufffd\ufffd": "os.write(2, b'\\xff\\xfe'); sys.exit(1)",
    200 * "x": "sys.stderr.write('x' * 10**6); sys.exit(1)",
    "half": "sys.stderr.write('half'); sys.stderr.flush(); os.abort()",
    "found no graphics adapter": "sys.stderr.write('a\\nError: Failed to find a suitable GPU Adapter\\nb\\n'); sys.exit(1)",
}
"""What is told of a viewer -> what it does instead of starting."""


@pytest.fixture
def viewer(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Puts a program of a few lines in the place of the viewer; a screen seems to be there."""
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("DISPLAY", ":0")

    def put(code: str) -> None:
        command = [sys.executable, "-S", "-c", f"import os, sys; {code}"]
        for module in ("view", "snapshot"):
            monkeypatch.setattr(f"geomphys.viewer.{module}.viewer_command", lambda: command)

    return put


@pytest.mark.parametrize("told", ENDS)
@pytest.mark.parametrize("words", [["view"], ["view", "--web"], ["snapshot", "-o", "{folder}/a.png"]])
def test_a_viewer_that_cannot_start_is_one_line(
    words: list[str],
    told: str,
    recording: Path,
    viewer: Callable[[str], None],
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Whatever it prints, and also if a signal ends it."""
    viewer(ENDS[told])
    folder = recording.parent
    assert run([word.format(folder=folder) for word in words] + [str(recording)]) == 1
    said = capfd.readouterr()
    assert said.out == ""
    (line,) = said.err.splitlines()
    assert line.startswith("geomphys: error: ")
    assert told in line
    assert line.isprintable()
    assert ("(signal 6)" in line) == (told == "half")
    assert [path.name for path in folder.iterdir()] == ["out.rrd"]


def test_the_address_of_the_page_is_said(
    recording: Path, viewer: Callable[[str], None], capfd: pytest.CaptureFixture[str]
) -> None:
    """A browser that outlives the viewer and holds its stderr is not waited for."""
    page = "http://127.0.0.1:9090?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A9876%2Fproxy"
    browser = "import subprocess; subprocess.Popen(['sleep', '5'])"
    viewer(f"{browser}; sys.stderr.write('[INFO] Web Viewer at {page}\\n')")
    begin = time.monotonic()
    assert run(["view", "--web", str(recording)]) == 0
    assert capfd.readouterr().err == f"shown at {page}; Ctrl-C ends it\n"
    assert time.monotonic() - begin < 4.0


def test_a_signal_ends_the_viewer_too(
    recording: Path, viewer: Callable[[str], None], capfd: pytest.CaptureFixture[str]
) -> None:
    """Also if only the command gets it."""
    started = recording.with_name("started")
    viewer(f"open({str(started)!r}, 'w').write(str(os.getpid())); import time; time.sleep(60)")

    def stop_when_started() -> None:
        while not (started.exists() and started.read_text()):
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=stop_when_started, daemon=True).start()
    assert run(["view", str(recording)]) == 143
    assert capfd.readouterr().err == "geomphys: error: terminated\n"
    with pytest.raises(ProcessLookupError):
        os.kill(int(started.read_text()), 0)


@pytest.mark.parametrize("words", [["view", "--web"], ["snapshot", "-o", "{folder}/a.png"]])
def test_what_is_no_result_is_said(words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "notes.txt").write_text("no result")
    assert run([word.format(folder=tmp_path) for word in words] + [str(tmp_path / "notes.txt")]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "notes.txt" in error


def test_a_picture_is_not_overwritten(recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "a.png"
    picture.write_bytes(b"old")
    assert run(["snapshot", str(recording), "-o", str(picture)]) == 2
    assert "--force" in capsys.readouterr().err
    assert picture.read_bytes() == b"old"


@pytest.mark.parametrize("words", [["--frame", "-1"], ["--size", "0", "10"], []])
def test_wrong_options(recording: Path, words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    out = ["-o", "a.png"] if words else []
    assert run(["snapshot", str(recording), *out, *words]) == 2
    assert capsys.readouterr().err.count("\n") == 1
