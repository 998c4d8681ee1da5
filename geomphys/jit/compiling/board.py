"""A board with jobs on it, from which threads take them."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence

from geomphys.jit.compiling.jobs import Job, name_of
from geomphys.jit.compiling.parts import Part
from geomphys.jit.compiling.units import Unit

Product = Part | Unit
Tell = Callable[[int, int], None]


class Board:
    """Jobs that wait, those someone is at, and what came of those that are done."""

    def __init__(self, jobs: Sequence[Job], follow: Callable[[Product], list[Job]]) -> None:
        self.done: dict[str, Product] = {}
        self._follow = follow
        self._waiting: deque[Job] = deque()
        self._reserved: deque[Job] = deque()  # for the main thread, which makes them itself
        self._known: set[str] = set()
        self._reported: deque[Job] = deque()  # helpers are through with these
        self._helping = 0
        self._closed = False
        self._change = threading.Condition()  # of a lock that may be taken twice
        with self._change:
            self._add(list(jobs))

    def _add(self, jobs: list[Job]) -> None:
        """Put up what is new; what was made before is done already."""
        while jobs:
            job = jobs.pop()
            if name_of(job) in self._known:
                continue
            self._known.add(name_of(job))
            product = job.find()
            if product is not None:
                self.done[name_of(job)] = product
                jobs.extend(self._follow(product))
            elif job.key.module == "__main__":  # another process has another one
                self._reserved.append(job)
            else:
                self._waiting.append(job)
        self._change.notify_all()

    @property
    def waiting(self) -> int:
        """How many jobs nobody has taken yet."""
        return len(self._waiting)

    def take(self, tell: Tell) -> Job | None:
        """The main thread's next job, as soon as there is one; None once all are done.

        `tell` is called with the jobs that are done and those that are known.
        """
        with self._change:
            while True:
                while self._reported:
                    self._look_at(self._reported.popleft())
                tell(len(self.done), len(self._known))
                queue = self._waiting or self._reserved
                if queue:
                    return queue.popleft()
                if self._helping == 0:
                    return None
                self._change.wait()

    def finish(self, job: Job, product: Product) -> None:
        """Note what came of a job of the main thread, and put up what follows from it."""
        with self._change:
            self.done[name_of(job)] = product
            self._add(self._follow(product))

    def _look_at(self, job: Job) -> None:
        """Take what a helper made from the store; what it failed at is for the main thread."""
        product = job.find()
        if product is None:
            self._reserved.append(job)
        else:
            self.finish(job, product)

    def take_as_helper(self) -> Job | None:
        """A helper's next job, as soon as there is one; None once there will be none."""
        with self._change:
            while not self._waiting and not self._closed:
                self._change.wait()
            if self._closed:
                return None
            self._helping += 1
            return self._waiting.popleft()

    def report(self, job: Job) -> None:
        """Note that a helper is through with a job. The main thread looks at it: the compiler's types are its own."""
        with self._change:
            self._helping -= 1
            self._reported.append(job)
            self._change.notify_all()

    def close(self) -> None:
        """Give nothing out any more."""
        with self._change:
            self._closed = True
            self._change.notify_all()
