"""The base of all commands: help with examples, terminal options, stopping at the end of a frame on a signal."""

from __future__ import annotations

import signal
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any

import click

from .terminal import Terminal

SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 100}
"""Settings of the help of all commands."""


class Command(click.Command):
    """A command whose help ends in examples, printed as they are written."""

    def __init__(self, name: str | None, *, examples: str, params: list[click.Parameter], **settings: Any) -> None:
        super().__init__(name, params=[*params, *terminal_options()], **settings)
        self.examples = examples

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the examples."""
        write_examples(formatter, self.examples)


def write_examples(formatter: click.HelpFormatter, examples: str) -> None:
    """Write the section of examples, line by line."""
    with formatter.section("Examples"):
        for line in examples.strip().splitlines():
            formatter.write(f"  {line.strip()}\n")


def command(name: str, *, examples: str, **settings: Any) -> Callable[[Callable[..., Any]], Command]:
    """Make a function a command of `geomphys`, with ``-h`` and the options of the terminal."""

    def decorate(function: Callable[..., Any]) -> Command:
        created = click.command(
            name,
            cls=Command,
            examples=examples,
            context_settings=SETTINGS,
            **settings,
        )(function)
        assert isinstance(created, Command)
        return created

    return decorate


def terminal_of(ctx: click.Context) -> Terminal:
    """Return the terminal of this invocation, created on first use."""
    root = ctx.find_root()
    if root.obj is None:
        root.obj = Terminal()
    assert isinstance(root.obj, Terminal)
    return root.obj


def current_terminal() -> Terminal:
    """Return the terminal of the command that is running."""
    return terminal_of(click.get_current_context())


def terminal_options() -> list[click.Parameter]:
    """Return ``-q``, ``-v`` and ``--no-color``, which may stand before a command's name or after it."""

    def store(ctx: click.Context, param: click.Parameter, value: bool) -> None:
        if value:
            assert param.name is not None
            setattr(terminal_of(ctx), param.name, True)

    def flag(*names: str, text: str) -> click.Option:
        return click.Option(names, is_flag=True, expose_value=False, callback=store, help=text)

    return [
        flag("-q", "--quiet", text="Only results and errors."),
        flag("-v", "--verbose", text="Say more about what is going on."),
        flag("--no-color", text="No colours, as with NO_COLOR in the environment."),
    ]


class Stopped(BaseException):
    """A signal asked the program to stop."""

    def __init__(self, signum: int) -> None:
        self.exit_code = 128 + signum
        super().__init__("interrupted" if signum == signal.SIGINT else "terminated")


class StopAtFrame:
    """Context in which SIGINT and SIGTERM stop the work at the end of the current frame.

    Call `at_frame` after every frame: it raises `Stopped` if a signal came. Before the first frame, and at a second
    signal, `Stopped` is raised at once.
    """

    def __init__(self) -> None:
        self._pending: int | None = None
        self._in_frames = False
        self._previous_handlers: dict[int, Any] = {}

    def __enter__(self) -> StopAtFrame:
        """Install the signal handlers."""
        for signum in (signal.SIGINT, signal.SIGTERM):
            self._previous_handlers[signum] = signal.signal(signum, self._receive)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Restore the previous signal handlers."""
        for signum, handler in self._previous_handlers.items():
            signal.signal(signum, handler)

    def at_frame(self) -> None:
        """Raise `Stopped` if a signal was received."""
        self._in_frames = True
        if self._pending is not None:
            raise Stopped(self._pending)

    def _receive(self, signum: int, frame: FrameType | None) -> None:
        """Handle a signal."""
        if self._pending is not None or not self._in_frames:
            raise Stopped(signum)
        self._pending = signum
