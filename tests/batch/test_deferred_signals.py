"""Signals wait while they would leave something half done, and come then."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from types import FrameType

import pytest

from geomphys.storage.deferred_signals import STOP_SIGNALS, blocked_in_children, signals_deferred


class Came(BaseException):
    """What the handler of these tests raises."""


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    """Both signals raise `Came`."""

    def raise_it(number: int, _: FrameType | None) -> None:
        raise Came(number)

    before = {number: signal.signal(number, raise_it) for number in STOP_SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", STOP_SIGNALS)
def test_a_signal_comes_at_the_end_whichever_thread_the_system_gives_it_to(number: int) -> None:
    steps, begun = [], threading.Event()

    def send() -> None:  # from a thread that was there before, and blocks nothing
        begun.wait()
        os.kill(os.getpid(), number)

    other = threading.Thread(target=send)
    other.start()

    def hold() -> None:
        with signals_deferred():
            begun.set()
            other.join()
            steps.append("went on")

    with pytest.raises(Came) as came:
        hold()
    assert steps == ["went on"]
    assert came.value.args == (number,)
    with pytest.raises(Came):  # the handlers are back
        signal.raise_signal(number)


def test_a_signal_waits_for_the_outermost_block_and_the_next_block_defers_again() -> None:
    steps = []

    def hold() -> None:
        with signals_deferred():
            with signals_deferred():
                signal.raise_signal(signal.SIGTERM)
            steps.append("went on")

    for _ in range(2):
        with pytest.raises(Came):
            hold()
    assert steps == ["went on", "went on"]


def test_without_a_signal_nothing_happens_nor_in_another_thread() -> None:
    with signals_deferred():
        pass
    problems: list[BaseException] = []

    def hold() -> None:
        try:
            with signals_deferred():
                pass
        except BaseException as problem:
            problems.append(problem)

    other = threading.Thread(target=hold)
    other.start()
    other.join()
    assert problems == []


def test_what_the_block_raises_is_not_lost_for_a_signal() -> None:
    def fail() -> None:
        with signals_deferred():
            signal.raise_signal(signal.SIGTERM)
            raise ValueError("of the block")

    with pytest.raises(Came) as came:
        fail()
    assert isinstance(came.value.__context__, ValueError)


def test_a_child_starts_with_the_signals_blocked_and_takes_them_when_it_says_so() -> None:
    code = (
        "import os, signal\n"
        "from geomphys.storage.deferred_signals import STOP_SIGNALS, restore_signals\n"
        "os.kill(os.getpid(), signal.SIGINT)\n"
        "print('still here', flush=True)\n"
        "restore_signals()\n"
        "print('and still', flush=True)\n"
        "os.kill(os.getpid(), signal.SIGTERM)\n"
    )
    with blocked_in_children():
        child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    said, _ = child.communicate(timeout=60)
    assert said.splitlines() == ["still here", "and still"]
    assert child.returncode == -signal.SIGTERM
    with pytest.raises(Came):
        signal.raise_signal(signal.SIGINT)
