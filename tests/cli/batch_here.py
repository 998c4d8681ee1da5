"""Batches in tests: their jobs in this process, and a worker that sends a signal to its batch in a frame of its job."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence

from geomphys.batch import job as jobs_of_batch
from geomphys.batch.executors import Control, Finished
from geomphys.batch.job import Job, preload_world, run_job
from geomphys.scene.world import World

FRAME, SIGNAL = "GEOMPHYS_TEST_FRAME", "GEOMPHYS_TEST_SIGNAL"
"""Environment variables: the frame, and the signal's number."""


def run_here(jobs: Sequence[Job], world: World, count: int, control: Control) -> Iterator[Finished]:
    """Run jobs as `geomphys.batch.executors.run_in_processes` does, without processes."""
    preload_world(world)
    for number, job in enumerate(jobs):
        if control.may_start():
            yield number, run_job(job)


def preload_and_stop_parent(world: World) -> None:
    """Preload a world, as workers do; the parent gets the signal at the frame, which ends once the parent has reacted."""
    preload_world(world)
    check = jobs_of_batch._StopFileCheck

    def called(self: jobs_of_batch._StopFileCheck, done: int, total: int | None) -> None:
        if done == int(os.environ[FRAME]):
            os.kill(os.getppid(), int(os.environ[SIGNAL]))
            deadline = time.monotonic() + 20
            while not self._stop_file.exists() and time.monotonic() < deadline:
                time.sleep(0.01)
            self._next = 0.0
        looked(self, done, total)

    looked = check.__call__
    check.__call__ = called
