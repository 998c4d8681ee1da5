"""A batch on a Dask cluster of this machine."""

from __future__ import annotations

import os
import signal
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


def test_no_scheduler_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("geomphys.batch.engines.CONNECT_S", 1)
    with pytest.raises(geomphys.ClusterError, match="no Dask scheduler"):
        Case(tmp_path, a=60).run(jobs=None, scheduler="tcp://127.0.0.1:9")
