"""Entry point: the lazily imported group of commands, and the mapping of errors to messages and exit codes.

Exit codes: 0 done, 1 failed, 2 wrong usage, 3 some inputs failed, 4 a threshold was broken, 130 interrupted (SIGINT),
143 terminated (SIGTERM).
"""

from __future__ import annotations

import gc
import os
import select
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any, TextIO

import click

from .command import SETTINGS, Command, terminal_options, write_examples
from .signals import Stopped, signals_caught
from .terminal import Terminal, silence

EXIT_FAILED = 1
EXIT_USAGE = 2
EXIT_INTERRUPTED = 130
GC_THRESHOLD = 200_000
"""Allocations between garbage collections: more than the modules of a replay make. Python's own 700 cost 10 % of a short one."""

COMMANDS = {
    "demo": "Replay the recording that comes with the package.",
    "init": "Write a first scene file for a log.",
    "calibrate": "Find tracker offset, heights of surfaces and lags from a log.",
    "replay": "Replay a log in a scene and write the corrected motion.",
    "batch": "Replay many logs, by several processes or a cluster.",
    "diff": "Tell what two results differ in.",
    "stats": "Show percentiles of results: penetration, correction, speeds, times.",
    "plot": "Draw a result's curves: times, penetration, correction, contacts.",
    "audit": "Check a result with another engine, or measure any motion: a gate in CI.",
    "check": "Tell whether a log can be replayed in a scene, and how well.",
    "info": "Show what a log holds.",
    "view": "Open a result in the rerun viewer.",
    "snapshot": "Make a picture of one frame, without a screen.",
    "video": "Make a video: recorded and corrected motion side by side.",
    "export": "Write a result as tables: Parquet, CSV, LeRobot.",
    "decompose": "Cut meshes into convex pieces.",
    "bench": "Measure frame times, stage by stage, and those of other engines.",
    "schema": "Print the JSON Schema of the scene file.",
    "completion": "Print the completion script of a shell.",
}
"""Command -> its line in the help, in order; the function `NAME` is in `cmd_NAME.py`."""


class BrokenPipe(Exception):  # noqa: N818
    """Carries a BrokenPipeError past ``click``, which would make an exit code of it that says nothing."""


@contextmanager
def broken_pipes_passed_on() -> Iterator[None]:
    """Raise `BrokenPipe` from a BrokenPipeError of the block."""
    try:
        yield
    except BrokenPipeError as error:
        raise BrokenPipe from error


class LazyGroup(click.Group):
    """The commands of `COMMANDS`; the module of a command is imported on use."""

    @broken_pipes_passed_on()
    def make_context(self, *args: Any, **extra: Any) -> click.Context:
        """Parse the arguments."""
        return super().make_context(*args, **extra)

    @broken_pipes_passed_on()
    def invoke(self, ctx: click.Context) -> Any:
        """Run the command."""
        return super().invoke(ctx)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names, in the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command; None if there is none of that name."""
        if cmd_name not in COMMANDS:
            return None
        command = getattr(import_module(f".cmd_{cmd_name}", __package__), cmd_name)
        assert isinstance(command, Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; the error for an unknown name suggests the closest ones."""
        if args and args[0] not in COMMANDS and not ctx.resilient_parsing and not args[0].startswith("-"):
            from difflib import get_close_matches

            near = get_close_matches(args[0], COMMANDS)
            advice = f"did you mean {' or '.join(near)}?" if near else f"choose one of {', '.join(COMMANDS)}"
            raise click.UsageError(f"no such command {args[0]!r}: {advice}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands from the table alone."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """End in examples, as every help does."""
        write_examples(formatter, EXAMPLES)


EXAMPLES = """
    geomphys check hand.mcap --scene table.toml
    geomphys replay hand.mcap --scene table.toml -o hand_corrected.mcap --rrd hand.rrd
    geomphys view hand.rrd
"""


def _print_version(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    """Print the version and end."""
    if value and not ctx.resilient_parsing:
        import geomphys

        click.echo(f"geomphys {geomphys.__version__}")
        ctx.exit()


@click.group(
    cls=LazyGroup,
    params=terminal_options(),
    context_settings=SETTINGS,
    help="Replay recorded motion capture in a virtual scene without letting the hand go through the table.",
)
@click.option(
    "--version", is_flag=True, is_eager=True, expose_value=False, callback=_print_version, help="Show the version."
)
def cli() -> None:
    """All commands."""


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command line on `arguments` (default: the process's own) and return the exit code.

    Errors are one line on stderr. After SIGINT or SIGTERM the code is 130 or 143, whatever the work made of it.
    """
    terminal = Terminal()
    with signals_caught() as signals:
        try:
            code: Any = cli.main(args=arguments, prog_name="geomphys", standalone_mode=False, obj=terminal)
            sys.stdout.flush()
            signals.stop_if_received()
            return code if isinstance(code, int) else 0
        except BaseException as error:
            signals.settle()
            if signals.received is not None and not isinstance(error, Stopped):
                error = _stopped(signals.received, error)
            if isinstance(error, BrokenPipe) and isinstance(error.__cause__, BrokenPipeError):
                error = error.__cause__
            if isinstance(error, BrokenPipeError) and _silence_closed_streams():
                return 0
            reported = _report(terminal, error)
            if reported is None:
                raise
            return reported


def _stopped(signum: int, error: BaseException) -> Stopped:
    """What a signal made of an error that came of it; keeps its notes."""
    stop = Stopped(signum)
    for note in getattr(error, "__notes__", ()):
        stop.add_note(note)
    return stop


def _report(terminal: Terminal, error: BaseException) -> int | None:
    """Print an error that a user can act on and return the exit code; None for any other."""
    if isinstance(error, click.exceptions.NoArgsIsHelpError):
        click.echo(error.format_message(), err=True)
        return EXIT_USAGE
    if isinstance(error, click.UsageError):
        path = error.ctx.command_path if error.ctx else "geomphys"
        terminal.error(f"{error.format_message().rstrip('.')} (see {path} -h)")
        return EXIT_USAGE
    if isinstance(error, click.ClickException):
        terminal.error(error.format_message())
        return error.exit_code
    if isinstance(error, Stopped):
        terminal.error(_with_notes(error))
        return error.exit_code
    if isinstance(
        error, KeyboardInterrupt | click.Abort
    ):  # raised by a library, or in another thread than the main one
        terminal.error("interrupted")
        return EXIT_INTERRUPTED
    if isinstance(error, MemoryError):
        terminal.error("out of memory; a smaller scene, simpler meshes or fewer --jobs need less")
        return EXIT_FAILED
    if isinstance(error, OSError):
        terminal.error(f"{error.filename or 'input or output'}: {error.strerror or error}")
        return EXIT_FAILED
    if isinstance(error, _expected_errors()):
        terminal.error(_with_notes(error))
        return EXIT_USAGE if type(error).__name__ in ("ConfigError", "RefusedTargetError") else EXIT_FAILED
    return None


def _with_notes(error: BaseException) -> str:
    """Return the text of an error with its notes."""
    return "; ".join([str(error), *getattr(error, "__notes__", ())])


def _expected_errors() -> type[Exception]:
    """Return the base class of the library's errors; imported only when something was raised."""
    from geomphys.errors import GeomphysError

    return GeomphysError


def _silence_closed_streams() -> bool:
    """Silence the standard streams that nobody reads any more; whether there is one."""
    closed = [stream for stream in (sys.stdout, sys.stderr) if _reader_is_gone(stream)]
    for stream in closed:
        silence(stream)
    return bool(closed)


def _reader_is_gone(stream: TextIO) -> bool:
    """Whether a stream is a pipe whose other end is closed."""
    events = select.poll()
    try:
        events.register(stream.fileno(), 0)
    except (OSError, ValueError):  # no file, or a closed one
        return False
    return any(event & (select.POLLERR | select.POLLHUP) for _, event in events.poll(0))


def _open_standard_streams() -> None:
    """Put the null device where a standard stream is closed, so that no file that is opened later takes its number."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest free number: this one
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "r" if number == 0 else "w"))  # noqa: SIM115


def main() -> None:
    """Run the command line of this process; never returns."""
    _open_standard_streams()
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
    gc.set_threshold(GC_THRESHOLD, 20, 20)
    code = run()
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        silence(sys.stdout)
    gc.freeze()  # else Python looks for garbage as it ends: tens of milliseconds
    sys.exit(code)
