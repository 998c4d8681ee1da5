"""Pools of processes: what signals do to them, and what becomes of one that dies."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from geomphys.errors import GeomphysError
from geomphys.storage.process_pool import ProcessPool

SCRIPT = """
import os, sys, time
from geomphys.storage.process_pool import ProcessPool

def begin(data, folder): open(f"{folder}/{os.getpid()}", "w").close()

if __name__ == "__main__":
    with ProcessPool(2, begin, bytes(1_000_000), sys.argv[1]) as pool:
        calls = [pool.submit(time.sleep, 600 * k) for k in range(2)]
        while len(os.listdir(sys.argv[1])) < 2: time.sleep(0.01)
        calls[0].result()
        print(flush=True)
        calls[1].result()
"""


def test_a_process_that_dies_is_one_error() -> None:
    with pytest.raises(GeomphysError, match="one of the processes died"), ProcessPool(1, str) as pool:
        pool.submit(os._exit, 1).result()


def test_a_process_that_dies_before_it_has_read_its_arguments_is_not_waited_for(tmp_path: Path) -> None:
    """It held up the batch for ever, and signals too: the pipe was full, and the parent alone could read from it."""
    script = tmp_path / "script.py"
    text = SCRIPT.replace("(2, begin", "(1, begin").replace("< 2: time", "< 2 and not calls[0].done(): time")
    script.write_text(f"import os\nif __name__ == '__mp_main__': os._exit(1)\n{text}")
    (tmp_path / "begun").mkdir()
    done = subprocess.run([sys.executable, script, tmp_path / "begun"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("geomphys.errors.GeomphysError: one of the processes died")


def test_a_file_that_another_wrote_does_not_run(tmp_path: Path) -> None:
    pool = ProcessPool(1, os.mkdir, tmp_path / "begun")
    (pool._folder.path / "begin").write_bytes(pickle.dumps((os.mkdir, (tmp_path / "ran",))))
    with pytest.raises(GeomphysError, match="one of the processes died"), pool:
        pool.submit(str).result()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_processes_say_nothing_and_end_with_their_parent(tmp_path: Path, number: int) -> None:
    """Ctrl-C goes to all of them, SIGKILL to the parent alone."""
    (tmp_path / "begun").mkdir()
    (tmp_path / "script.py").write_text(SCRIPT)
    words = [sys.executable, tmp_path / "script.py", tmp_path / "begun"]
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as parent:
        assert parent.stdout is not None
        try:
            assert parent.stdout.readline() == "\n"
            (os.killpg if number == signal.SIGINT else os.kill)(parent.pid, number)
            said = parent.communicate(timeout=20)[1]  # when all have ended: each holds its end of the pipe
        finally:
            with suppress(ProcessLookupError):
                os.killpg(parent.pid, signal.SIGKILL)
    assert said.count("Traceback") == (number == signal.SIGINT), "the parent's own"
    assert said.count("KeyboardInterrupt") == (number == signal.SIGINT)
