"""Was: where a reader had closed the pipe (``| head -1``) a command ended with exit code 1, and a replay early."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from geomphys_cli.main import COMMANDS, run

from tests.made import Results

ROOT = Path(__file__).resolve().parents[2]

ENDS_OTHERWISE = {"diff": 1}
"""Command -> its exit code where it is not 0: the two results differ."""


@contextmanager
def nobody_reads(monkeypatch: pytest.MonkeyPatch, *names: str) -> Iterator[None]:
    """Lets standard streams be a pipe whose other end is closed."""
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as stream, monkeypatch.context() as patched:
        for name in names:
            patched.setattr(sys, name, stream)
        try:
            yield
        finally:
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, write)
            os.close(null)


def calls(made: Results, folder: Path) -> dict[str, list[str]]:
    """Command -> arguments with which it prints a result."""
    log, scene, out = str(made.log), str(made.scene), str(made.out)
    return {
        "replay": [log, "--scene", scene, "-o", "-"],
        "batch": [log, "--scene", scene, "-O", str(folder / "batch"), "--jobs", "1"],
        "diff": [out, str(made.raised)],
        "stats": [out],
        "plot": [out, "-o", "-"],
        "audit": [out],
        "check": [log, "--scene", scene],
        "info": [log],
        "snapshot": [out, "-o", "-", "--size", "64", "64"],
        "video": [out, "-o", str(folder / "press.gif"), "--size", "64", "64", "--to", "0.1"],
        "export": [out, "--foxglove", "-"],
        "decompose": [str(ROOT / "assets" / "hand" / "meshes" / "wrist.obj")],
        "schema": [],
        "completion": ["bash"],
    }


COVERED = ("replay", "batch", "diff", "stats", "plot", "audit", "check", "info", "snapshot", "video", "export", "decompose",
           "schema", "completion")  # fmt: skip


@pytest.mark.parametrize("name", COVERED)
def test_a_result_that_nobody_reads_is_no_error(
    name: str, pressed: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = calls(pressed, tmp_path)[name]
    with nobody_reads(monkeypatch, "stdout"):
        code = run([name, *arguments])
    assert code == ENDS_OTHERWISE.get(name, 0)
    assert "error" not in capsys.readouterr().err


@pytest.mark.parametrize("name", COMMANDS)
def test_help_that_nobody_reads_is_no_error(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with nobody_reads(monkeypatch, "stdout"):
        assert run([name, "-h"]) == 0


def test_messages_that_nobody_reads_do_not_end_a_replay(
    pressed: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out.mcap"
    with nobody_reads(monkeypatch, "stdout", "stderr"):
        assert run(["replay", str(pressed.log), "--scene", str(pressed.scene), "-o", str(out), "-v"]) == 0
    assert out.is_file()


def test_a_process_ends_without_a_word(pressed: Results) -> None:
    line = f'set -o pipefail; "{sys.executable}" -m geomphys_cli stats "{pressed.out}" | head -1'
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.strip() == "out.mcap"


def test_a_pipe_to_another_program_that_breaks_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    from geomphys_cli import cmd_schema

    def broken(name: str) -> None:
        raise BrokenPipeError(32, "Broken pipe")

    monkeypatch.setattr(cmd_schema.schema, "callback", broken)
    assert run(["schema"]) == 1
