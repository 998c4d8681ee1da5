"""Every command's help works, ends in examples that parse, and asks for nothing heavy."""

from __future__ import annotations

import contextlib
import os
import resource
import shlex
import subprocess
import sys
from pathlib import Path
from unittest import mock

import click
import pytest
from click.testing import CliRunner
from geomphys_cli.main import COMMANDS, cli
from geomphys_cli.options import PathOrUrl

from tests.cli.imported_packages import imported_packages
from tests.house.sources import modules

HEAVY = {
    "numpy",
    "numba",
    "llvmlite",
    "rerun",
    "trimesh",
    "scipy",
    "matplotlib",
    "coacd",
    "pydantic",
    "rich",
    "mcap",
    "yourdfpy",
}


def find(name: str) -> click.Command:
    """A command by its name."""
    command = cli.get_command(click.Context(cli, **cli.context_settings), name)
    assert command is not None
    return command


def parses(words: list[str]) -> None:
    """Raise click.UsageError if a command line (without `geomphys`) is wrong but for paths that do not exist."""
    context = click.Context(cli, info_name="geomphys", **cli.context_settings)
    _, rest, _ = cli.make_parser(context).parse_args(list(words))
    if not rest:
        return
    _, command, rest = cli.resolve_command(context, rest)
    assert command is not None
    with (
        mock.patch.object(click.Path, "convert", lambda self, value, parameter, context: Path(value)),
        mock.patch.object(PathOrUrl, "convert", lambda self, value, parameter, context: Path(value)),
        contextlib.suppress(click.exceptions.Exit),
    ):
        command.make_context(command.name, rest, parent=context)


def test_a_wrong_line_does_not_parse() -> None:
    for line in (
        "replay a --scene b --foo",
        "replay a",
        "replay a b --scene c",
        "replay a -s b --mode soft",
        "repaly x",
    ):
        with pytest.raises(click.UsageError):
            parses(line.split())


def test_the_table_of_commands_is_that_of_the_modules() -> None:
    assert {f"cmd_{name}" for name in COMMANDS} == {name for name in modules("cli") if name.startswith("cmd_")}


@pytest.mark.parametrize("name", [None, *COMMANDS])
@pytest.mark.parametrize("flag", ["-h", "--help"])
def test_help_ends_in_examples_that_parse(name: str | None, flag: str) -> None:
    outcome = CliRunner().invoke(cli, [flag] if name is None else [name, flag])
    assert outcome.exit_code == 0
    head, _, examples = outcome.stdout.partition("\nExamples:\n")
    assert head.startswith("Usage: cli ")
    lines = [line.strip() for line in examples.splitlines()]
    assert lines, "no examples"
    for line in lines:
        words = shlex.split(line, comments=True)
        stop = next((i for i, word in enumerate(words) if word in {">", ">>", "|", "&&"}), len(words))
        assert words[0] == "geomphys"
        assert name is None or words[1] == name
        parses(words[1:stop])


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_is_explained(name: str) -> None:
    command = find(name)
    assert command.help
    for parameter in command.params:
        if isinstance(parameter, click.Option):
            assert parameter.help, f"{name} {parameter.opts}"
            assert parameter.help.endswith("."), f"{name} {parameter.opts}"


@pytest.mark.parametrize("words", [["--help"], *([name, "-h"] for name in COMMANDS)])
def test_help_imports_nothing_heavy(words: list[str]) -> None:
    assert not HEAVY & imported_packages(words)


def test_help_answers_in_a_third_of_a_second_of_cpu() -> None:
    def used() -> float:
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    times = []
    for _ in range(3):
        before = used()
        subprocess.run(
            [sys.executable, "-m", "geomphys_cli", "--help"], stdout=subprocess.DEVNULL, check=True, env=os.environ
        )
        times.append(used() - before)
    assert min(times) <= 0.3
