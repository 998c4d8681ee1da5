"""Where the jobs of a batch run: processes of this machine, or the workers of a Dask scheduler.

An engine takes jobs and yields ``(index, outcome)`` as they end, in any order. If it is left before its end, it asks
the jobs that run to stop, and waits for them as far as it can.
"""

from __future__ import annotations

import logging
import multiprocessing
import pickle
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, cast

from geomphys.batch.deferred_signals import blocked_in_children, signals_deferred
from geomphys.batch.job import Job, Outcome, failure, run_job
from geomphys.batch.worker import begin_worker
from geomphys.errors import ClusterError
from geomphys.jit.kernel import are_compiled
from geomphys.scene.arrays import World
from geomphys.storage.remote_files import AnyPath, is_remote

Finished = tuple[int, Outcome]
Waiting = deque[tuple[int, Job]]


@dataclass(frozen=True)
class Control:
    """What an engine asks and tells."""

    go: Callable[[], bool]
    """Asked before a job is begun; once it says no, only what runs is waited for."""
    stop: Callable[[], None]
    """Tells the jobs that run to stop."""


POLL_S = 0.1
"""s; a signal waits so long at most."""
END_WITHIN_S = 10.0
"""s; processes whose jobs have ended and that do not end by themselves in this time are killed."""
CONNECT_S = 10
"""s; how long a Dask scheduler is waited for."""


def run_in_processes(
    jobs: Sequence[Job], world: World, count: int, control: Control
) -> Generator[Finished, None, None]:
    """Run jobs in up to `count` processes of their own, which are given the world of all.

    Several processes begin with the largest logs, so that none works on one alone for long at the end.

    Until the kernels are compiled only one job runs, so that they are compiled once. Where a process dies (killed, out
    of memory), the jobs that ran then run again one at a time; one whose process dies again has failed.
    """
    waiting: Waiting = deque(enumerate(jobs) if count == 1 else largest_first(jobs))
    suspects: Waiting = deque()
    while (waiting or suspects) and control.go():
        alone = bool(suspects)
        lost = yield from _run_until_process_dies(suspects if alone else waiting, world, 1 if alone else count, control)
        if alone and lost:
            yield lost[0][0], Outcome(status="failed", error="its process died twice; was it short of memory?")
        else:
            suspects.extend(lost)


def _run_until_process_dies(
    queue: Waiting, world: World, count: int, control: Control
) -> Generator[Finished, None, list[tuple[int, Job]]]:
    """Run a queue until it is empty or a process dies; returns the jobs that ran when it died."""
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(count, mp_context=context, initializer=begin_worker, initargs=(pickle.dumps(world),))
    running: dict[Future[Outcome], tuple[int, Job]] = {}
    lost: list[tuple[int, Job]] = []
    try:
        while (running or queue) and not lost:
            while queue and len(running) < (count if are_compiled() else 1) and control.go():
                with signals_deferred(), blocked_in_children():
                    running[executor.submit(run_job, queue[0][1])] = queue[0]
                queue.popleft()
            if not running:
                break
            with signals_deferred():
                ended, _ = wait(running, timeout=POLL_S, return_when=FIRST_COMPLETED)
            for future in sorted(ended, key=lambda f: running[f][0]):
                index, job = running.pop(future)
                error = future.exception()
                if isinstance(error, BrokenProcessPool):
                    lost.append((index, job))
                else:
                    yield index, future.result() if error is None else failure(error)
            if lost:
                lost = sorted([*lost, *running.values()], key=lambda item: item[0])
    except BrokenProcessPool:  # a process died between two jobs
        lost = sorted(running.values(), key=lambda item: item[0])
    except BaseException:
        control.stop()
        _end(executor, running)
        raise
    _end(executor, running)
    return lost


def _end(executor: ProcessPoolExecutor, running: Iterable[Future[Outcome]]) -> None:
    """Wait for jobs, which were asked to stop, and their processes; who does not want to wait for them kills them."""
    ending = threading.Thread(target=executor.shutdown, kwargs={"cancel_futures": True}, daemon=True)
    ending.start()
    try:
        _poll_until(lambda: all(future.done() for future in running), None)
        _poll_until(lambda: not ending.is_alive(), END_WITHIN_S)
    finally:
        if ending.is_alive():
            for process in multiprocessing.active_children():
                process.kill()


def _poll_until(done: Callable[[], bool], limit_s: float | None) -> None:
    """Wait until something is done, or for `limit_s`; nothing is held up by an exception that comes meanwhile."""
    begin = time.monotonic()
    while not done() and (limit_s is None or time.monotonic() - begin < limit_s):
        time.sleep(POLL_S / 10)


def largest_first(jobs: Sequence[Job]) -> list[tuple[int, Job]]:
    """The jobs with their numbers, by size of the log; those behind URLs, whose size is not asked for, at the end."""
    return sorted(enumerate(jobs), key=lambda item: (-_size(item[1].log), item[0]))


def _size(log: AnyPath) -> int:
    """Bytes of a local log; 0 where that is not known."""
    if is_remote(log):
        return 0
    try:
        files = [path for path in log.rglob("*") if path.is_file()] if log.is_dir() else [log]
        return sum(path.stat().st_size for path in files)
    except OSError:  # the job tells what is wrong
        return 0


def run_on_cluster(jobs: Sequence[Job], address: str, control: Control) -> Generator[Finished, None, None]:
    """Run jobs on the workers of the Dask scheduler at `address` (``tcp://host:port``).

    The scheduler gives the jobs of a worker that dies to another one. Paths must mean the same on all machines.

    Raises
    ------
    ClusterError
        Dask is not installed, or the scheduler cannot be reached or is lost.
    """
    try:
        from distributed import Client, as_completed
    except ImportError as problem:
        raise ClusterError("Dask is not installed; install geomphys[cluster]") from problem
    try:
        client = cast(Any, Client)(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as problem:
        raise ClusterError(f"{address}: there is no Dask scheduler to be reached ({problem})") from problem
    with _without_its_log(), client:
        futures = {
            client.submit(run_job, job, pure=False, priority=-rank): index
            for rank, (index, job) in enumerate(largest_first(jobs))
        }
        try:
            yield from _as_they_end(futures, cast(Any, as_completed)(futures, loop=client.loop), address, control)
        except BaseException:
            control.stop()
            client.cancel(list(futures))
            raise


@contextmanager
def _without_its_log() -> Iterator[None]:
    """Keep Dask from printing the traceback of a connection that is lost: that becomes an error of one line."""
    log = logging.getLogger("distributed.client")
    before = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        log.setLevel(before)


def _as_they_end(futures: dict[Any, int], ended: Iterable[Any], address: str, control: Control) -> Iterator[Finished]:
    """What Dask's futures come to; no more is begun once `control` says so."""
    stopped = False
    for future in ended:
        if future.cancelled():
            if not stopped:
                raise ClusterError(f"{address}: the Dask scheduler was lost; start it again and add --resume")
            continue
        error = future.exception()
        yield futures[future], future.result() if error is None else failure(error)
        if not stopped and not control.go():
            stopped = True
            for other in futures:
                if not other.done():
                    other.cancel()
