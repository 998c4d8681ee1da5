"""A program that was started to end with its parent ends with it, also where that is killed."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest

from geomphys.storage.child_process import available_cores, ending_with_this_process

PARENT = """
import subprocess, sys
from geomphys.storage.child_process import ending_with_this_process
command = ending_with_this_process([sys.executable, "-c", "import time; time.sleep(60)"])
child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
print(child.pid, flush=True)
child.wait()
"""


def is_running(process: int) -> bool:
    """Whether a process is there and no zombie."""
    try:
        with open(f"/proc/{process}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(sys.platform != "linux", reason="asked of Linux")
def test_a_child_does_not_outlive_a_parent_that_is_killed() -> None:
    parent = subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True)
    try:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        time.sleep(0.5)
        assert is_running(child)
    finally:
        parent.kill()
        parent.communicate()
    end = time.monotonic() + 10.0
    while is_running(child) and time.monotonic() < end:
        time.sleep(0.05)
    assert not is_running(child)


def test_the_program_runs_with_its_arguments_and_exit_code() -> None:
    command = ending_with_this_process([sys.executable, "-c", "import sys; print(sys.argv[1]); sys.exit(7)", "a b"])
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.stdout, done.returncode) == ("a b\n", 7)


def test_one_of_another_parent_ends_at_once() -> None:
    command = ending_with_this_process([sys.executable, "-c", "print('runs')"])
    assert command[4] == str(os.getpid())
    command[4] = "1"
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.stdout, done.returncode) == ("", 1)


def test_cores_are_those_this_process_may_use() -> None:
    assert 1 <= available_cores() <= (os.cpu_count() or 1)
