"""Exit codes and error lines that need no replay."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from geomphys_cli import main as entry
from geomphys_cli.main import run

from geomphys.errors import ConfigError, DamagedLogError, LogError, SceneError
from tests.cli.press import Case, command_line


def one_error_line(stderr: str) -> str:
    """The only line of stderr, which must be an error of the expected form."""
    lines = stderr.splitlines()
    assert len(lines) == 1, stderr
    assert lines[0].startswith("geomphys: error: ")
    return lines[0]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["replai"], "replay"),
        (["replay"], "LOG"),
        (["replay", "{log}"], "--scene"),
        (["replay", "{log}", "--scene", "{folder}/nothing.toml"], "nothing.toml"),
        (["replay", "{folder}/nothing.mcap", "--scene", "{scene}"], "nothing.mcap"),
        (["replay", "{log}", "--scene", "{scene}", "--mode", "soft"], "soft"),
        (["replay", "{log}", "--scene", "{scene}", "--max-gap", "-1"], "-1"),
        (["replay", "{log}", "--scene", "{scene}", "--max-gap", "nan"], "nan"),
        (["replay", "{log}", "--scene", "{scene}", "--start", "2", "--end", "1"], "end"),
        (["replay", "{log}", "--scene", "{scene}", "-o", "{folder}/no/out.mcap"], "folder"),
        (["replay", "{log}", "--scene", "{scene}", "-o", "{folder}"], "directory"),
        (["replay", "{log}", "--scene", "{scene}", "-o", "{log}", "--force"], "input"),
        (["replay", "{log}", "--scene", "{scene}", "-o", "{scene}"], "input"),
        (["replay", "{log}", "--scene", "{scene}", "-o", "{folder}/a", "--rrd", "{folder}/a"], "two outputs"),
        (["replay", "{log}", "--scene", "{scene}", "--frob"], "--frob"),
        (["completion", "tcsh"], "tcsh"),
    ],
)
def test_wrong_usage_is_2_and_one_line(
    case: Case, words: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    places = {"log": case.log, "scene": case.scene, "folder": case.folder}
    assert run([word.format(**places) for word in words]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert says in one_error_line(output.err)


def test_an_output_that_exists_needs_force(case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.mcap"
    out.write_bytes(b"precious")
    assert run(["replay", str(case.log), "--scene", str(case.scene), "-o", str(out)]) == 2
    assert "--force" in one_error_line(capsys.readouterr().err)
    assert out.read_bytes() == b"precious"


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (LogError("a.mcap: no topic /x"), 1),
        (DamagedLogError("a.mcap: cut off at byte 9\nuse --recover"), 1),
        (SceneError("s.toml: \x1b[2Jobject.mass: below 0"), 1),
        (ConfigError("gap = 3: too large"), 2),
        (PermissionError(13, "Permission denied", "a.mcap"), 1),
        (KeyboardInterrupt(), 130),
    ],
)
def test_errors_become_a_line_and_a_code(
    error: BaseException, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(entry.cli, "main", fail)
    assert run([]) == code
    assert one_error_line(capsys.readouterr().err).isprintable()


def test_a_mistake_of_ours_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(entry.cli, "main", fail)
    with pytest.raises(ZeroDivisionError):
        run([])


def test_no_command_shows_help_and_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    assert run([]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith("Usage: geomphys")


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--version"]) == 0
    name, version = capsys.readouterr().out.split()
    assert name == "geomphys"
    assert version[0].isdigit()


def test_names_the_terminal_cannot_encode_are_escaped(case: Case) -> None:
    outcome = command_line("replay", case.folder / "nö\n.mcap", "-s", case.scene, PYTHONIOENCODING="ascii")
    assert outcome.returncode == 2
    assert one_error_line(outcome.stderr)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_script(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["completion", shell]) == 0
    assert "_GEOMPHYS_COMPLETE" in capsys.readouterr().out


def test_completion_offers_commands_and_options() -> None:
    def offered(words: str) -> str:
        count = str(len(words.split()) - (not words.endswith(" ")))
        return command_line(_GEOMPHYS_COMPLETE="bash_complete", COMP_WORDS=words, COMP_CWORD=count).stdout

    assert "plain,replay" in offered("geomphys re")
    assert "plain,--fail-on-penetration" in offered("geomphys replay --fail")
    assert "plain,chains" in offered("geomphys replay --mode ")


def test_schema_is_json_schema(capsys: pytest.CaptureFixture[str]) -> None:
    import json

    assert run(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema["type"] == "object"
    assert {"scene", "object", "avatar", "material_pair"} <= set(schema["properties"])


@pytest.mark.parametrize(
    "words",
    [
        ["replay", "{log}", "-s", "{scene}", "-o", "{folder}/out.bag"],
        ["replay", "{log}", "-s", "{scene}", "--rrd", "{folder}/out.mcap"],
        ["diff", "{log}", "{log}", "--html", "{folder}/page.pdf"],
        ["snapshot", "{log}", "-o", "{folder}/out.jpg"],
        ["plot", "{log}", "-o", "{folder}/out.txt"],
        ["video", "{log}", "-o", "{folder}/out.avi"],
    ],
    ids=lambda words: words[0],
)
def test_a_wrong_ending_is_wrong_usage(case: Case, tmp_path: Path, capsys, words: list[str]) -> None:
    given = [word.format(log=case.log, scene=case.scene, folder=tmp_path) for word in words]
    assert run(given) == 2
    assert "what is written there ends in ." in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_the_package_runs_as_a_module() -> None:
    said = subprocess.run([sys.executable, "-m", "geomphys", "--version"], capture_output=True, text=True, check=True)
    assert said.stdout.startswith("geomphys ")


def test_the_process_ends_without_freeing_objects() -> None:
    """After what is registered with `atexit`, as libraries do; with the exit code, and all that was said."""
    code = (
        "import atexit, geomphys_cli.cmd_schema as command\n"
        "from geomphys_cli.entry import main\n"
        "class Kept:\n def __del__(self): print('freed')\n"
        "kept = Kept()\n"
        "def show(ctx):\n atexit.register(print, 'at exit'); sys.stderr.write('unended line'); return 4\n"
        "command.schema.invoke = show"
    )
    done = command_line("schema", code=code)
    assert (done.returncode, done.stdout, done.stderr) == (4, "at exit\n", "unended line")
