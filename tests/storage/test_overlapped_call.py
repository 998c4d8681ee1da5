"""Calls in a thread of their own give what they give, and raise what they raise, where they are waited for."""

from __future__ import annotations

import os
import threading

import pytest

from geomphys.errors import GeomphysError
from geomphys.storage.child_process import available_cores
from geomphys.storage.overlapped_call import OverlappedCall, can_overlap
from geomphys.storage.process_pool import ProcessPool


@pytest.mark.parametrize("is_overlapped", [False, True])
def test_it_gives_its_result_and_raises_its_error(is_overlapped: bool) -> None:
    def fail() -> int:
        raise KeyError("what went wrong")

    assert OverlappedCall(lambda: 7, is_overlapped=is_overlapped).wait() == 7
    call = OverlappedCall(fail, is_overlapped=is_overlapped)
    with pytest.raises(KeyError, match="what went wrong"):
        call.wait()


def test_it_is_at_work_meanwhile_only_if_it_overlaps() -> None:
    begun, may_end = threading.Event(), threading.Event()

    def work() -> bool:
        begun.set()
        return may_end.wait(10)

    overlapped = OverlappedCall(work, is_overlapped=True)
    assert begun.wait(10)
    may_end.set()
    overlapped.settle()
    assert overlapped.wait()
    begun.clear()
    later = OverlappedCall(work, is_overlapped=False)
    assert not begun.is_set()
    assert later.wait()
    assert begun.is_set()


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_fork_does_not_wait_for_ever() -> None:
    may_end = threading.Event()
    call = OverlappedCall(lambda: may_end.wait(20), is_overlapped=True)
    child = os.fork()
    if child == 0:  # where the thread is missing
        try:
            call.wait()
        except GeomphysError:
            os._exit(5)
        finally:
            os._exit(6)
    may_end.set()
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 5
    assert call.wait()


def test_workers_of_a_pool_leave_the_other_cores_to_each_other() -> None:
    with ProcessPool(1, int) as pool:
        assert pool.submit(can_overlap).result() is False
    assert can_overlap() == (available_cores() > 1)
