"""The progress bar: on a terminal only, on stderr, with frames per second and the time left."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from .terminal import Terminal

EVERY = 16
"""Frames between two looks at the bar: drawing must cost nothing beside the work."""
PATIENCE = 1.0
"""s after which it is said what is being done where there is no bar"""


class Report(Protocol):
    """What a library call tells of its progress: frames done, and how many there will be if that is known."""

    def __call__(self, done: int, total: int | None, /) -> None:
        """Take the figures."""


@contextmanager
def progress_bar(terminal: Terminal, title: str, unit: str = "frames", every: int = EVERY) -> Iterator[Report]:
    """Show a bar while the block runs; yields the callback that moves it, which draws at every `every`-th call."""
    if terminal.quiet or not sys.stderr.isatty():
        yield lambda done, total: None
        return
    from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class Speed(ProgressColumn):
        """Units a second."""

        def render(self, task: Task) -> Text:
            """Return the speed, or nothing while it is not known."""
            speed = task.finished_speed or task.speed
            return Text("" if speed is None else f"{speed:,.0f} {unit}/s", style="cyan")

    class Done(ProgressColumn):
        """How many of how many."""

        def render(self, task: Task) -> Text:
            """Return the count; without a total only what is done."""
            if not task.completed:
                return Text("")
            total = "" if task.total is None else f"/{task.total:,.0f}"
            return Text(f"{task.completed:,.0f}{total}")

    bar = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        Done(),
        Speed(),
        TimeRemainingColumn(compact=True),
        console=terminal.console(sys.stderr),
        transient=True,
    )
    with bar:
        task = bar.add_task(title, total=None)

        def report(done: int, total: int | None) -> None:
            if done % every == 0 or done == total:
                bar.update(task, completed=done, total=total)

        yield report


class ProgressBars:
    """One bar after the other, as the work goes on; a context manager that takes the last one away."""

    def __init__(self, terminal: Terminal) -> None:
        self._terminal = terminal
        self._shown = ExitStack()
        self._title: str | None = None
        self._report: Report | None = None

    def __enter__(self) -> ProgressBars:
        """Show nothing yet."""
        return self

    def __exit__(self, *error: object) -> None:
        """Take the bar away."""
        self._shown.close()

    def show(self, title: str, done: int, total: int | None, unit: str = "frames", every: int = EVERY) -> None:
        """Move the bar of this title; it takes the place of the one before."""
        if self._report is None or title != self._title:
            self._shown.close()
            self._title, self._report = (
                title,
                self._shown.enter_context(progress_bar(self._terminal, title, unit, every)),
            )
        self._report(done, total)


def meshes_report(terminal: Terminal, bars: ProgressBars) -> Callable[[str, float], None]:
    """Return the callback that shows how far the meshes of a scene are cut.

    On a terminal it moves a bar that names the mesh; elsewhere it writes one line if that takes longer than `PATIENCE`.
    """
    begun, told = time.monotonic(), False

    def report(what: str, share: float) -> None:
        nonlocal told
        if sys.stderr.isatty():
            bars.show(what, round(100 * share), 100, unit="%", every=1)
        elif not told and time.monotonic() - begun > PATIENCE:
            terminal.note(f"Cutting meshes into convex pieces, once: {what}…")
            told = True

    return report
