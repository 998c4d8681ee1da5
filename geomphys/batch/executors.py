"""Runs the jobs of a batch in processes of this machine or on the workers of a Dask scheduler.

An executor is a generator of ``(index, outcome)`` in the order in which jobs end. If it is closed early it asks the
running jobs to stop and waits for them.
"""

from __future__ import annotations

import logging
import multiprocessing
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, cast

from geomphys.batch.job import Job, Outcome, Replayed, failure, preload_world, publish_outputs, replay_job, run_job
from geomphys.errors import ClusterError
from geomphys.jit.kernel import are_compiled
from geomphys.scene.world import World
from geomphys.storage.deferred_signals import signals_deferred
from geomphys.storage.process_pool import ProcessPool
from geomphys.storage.remote_files import AnyPath, is_remote

Finished = tuple[int, Outcome]
JobQueue = deque[tuple[int, Job]]


@dataclass(frozen=True)
class Control:
    """Callbacks of the batch that an executor calls."""

    may_start: Callable[[], bool]
    """Whether another job may start; once false, the executor only waits for running jobs."""
    request_stop: Callable[[], None]
    """Ask the running jobs to stop."""
    ends_at_failure: bool
    """Whether no job may start once another one has failed."""


POLL_S = 0.1
"""s; longest delay of a signal."""
SHUTDOWN_TIMEOUT_S = 10.0
"""s; processes that have not exited this long after their jobs are killed."""
CONNECT_TIMEOUT_S = 10
"""s; time limit for connecting to a Dask scheduler."""


def run_in_processes(
    jobs: Sequence[Job], world: World, count: int, control: Control
) -> Generator[Finished, None, None]:
    """Run jobs in up to `count` worker processes, to which the world is sent once.

    With several processes the largest logs come first, which balances their load. Each process has its next job before it ends
    one, unless none may start after a failure.

    Until the kernels are compiled only one job runs, so that they are compiled once. Where a process dies (killed, out
    of memory), the jobs that ran then run again one at a time; one whose process dies again has failed.
    """
    queue: JobQueue = deque(enumerate(jobs) if count == 1 else largest_first(jobs))
    retries: JobQueue = deque()
    while (queue or retries) and control.may_start():
        one_at_a_time = bool(retries)
        most = 1 if one_at_a_time else count if control.ends_at_failure else 2 * count
        lost_jobs = yield from _run_until_process_dies(
            retries if one_at_a_time else queue, world, 1 if one_at_a_time else count, most, control
        )
        if one_at_a_time and lost_jobs:
            yield lost_jobs[0][0], Outcome(status="failed", error="its process died twice; was it short of memory?")
        else:
            retries.extend(lost_jobs)


def _run_until_process_dies(
    queue: JobQueue, world: World, count: int, most: int, control: Control
) -> Generator[Finished, None, list[tuple[int, Job]]]:
    """Run a queue in `count` processes until it is empty or one dies; returns the jobs that they had then, `most` of them.

    The outputs of a job are published, and its outcome reported, once the next one is at work; but at once where none may
    start after a failure.
    """
    executor = ProcessPool(count, preload_world, world)
    running: dict[Future[Replayed], tuple[int, Job]] = {}
    done: deque[tuple[int, Replayed]] = deque()
    lost_jobs: list[tuple[int, Job]] = []

    def start() -> None:
        while queue and len(running) < (most if are_compiled(queue[0][1].config.method) else 1) and control.may_start():
            running[executor.submit(replay_job, queue[0][1])] = queue[0]
            queue.popleft()

    try:
        while not lost_jobs:
            with signals_deferred():  # once a round: a change of handlers takes longer than the rest of it
                start()
                if not running:
                    break
                completed, _ = wait(running, timeout=POLL_S, return_when=FIRST_COMPLETED)
                for future in sorted(completed, key=lambda f: running[f][0]):
                    index, job = running.pop(future)
                    error = future.exception()
                    if isinstance(error, BrokenProcessPool):
                        lost_jobs.append((index, job))
                    else:
                        done.append((index, future.result() if error is None else Replayed(failure(error))))
                if lost_jobs:
                    lost_jobs = sorted([*lost_jobs, *running.values()], key=lambda item: item[0])
                elif not control.ends_at_failure:
                    start()
                outcomes = _published(done)
            yield from outcomes
    except BrokenProcessPool:  # a process died between two jobs
        lost_jobs = sorted(running.values(), key=lambda item: item[0])
    except BaseException:
        control.request_stop()
        _shut_down(executor, running)
        ended = {future: index for future, (index, _) in running.items() if not future.cancelled()}
        done.extend((index, future.result()) for future, index in ended.items() if future.exception() is None)
        _published(done)
        raise
    yield from _published(done)
    _shut_down(executor, running)
    return lost_jobs


def _published(done: deque[tuple[int, Replayed]]) -> list[Finished]:
    """Publish the outputs of jobs; no signal comes between."""
    outcomes: list[Finished] = []
    with signals_deferred():
        while done:
            index, replayed = done.popleft()
            outcomes.append((index, publish_outputs(replayed)))
    return outcomes


def _shut_down(executor: ProcessPool, running: Iterable[Future[Replayed]]) -> None:
    """Wait for the running jobs, then for their processes; an exception meanwhile kills the processes."""
    shutdown = threading.Thread(target=executor.shutdown, kwargs={"cancel_futures": True}, daemon=True)
    shutdown.start()
    try:
        _poll_until(lambda: all(future.done() for future in running), None)
        _poll_until(lambda: not shutdown.is_alive(), SHUTDOWN_TIMEOUT_S)
    finally:
        if shutdown.is_alive():
            for process in multiprocessing.active_children():
                process.kill()


def _poll_until(done: Callable[[], bool], limit_s: float | None) -> None:
    """Poll until `done` returns true, at most for `limit_s`."""
    begin = time.monotonic()
    while not done() and (limit_s is None or time.monotonic() - begin < limit_s):
        time.sleep(POLL_S / 10)


def largest_first(jobs: Sequence[Job]) -> list[tuple[int, Job]]:
    """The jobs with their numbers, largest log first; logs behind URLs, whose size is not queried, come last."""
    return sorted(enumerate(jobs), key=lambda item: (-_size(item[1].log), item[0]))


def _size(log: AnyPath) -> int:
    """Bytes of a local log; 0 if unknown."""
    if is_remote(log):
        return 0
    try:
        files = [path for path in log.rglob("*") if path.is_file()] if log.is_dir() else [log]
        return sum(path.stat().st_size for path in files)
    except OSError:  # the job reports the problem
        return 0


def run_on_cluster(jobs: Sequence[Job], address: str, control: Control) -> Generator[Finished, None, None]:
    """Run jobs on the workers of the Dask scheduler at `address` (``tcp://host:port``).

    The scheduler reruns the jobs of a worker that dies on another one. Paths must be valid on all machines.

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
        client = cast(Any, Client)(address, timeout=CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as problem:
        raise ClusterError(f"{address}: there is no Dask scheduler to be reached ({problem})") from problem
    with _client_log_silenced(), client:
        futures = {
            client.submit(run_job, job, pure=False, priority=-rank): index
            for rank, (index, job) in enumerate(largest_first(jobs))
        }
        try:
            yield from _outcomes_of_futures(
                futures, cast(Any, as_completed)(futures, loop=client.loop), address, control
            )
        except BaseException:
            control.request_stop()
            client.cancel(list(futures))
            raise


@contextmanager
def _client_log_silenced() -> Iterator[None]:
    """Silence Dask's traceback of a lost connection, which is reported as a ClusterError instead."""
    log = logging.getLogger("distributed.client")
    before = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        log.setLevel(before)


def _outcomes_of_futures(
    futures: dict[Any, int], completed: Iterable[Any], address: str, control: Control
) -> Iterator[Finished]:
    """Outcomes of Dask's futures as they complete; pending ones are cancelled once no more may start."""
    stopped = False
    for future in completed:
        if future.cancelled():
            if not stopped:
                raise ClusterError(f"{address}: the Dask scheduler was lost; start it again and add --resume")
            continue
        error = future.exception()
        yield futures[future], future.result() if error is None else failure(error)
        if not stopped and not control.may_start():
            stopped = True
            for other in futures:
                if not other.done():
                    other.cancel()
