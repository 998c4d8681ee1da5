"""What reaches the user: results on stdout, everything else on stderr, in colour only on a terminal that wants it."""

from __future__ import annotations

import json
import math
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import click

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

PIPED_WIDTH = 200
"""Columns a table may take where no terminal limits it."""


def printable(text: object) -> str:
    r"""Return a text in one line that cannot steer a terminal: control characters become ``\n``, ``\x1b``…"""
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode() for character in str(text)
    )


def plain(value: Any) -> Any:
    """Return a value as JSON takes it: paths as text, arrays as lists, what is not finite as null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


@dataclass
class Terminal:
    """How much is said, and in which colours."""

    quiet: bool = False
    verbose: bool = False
    no_color: bool = False

    def result(self, *renderables: RenderableType) -> None:
        """Print results, texts or tables, to stdout."""
        console = self.console(sys.stdout)
        if sys.stdout.isatty():
            console.print(*renderables, sep="\n")
            return
        with console.capture() as captured:
            console.print(*renderables, sep="\n")
        for line in captured.get().splitlines():
            click.echo(line.rstrip())

    def json(self, value: Any) -> None:
        """Print a value as JSON to stdout."""
        click.echo(json.dumps(plain(value), indent=2, allow_nan=False))

    def note(self, text: str) -> None:
        """Say on stderr what is going on; not under ``-q``."""
        if not self.quiet:
            click.echo(printable(text), err=True)

    def detail(self, text: str) -> None:
        """Say on stderr what only matters to one who looks for a cause: under ``-v``."""
        if self.verbose:
            click.echo(printable(text), err=True)

    def warning(self, text: str) -> None:
        """Warn on stderr in one line; not under ``-q``."""
        if not self.quiet:
            self._labelled("warning", "yellow", text)

    def error(self, text: str) -> None:
        """Tell on stderr in one line what went wrong."""
        self._labelled("error", "red", text)

    def console(self, stream: TextIO) -> Console:
        """Return a rich console on a stream; where no terminal is behind it, lines are not wrapped at 80 columns."""
        from rich.console import Console

        return Console(
            file=stream,
            color_system=None if self.no_color or os.environ.get("NO_COLOR") else "auto",
            highlight=False,
            emoji=False,
            width=None if stream.isatty() else PIPED_WIDTH,
        )

    def _labelled(self, label: str, colour: str, text: str) -> None:
        """Print ``geomphys: LABEL: text`` to stderr."""
        if sys.stderr.isatty():
            from rich.text import Text

            line = Text("geomphys: ").append(f"{label}: ", style=f"bold {colour}").append(printable(text))
            self.console(sys.stderr).print(line, soft_wrap=True)
        else:
            click.echo(f"geomphys: {label}: {printable(text)}", err=True)
