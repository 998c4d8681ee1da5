"""The base of all commands: help with examples, terminal options."""

from __future__ import annotations

from collections.abc import Callable
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
