"""Which jobs the worker processes have at once."""

from __future__ import annotations

from concurrent.futures import Future
from types import SimpleNamespace
from typing import Any

import pytest

from geomphys.batch import executors
from geomphys.batch.executors import Control, run_in_processes
from geomphys.batch.job import Outcome, Replayed
from geomphys.config import Config


class Pool:
    """Takes jobs, and does none."""

    def __init__(self, *_: object) -> None:
        self.futures: list[Future[Replayed]] = []

    def submit(self, *_: object) -> Future[Replayed]:
        self.futures.append(Future())
        return self.futures[-1]

    def shutdown(self, **_: object) -> None:
        pass


@pytest.mark.parametrize(("ends_at_failure", "at_once"), [(False, [2, 2, 2, 1]), (True, [1, 1, 1, 1])])
def test_a_process_has_its_next_job_before_it_ends_one_unless_that_could_fail_the_batch(
    ends_at_failure: bool, at_once: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    counts = []

    def first_ends(running: dict[Future[Replayed], Any], **_: object) -> tuple[set[Future[Replayed]], set[object]]:
        counts.append(len(running))
        first = next(iter(running))
        first.set_result(Replayed(Outcome(status="done")))
        return {first}, set()

    monkeypatch.setattr(executors, "ProcessPool", Pool)
    monkeypatch.setattr(executors, "wait", first_ends)
    monkeypatch.setattr(executors, "are_compiled", lambda method: True)
    jobs: list[Any] = [SimpleNamespace(config=Config())] * 4
    control = Control(may_start=lambda: True, request_stop=lambda: None, ends_at_failure=ends_at_failure)
    world: Any = None
    assert [index for index, _ in run_in_processes(jobs, world, 1, control)] == [0, 1, 2, 3]
    assert counts == at_once
