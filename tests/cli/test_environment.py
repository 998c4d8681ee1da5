"""Odd surroundings: absurd numbers, no home, no passwd entry, closed streams, the C locale, names that are not UTF-8."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
import pytest
from geomphys_cli.cmd_calibrate import StretchType, TouchType
from geomphys_cli.main import COMMANDS, cli, run

import geomphys
from geomphys.errors import ConfigError
from tests.cli.every_command import every_command
from tests.cli.press import Case
from tests.cli.test_outputs_never_replace_inputs import furnished
from tests.made import Results

__all__ = ["furnished"]

COMMAND = [sys.executable, "-P", "-m", "geomphys_cli"]


@pytest.mark.parametrize(
    "words",
    [
        ["--seed", "9" * 30],
        ["--seed", "-1"],
        ["--rate", "1e300"],
        ["--rate", "1e-300"],
        ["--rate", "1e9"],
        ["--rate", "nan"],
        ["--max-gap", "1e300"],
        ["--max-gap", "inf"],
        ["--start", "1e300"],
        ["--end", "nan"],
    ],
)
def test_absurd_numbers_are_wrong_usage(case: Case, words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["replay", str(case.log), "-s", str(case.scene), *words]) == 2
    said = capsys.readouterr().err
    assert said.startswith("geomphys: error: ")
    assert said.count("\n") == 1
    assert words[0].strip("-") in said


@pytest.mark.parametrize("name", COMMANDS)
def test_no_number_beyond_reason_is_taken_by_any_option(
    name: str, furnished: Case, pressed: Results, root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of all options that are numbers; with a threshold that is no number a gate would let everything through."""
    words = every_command(furnished, pressed, pressed, root, tmp_path)[name].words
    command = cli.get_command(click.Context(cli), name)
    assert command is not None
    for option in command.params:
        if not isinstance(option.type, click.IntRange | click.FloatRange | StretchType | TouchType):
            continue
        for wrong in ("nan", "inf", "-1", "1e300", "9" * 30, "x", ""):
            values = [f"0:{wrong}"] if isinstance(option.type, StretchType) else option.nargs * [wrong]
            assert run([*words, option.opts[0], *values]) == 2, (option.opts, wrong)
            said = capsys.readouterr()
            assert said.err.startswith("geomphys: error: "), said.err
            assert said.err.count("\n") == 1, said.err
            assert said.out == ""


@pytest.mark.parametrize(
    "wrong",
    [
        {"seed": 10**30}, {"seed": -1}, {"seed": 1.5}, {"rate": 1e300}, {"rate": 1e-300}, {"rate": math.nan},
        {"rate": 10**5000}, {"max_gap": math.inf}, {"max_delay": 1e300}, {"start": 10**400}, {"max_impacts": 10**30},
        {"max_iterations": 0}, {"method": "x" * 1000}, {"time": "a\nb"},
    ],
)  # fmt: skip
def test_absurd_parameters_of_the_library_are_one_line(wrong: dict[str, Any]) -> None:
    (name,) = wrong
    with pytest.raises(ConfigError) as caught:
        geomphys.Config(**wrong)
    said = str(caught.value)
    assert said.startswith(f"{name} = ")
    assert said.isprintable()
    assert len(said) < 200


@pytest.mark.parametrize("stream", ["stdout", "stderr", "stdin"])
def test_a_stream_that_is_closed_is_no_traceback(case: Case, tmp_path: Path, stream: str) -> None:
    number = {"stdin": 0, "stdout": 1, "stderr": 2}[stream]
    words = ["replay", str(case.log), "-s", str(case.scene), "-o", str(tmp_path / "out.mcap"), "-q"]
    shell = " ".join(f"'{word}'" for word in [*COMMAND, *words]) + f" {number}>&-"
    done = subprocess.run(["/bin/sh", "-c", shell], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr + done.stdout
    assert geomphys.open_output(tmp_path / "out.mcap").complete


def test_a_name_that_is_not_utf_8_in_the_c_locale(case: Case, tmp_path: Path) -> None:
    log = tmp_path / os.fsdecode(b"take\xff\xe9.mcap")
    log.write_bytes(case.log.read_bytes())
    out = tmp_path / os.fsdecode(b"out\xff.mcap")
    environment = {key: value for key, value in os.environ.items() if not key.startswith("LC_")} | {"LC_ALL": "C"}
    commands = (
        ["replay", log, "-s", case.scene, "-o", out, "--force"],
        ["info", log],
        ["check", log, "-s", case.scene],
        ["stats", out],
    )
    code = (  # one process runs them all: the locale is the process's
        "import sys; from geomphys_cli.main import run\n"
        "for line in sys.argv[1:]:\n"
        "    for more in ([], ['--json']): assert run([*line.split('\\n'), *more]) == 0, line"
    )
    words = ["\n".join(map(str, command)) for command in commands]
    done = subprocess.run([sys.executable, "-P", "-c", code, *words], capture_output=True, timeout=300, env=environment)
    assert done.returncode == 0, done.stderr
    assert b"Traceback" not in done.stderr


@pytest.mark.skipif(os.getuid() != 0, reason="only root becomes another user")
@pytest.mark.parametrize("command", ["info", "check"])
def test_no_home_and_no_passwd_entry(case: Case, command: str) -> None:
    """A container that runs as some number: the caches go to the temporary folder."""
    for path in (case.log, *case.log.parents):
        if path.stat().st_uid == 0 and path.parts[:2] == ("/", "tmp") and len(path.parts) > 2:
            path.chmod(path.stat().st_mode | (0o055 if path.is_dir() else 0o044))
    code = (
        "import os, sys, tempfile; from geomphys.storage.cache import user_cache_folder; from geomphys_cli.main import run\n"
        "assert run(sys.argv[1:]) == 0\n"
        "user_cache_folder.cache_clear(); os.setgid(54321); os.setuid(54321)\n"
        "for name in ('HOME', 'XDG_CACHE_HOME'): os.environ.pop(name, None)\n"
        "print(user_cache_folder('worlds')); sys.exit(run(sys.argv[1:]))"
    )
    scene = [] if command == "info" else ["--scene", str(case.scene)]
    words = [command, str(case.log), *scene]
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "geomphys-54321" in done.stdout


def test_without_shared_memory_commands_work_or_say_so_in_one_line(
    case: Case, pressed: Results, tmp_path: Path
) -> None:
    """A container whose /dev/shm cannot be written to: processes cannot share work."""
    alone = ["unshare", "-m", "sh", "-c", 'mount -t tmpfs -o ro tmpfs /dev/shm && exec "$0" "$@"']
    if shutil.which("unshare") is None or subprocess.run([*alone, "true"], capture_output=True).returncode != 0:
        pytest.skip("a file system cannot be mounted here")
    out, folder, small = tmp_path / "out.mcap", tmp_path / "batch", ["--size", "64", "64", "--to", "0.1"]
    for code, words in (
        (0, ["replay", case.log, "-s", case.scene, "-o", out]),
        (1, ["batch", case.log, "-s", case.scene, "-O", folder]),
        (1, ["video", pressed.out, "-o", tmp_path / "a.gif", "-j", "2", *small]),
        (0, ["video", pressed.out, "-o", tmp_path / "a.gif", "-j", "1", *small]),
    ):
        done = subprocess.run([*alone, *COMMAND, *map(str, words), "-q"], capture_output=True, text=True, timeout=300)
        assert done.returncode == code, done.stderr
        said = "geomphys: error: /dev/shm: processes cannot share work here (Read-only file system); make it writable\n"
        assert done.stderr == (said if code else ""), words
