"""A batch on a Dask cluster of this machine."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import geomphys
from geomphys.batch.manifest import Entry
from tests.batch.test_run import Case

distributed = pytest.importorskip("distributed", reason="install geomphys[cluster]")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_two_workers_one_of_them_killed_end_complete(tmp_path: Path) -> None:
    case = Case(tmp_path, a=60, b=3000, c=3000, d=3000, e=60)
    (case.logs / "f.mcap").write_bytes(b"no log")
    killed: list[int] = []
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None, silence_logs=50
    ) as cluster:

        def kill(entry: Entry) -> None:
            if not killed:
                killed.append(cluster.workers[0].pid)
                os.kill(killed[0], signal.SIGKILL)

        report = case.run(jobs=None, scheduler=cluster.scheduler_address, ended=kill)
    assert killed
    assert [entry.status for entry in report.entries] == ["done"] * 5 + ["failed"]
    assert "f.mcap" in (report.entries[5].error or "")
    case.check("a", "b", "c", "d", "e")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_that_is_killed_is_one_line_and_the_batch_resumes(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    case = Case(tmp_path, a=60, b=6000, c=60)
    address_file = tmp_path / "address.json"
    words = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(address_file)]
    begun = [
        subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_scheduler", *words], stderr=subprocess.DEVNULL)
    ]
    try:
        wait_for(address_file.exists)
        address = json.loads(address_file.read_text())["address"]
        words = [
            address,
            "--nthreads",
            "1",
            "--no-nanny",
            "--no-dashboard",
            "--local-directory",
            str(tmp_path / "worker"),
        ]
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", *words]
        begun.append(subprocess.Popen(worker, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
        with pytest.raises(geomphys.ClusterError, match=r"scheduler was lost; .* --resume"):
            case.run(jobs=None, scheduler=address, ended=lambda entry: begun[0].kill())
        assert "Traceback" not in capfd.readouterr().err
    finally:
        for process in begun:
            process.kill()
            process.wait()
    assert case.run(resume=True).count("done") == 3
    case.check("a", "b", "c")


def wait_for(there: Callable[[], bool]) -> None:
    """Wait until something is there, a minute at most."""
    end = time.monotonic() + 60.0
    while not there():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_no_scheduler_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("geomphys.batch.executors.CONNECT_TIMEOUT_S", 1)
    with pytest.raises(geomphys.ClusterError, match="no Dask scheduler"):
        Case(tmp_path, a=60).run(jobs=None, scheduler="tcp://127.0.0.1:9")
