"""Progress bars on stderr, on a terminal only: frames per second and time left."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from .terminal import Terminal

REDRAW_INTERVAL = 16
"""Frames between two updates of the bar."""
NOTICE_DELAY = 1.0
"""s; without a terminal, a notice is printed after this time."""


class Report(Protocol):
    """Progress callback of library calls: frames done, and their total if known."""

    def __call__(self, done: int, total: int | None, /) -> None:
        """Report the counts."""


@contextmanager
def progress_bar(
    terminal: Terminal, title: str, unit: str = "frames", redraw_interval: int = REDRAW_INTERVAL
) -> Iterator[Report]:
    """Show a bar while the block runs; yields the callback that moves it, which draws at every `redraw_interval`-th call."""
    if terminal.quiet or not sys.stderr.isatty():
        yield lambda done, total: None
        return
    from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class Speed(ProgressColumn):
        """Units per second."""

        def render(self, task: Task) -> Text:
            """Return the speed, empty while unknown."""
            speed = task.finished_speed or task.speed
            return Text("" if speed is None else f"{speed:,.{0 if speed >= 10 else 1}f} {unit}/s", style="cyan")

    class Done(ProgressColumn):
        """Count and total."""

        def render(self, task: Task) -> Text:
            """Return the count, and the total if known."""
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
            if done % redraw_interval == 0 or done == total:
                bar.update(task, completed=done, total=total)

        yield report


class ProgressBars:
    """Successive progress bars; a context manager that removes the last one."""

    def __init__(self, terminal: Terminal) -> None:
        self._terminal = terminal
        self._shown = ExitStack()
        self._title: str | None = None
        self._report: Report | None = None

    def __enter__(self) -> ProgressBars:
        """Enter without a bar."""
        return self

    def __exit__(self, *error: object) -> None:
        """Remove the bar."""
        self._shown.close()

    def show(
        self, title: str, done: int, total: int | None, unit: str = "frames", redraw_interval: int = REDRAW_INTERVAL
    ) -> None:
        """Update the bar of this title, which replaces the previous one."""
        if self._report is None or title != self._title:
            self._shown.close()
            self._title, self._report = (
                title,
                self._shown.enter_context(progress_bar(self._terminal, title, unit, redraw_interval)),
            )
        self._report(done, total)


def meshes_report(terminal: Terminal, bars: ProgressBars) -> Callable[[str, float], None]:
    """Return the callback that shows the progress of mesh decomposition.

    On a terminal it moves a bar that names the mesh; elsewhere it writes one line if that takes longer than `NOTICE_DELAY`.
    """
    start_time, was_reported = time.monotonic(), False

    def report(what: str, share: float) -> None:
        nonlocal was_reported
        if sys.stderr.isatty():
            bars.show(what, round(100 * share), 100, unit="%", redraw_interval=1)
        elif not was_reported and time.monotonic() - start_time > NOTICE_DELAY:
            terminal.note(f"Cutting meshes into convex pieces, once: {what}…")
            was_reported = True

    return report
