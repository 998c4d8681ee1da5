"""Terminal output: results on stdout, messages on stderr, colour only on a terminal that supports it."""

from __future__ import annotations

import json
import math
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from rich.console import Console, RenderableType
    from rich.table import Table
    from rich.text import Text

PIPED_WIDTH = 200
"""Width of tables where the output is not a terminal."""


def printable(text: object) -> str:
    r"""Return a text in one line without terminal control: control characters become ``\n``, ``\x1b``…"""
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode() for character in str(text)
    )


def json_value(value: Any) -> Any:
    """Convert a value for JSON: paths to text, arrays to lists, non-finite numbers to null."""
    if isinstance(value, dict):
        return {str(key): json_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_value(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):
        return json_value(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def counted(number: int, noun: str, plural: str = "") -> str:
    """Return a number and what it counts, in the plural but for one."""
    return f"{number:,} {noun}" if number == 1 else f"{number:,} {plural or noun + 's'}"


def size_text(count: int) -> str:
    """Return a number of bytes in MB, or in kB below a tenth of one."""
    return f"{count / 1e6:,.1f} MB" if count >= 100_000 else f"{count / 1e3:,.1f} kB"


def heading(name: str, rest: str = "") -> Text:
    """Return a title: a name, and what follows it."""
    from rich.text import Text

    return Text(printable(name), style="bold").append(printable(rest), style="not bold")


def fields(rows: Iterable[tuple[str, Sequence[str | Text]]], colours: dict[str, str] | None = None) -> Table:
    """Return labels on the left and their lines on the right; a label that repeats stands once.

    Lines given as `str` are made printable; `colours` names styles of the lines of some labels.
    """
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2))
    table.add_column(style="cyan", no_wrap=True)
    table.add_column(overflow="fold")
    previous_label = None
    for label, lines in rows:
        style = (colours or {}).get(label, "")
        texts = [line if isinstance(line, Text) else Text(printable(line), style=style) for line in lines]
        table.add_row("" if label == previous_label else Text(printable(label)), Text("\n").join(texts))
        previous_label = label
    return table


NAME_WIDTH = 18
"""Columns that the names in a table keep, however narrow the terminal."""


def table_in(
    width: int,
    columns: Sequence[str],
    rows: Sequence[Sequence[str | Text]],
    droppable: Sequence[str] = (),
    left_aligned: str = "",
) -> Table:
    """Return a table without lines: names on the left, folded if need be, figures on the right, never cut.

    Where it is wider than `width`, the columns named in `droppable` are left out, the first ones first, and a last line
    says so. `left_aligned` is the heading of a column that is justified left.
    """
    from rich.table import Table
    from rich.text import Text

    cells = [[str(cell) for cell in row] for row in (columns, *rows)]
    widths = [max((len(row[k]) for row in cells if k < len(row)), default=0) + 2 for k in range(len(columns))]
    available_width = width - min(widths[0], NAME_WIDTH + 2)
    hidden: list[str] = []
    for column in (*droppable, ""):
        if (
            sum(w for w, name in zip(widths[1:], columns[1:], strict=True) if name not in hidden) <= available_width
            or not column
        ):
            break
        if column in columns:
            hidden.append(column)
    shown = [k for k, name in enumerate(columns) if name not in hidden or k == 0]
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    for k in shown:
        if k == 0:
            table.add_column(columns[k], overflow="fold", min_width=min(widths[0] - 2, NAME_WIDTH))
        else:
            table.add_column(columns[k], justify="left" if columns[k] == left_aligned else "right", no_wrap=True)
    for row in rows:
        table.add_row(*(row[k] if isinstance(row[k], Text) else Text(str(row[k])) for k in shown if k < len(row)))
    if hidden:
        table.caption = Text(f"too narrow for {', '.join(hidden)}: see a wider terminal or --json", style="dim")
        table.caption_justify = "left"
    return table


@dataclass
class Terminal:
    """Verbosity and colours of the output."""

    quiet: bool = False
    verbose: bool = False
    no_color: bool = False
    prints_file: bool = False

    @property
    def width(self) -> int:
        """Columns that results may take."""
        return self.console(self._results).width

    def results_to_stderr(self) -> None:
        """Print results to stderr from here on: a file goes to stdout."""
        self.prints_file = True

    def result(self, *renderables: RenderableType) -> None:
        """Print results, texts or tables, to stdout."""
        stream = self._results
        console = self.console(stream)
        if stream.isatty():
            console.print(*renderables, sep="\n")
            return
        with console.capture() as captured:
            console.print(*renderables, sep="\n")
        write_text("".join(f"{line.rstrip()}\n" for line in captured.get().splitlines()), stream)

    def json(self, value: Any) -> None:
        """Print a value as JSON to stdout."""
        write_text(json.dumps(json_value(value), indent=2, allow_nan=False) + "\n", self._results)

    def note(self, text: str) -> None:
        """Print a progress note to stderr; not with ``-q``."""
        if not self.quiet:
            _write_error(printable(text))

    def detail(self, text: str) -> None:
        """Print a detail to stderr; only with ``-v``."""
        if self.verbose:
            _write_error(printable(text))

    def warning(self, text: str) -> None:
        """Print a warning line to stderr; not with ``-q``."""
        if not self.quiet:
            self._labelled("warning", "yellow", text)

    def error(self, text: str) -> None:
        """Print an error line to stderr."""
        self._labelled("error", "red", text)

    def console(self, stream: TextIO) -> Console:
        """Return a rich console on a stream; where no terminal is behind it, lines are not wrapped at 80 columns."""
        from rich.console import Console

        return Console(
            file=stream,
            color_system=None if self.no_color or os.environ.get("NO_COLOR") else "auto",
            highlight=False,
            markup=False,
            emoji=False,
            width=None if stream.isatty() else PIPED_WIDTH,
        )

    @property
    def _results(self) -> TextIO:
        """Where results are printed."""
        return sys.stderr if self.prints_file else sys.stdout

    def _labelled(self, label: str, colour: str, text: str) -> None:
        """Print ``geomphys: LABEL: text`` to stderr."""
        if sys.stderr.isatty():
            from rich.text import Text

            line = Text("geomphys: ").append(f"{label}: ", style=f"bold {colour}").append(printable(text))
            self.console(sys.stderr).print(line, soft_wrap=True)
        else:
            _write_error(f"geomphys: {label}: {printable(text)}")


def _write_error(line: str) -> None:
    """Write a line to stderr; a progress bar that is there moves down for it."""
    write_text(line + "\n", sys.stderr)


def write_text(text: str, stream: TextIO) -> None:
    """Write text to a standard stream at once; where nobody reads it any more (``| head``) it goes nowhere from here on."""
    try:
        stream.write(text)
        stream.flush()
    except BrokenPipeError:
        silence(stream)


def silence(stream: TextIO) -> None:
    """Let a standard stream whose reader has gone lead to the null device, so that its buffer can be flushed at exit."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, stream.fileno())
    os.close(null)
