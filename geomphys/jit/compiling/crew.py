"""Compiles all that a kernel needs, in this process and others at once.

Kernels do not wait for each other, for what each returns is known from its annotation: first all are sketched, then
units are made of the sketches. Which kernels are needed, and for which types, is found on the way. Whoever is free
takes the next job.
"""

from __future__ import annotations

import gc
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from geomphys.jit.compiling.board import Board
from geomphys.jit.compiling.helper import Helper
from geomphys.jit.compiling.jobs import Compile, Job, Sketch, next_sketches
from geomphys.jit.compiling.keys import Key
from geomphys.jit.compiling.parts import Part
from geomphys.jit.compiling.sketches import closure, kernel_of
from geomphys.jit.compiling.units import Unit

MOST_PROCESSES = 4
"""More would have little to do; each takes 0.3 GB."""

WORTHWHILE = 12
"""Jobs in sight from which on helpers are called in: one takes two seconds to get ready."""

Tell = Callable[[int, int], None]

_listeners: list[Tell] = []


@contextmanager
def telling(listener: Tell | None) -> Iterator[None]:
    """Within the block, `listener` is told how many jobs of compiling are done, and how many are known of.

    What it raises ends the compiling; what is done by then is kept.
    """
    before = list(_listeners)
    _listeners[:] = before if listener is None else [listener]
    try:
        yield
    finally:
        _listeners[:] = before


def compile_all(root: Key) -> dict[str, Unit]:
    """Sketch the kernel `root` and make the units it needs, or find what was made before.

    Returns the units by their symbols, itself among them if it is outlined.
    """
    crew = _Crew()
    collecting = gc.isenabled()
    gc.disable()  # a fifth of the time would go into looking for garbage, of which there is little
    try:
        sketches = crew.run([Sketch(root)], next_sketches)
        wanted = [part for part in sketches.values() if isinstance(part, Part) and kernel_of(part.key).outlined]
        wanted.sort(key=_size, reverse=True)  # the longest first, so that none is left at the end
        made = crew.run([Compile(part.key) for part in wanted], lambda unit: [])
    finally:
        crew.end()
        if collecting:
            gc.enable()
    return {name: unit for name, unit in sorted((sketches | made).items()) if isinstance(unit, Unit)}


def _size(part: Part) -> int:
    """How much has to be translated for a unit."""
    return sum(len(inside.bitcode) for inside in closure(part)[0])


class _Crew:
    """The process and its helpers."""

    def __init__(self) -> None:
        self._helpers: list[Helper] = []
        self._done = 0  # in the run before

    def run(self, jobs: Sequence[Job], follow: Callable[[Part | Unit], list[Job]]) -> dict[str, Part | Unit]:
        """Do jobs, and those that follow from their products; returns the products."""
        board = Board(jobs, follow)
        for helper in self._helpers:
            self._engage(helper, board)
        try:
            while (job := board.take(self._tell)) is not None:
                if not self._helpers and board.waiting >= WORTHWHILE:
                    self._helpers = [Helper() for _ in range(processes() - 1)]
                    for helper in self._helpers:
                        self._engage(helper, board)
                board.finish(job, job.make())
        finally:
            board.close()
        self._done += len(board.done)
        return board.done

    def _tell(self, done: int, known: int) -> None:
        for listener in _listeners:
            listener(self._done + done, self._done + known)

    def _engage(self, helper: Helper, board: Board) -> None:
        threading.Thread(target=_work, args=(board, helper), daemon=True).start()

    def end(self) -> None:
        """Send the helpers home."""
        for helper in self._helpers:
            helper.end()


def processes() -> int:
    """How many processes compile at once."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(cores, MOST_PROCESSES)


def _work(board: Board, helper: Helper) -> None:
    """Hand jobs to a helper until none is left or it fails."""
    able = helper.is_ready()
    while able and (job := board.take_as_helper()) is not None:
        able = helper.do(job)
        board.report(job)
