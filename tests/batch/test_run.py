"""Batches from end to end: the bytes of single replays, whatever runs them, dies on the way, or was there before."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import geomphys
from geomphys.batch.executors import largest_first
from geomphys.batch.job import Job, run_job
from geomphys.batch.manifest import Entry, Manifest
from geomphys.output.provenance import sha256_of_file, sha256_of_world
from geomphys.storage.remote_files import as_path
from tests.cli.press import SCENE, write_log
from tests.scene.models import cube, stl

LONG = 15_000
"""Frames of a log that takes some seconds."""


NO_TIMES = geomphys.OutputOptions(timing=False)
Ended = Callable[[Entry], None] | None
Progress = Callable[[int, int | None], None] | None


class Case:
    """Logs, a scene, and a folder for the outputs."""

    def __init__(self, folder: Path, **frames: int) -> None:
        self.logs, self.scene, self.out = folder / "logs", folder / "scene.toml", folder / "out"
        self.logs.mkdir()
        self.scene.write_text(SCENE)
        for name, count in frames.items():
            write_log(self.logs / f"{name}.mcap", frames=count)

    def run(self, *, config: geomphys.Config | None = None, ended: Ended = None, progress: Progress = None,
            **options: Any) -> geomphys.BatchReport:  # fmt: skip
        """The batch, without stage times; `options` are of `BatchOptions`."""
        return geomphys.run_batch(
            [self.logs], self.scene, self.out, config=config, options=geomphys.BatchOptions(**{"jobs": 1, **options}),
            outputs=NO_TIMES, callbacks=geomphys.BatchCallbacks(ended=ended, progress=progress),
        )  # fmt: skip

    def check(self, *names: str, config: geomphys.Config | None = None) -> None:
        """Compare outputs with those of single replays; nothing else lies in the folder."""
        for name in names:
            single_run = self.scene.parent / f"{name}_alone.mcap"
            geomphys.run(
                self.logs / f"{name}.mcap",
                self.scene,
                out=single_run,
                options=geomphys.OutputOptions(timing=False),
                config=config,
                force=True,
            )
            assert (self.out / f"{name}.mcap").read_bytes() == single_run.read_bytes(), name
        assert {path.name for path in self.out.iterdir()} == {*(f"{name}.mcap" for name in names), "manifest.json"}


def test_outputs_are_those_of_single_replays_and_a_broken_log_stops_nothing(tmp_path: Path) -> None:
    case = Case(tmp_path, a=60, c=90)
    (case.logs / "b.mcap").write_bytes(b"no log")
    ended: list[Entry] = []
    counts: list[tuple[int, int | None]] = []
    config = geomphys.Config(seed=5)
    report = case.run(
        jobs=2, config=config, ended=ended.append, progress=lambda done, total: counts.append((done, total))
    )
    case.check("a", "c", config=config)
    assert [entry.status for entry in report.entries] == ["done", "failed", "done"]
    broken = report.entries[1]
    assert "b.mcap" in (broken.error or "")
    assert broken.traceback is None
    assert len(ended) == 3
    assert counts == [(0, 3), (1, 3), (2, 3), (3, 3)]
    manifest = json.loads((case.out / "manifest.json").read_text())
    assert [entry["out"] for entry in manifest["logs"]] == ["a.mcap", "b.mcap", "c.mcap"]
    first = manifest["logs"][0]
    assert first["metrics"]["frames"] == 60
    assert first["metrics"]["out"] == str(case.out / "a.mcap")
    assert first["parameters"]["seed"] == 5
    assert all(len(first[f"{what}_sha256"]) == 64 for what in ("input", "scene", "world", "out"))


def test_resume_replays_only_what_is_not_the_same_any_more(tmp_path: Path) -> None:
    case = Case(tmp_path, a=60, b=70, c=80)
    case.run()

    def replayed(config: geomphys.Config | None = None) -> set[str]:
        done: list[Entry] = []
        case.run(resume=True, ended=done.append, config=config)
        return {entry.out for entry in done}

    assert replayed() == set()
    write_log(case.logs / "a.mcap", frames=61)
    (case.out / "b.mcap").write_bytes(b"spoilt")
    assert replayed() == {"a.mcap", "b.mcap"}
    case.check("a", "b", "c")
    assert replayed(config=geomphys.Config(seed=1)) == {"a.mcap", "b.mcap", "c.mcap"}
    case.scene.write_text(SCENE.replace("0.4", "0.5"))
    assert replayed(config=geomphys.Config(seed=1)) == {"a.mcap", "b.mcap", "c.mcap"}
    write_log(case.logs / "d.mcap")
    assert replayed(config=geomphys.Config(seed=1)) == {"d.mcap"}


def test_a_log_that_is_gone_fails_alone_when_resumed(tmp_path: Path) -> None:
    case = Case(tmp_path, a=60, b=70)
    case.run()
    far = "https://127.0.0.1:9/gone.mcap"
    report = geomphys.run_batch(
        [case.logs, far], case.scene, case.out, options=geomphys.BatchOptions(jobs=1, resume=True), outputs=NO_TIMES
    )
    assert [(entry.out, entry.status) for entry in report.entries] == [
        ("a.mcap", "done"), ("b.mcap", "done"), ("gone.mcap", "failed")
    ]  # fmt: skip
    assert report.up_to_date == ("a.mcap", "b.mcap")
    assert far in (report.entries[2].error or "")


def test_a_scene_that_is_a_link_gives_the_bytes_of_a_replay(tmp_path: Path) -> None:
    case = Case(tmp_path, a=60)
    (tmp_path / "elsewhere").mkdir()
    mesh = '\n[[object]]\nname = "block"\nclass = "fixed"\nmesh = "cube.stl"\nposition = [3.0, 0.0, 0.0]\nmaterial = "wood"\n'
    (tmp_path / "elsewhere" / "other.toml").write_text(SCENE + mesh)
    stl(tmp_path / "cube.stl", *cube(0.1))
    case.scene.unlink()
    case.scene.symlink_to(tmp_path / "elsewhere" / "other.toml")
    case.run()
    case.check("a")


def test_a_scene_that_changes_under_a_batch_is_an_error_of_the_logs_after_that(tmp_path: Path) -> None:
    case = Case(tmp_path, a=60, b=60, c=60)  # b is at work when a is reported
    report = case.run(ended=lambda entry: case.scene.write_text(SCENE + "# changed\n"))
    assert [entry.status for entry in report.entries][::2] == ["done", "failed"]
    assert "is not what the batch began with" in (report.entries[2].error or "")
    assert not (case.out / "c.mcap").exists()
    assert case.run(resume=True).count("done") == 3
    case.check("a", "b", "c")


def test_outputs_are_on_disk_under_their_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is flushed once, before it gets its name, and the name after that; not under the name it is written by."""
    case, calls = Case(tmp_path, a=60), list[tuple[str, Path]]()
    fsync, replace_file = os.fsync, os.replace

    def synced(descriptor: int) -> None:
        calls.append(("flushed", Path(f"/proc/self/fd/{descriptor}").readlink()))
        fsync(descriptor)

    def replaced(source: Path, target: Path) -> None:
        calls.append(("renamed", Path(target)))
        replace_file(source, target)

    running = case.out / ".running"
    running.mkdir(parents=True)
    world = geomphys.load_world(case.scene)
    config, out = geomphys.Config(), case.out / "a.mcap"
    hashes = {"scene_sha256": sha256_of_file(case.scene), "world_sha256": sha256_of_world(world)}
    job = Job(
        log=case.logs / "a.mcap", scene=case.scene, out=out, rrd=None, config=config, options=NO_TIMES,
        running=running, **hashes,
    )  # fmt: skip
    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", replaced)
    assert run_job(job).status == "done"
    calls = [call for call in calls if call[1].is_relative_to(case.out)]
    _, work = calls[0]
    assert work.parent == running
    assert calls == [("renamed", work), ("flushed", work), ("renamed", out), ("flushed", case.out)]


def test_the_modules_that_read_scene_files_are_not_imported_for_a_batch_before_it_needs_them() -> None:
    """A world from the cache needs none of them, and pydantic takes a third of the time of all imports."""
    code = "import sys, geomphys.batch.run; sys.exit('pydantic' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_several_processes_begin_with_the_largest_logs(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    for name, size in (("bag/metadata.yaml", 10), ("bag/bag_0.mcap", 500), ("a.mcap", 20), ("b.mcap", 900)):
        (tmp_path / name).write_bytes(bytes(size))
    logs = [*(tmp_path / name for name in ("a.mcap", "gone.mcap", "b.mcap", "bag")), as_path("s3://bucket/c.mcap")]
    job = Job(
        log=bag, scene=bag, scene_sha256="", world_sha256="", out=bag, rrd=None, config=geomphys.Config(),
        options=geomphys.OutputOptions(), running=bag,
    )  # fmt: skip
    assert [index for index, _ in largest_first([replace(job, log=log) for log in logs])] == [2, 3, 0, 1, 4]


def test_a_failure_can_stop_the_batch(tmp_path: Path) -> None:
    case = Case(tmp_path, b=60)
    (case.logs / "a.mcap").write_bytes(b"no log")
    report = case.run(keep_going=False)
    assert [entry.status for entry in report.entries] == ["failed", "pending"]
    assert [entry.status for entry in case.run(resume=True).entries] == ["failed", "done"]


def test_the_next_log_is_at_work_while_one_is_reported(tmp_path: Path) -> None:
    case, until = Case(tmp_path, a=60, b=LONG), time.monotonic() + 20.0

    def ended(entry: Entry) -> None:
        while entry.out == "a.mcap" and not list((case.out / ".running").glob(".*.mcap.*.tmp")):
            assert time.monotonic() < until

    assert case.run(ended=ended).count("done") == 2


def test_an_output_that_cannot_be_published_is_an_error_of_its_log(tmp_path: Path) -> None:
    case = Case(tmp_path, a=60, b=60, c=60)
    report = case.run(ended=lambda entry: (case.out / "c.mcap").mkdir(exist_ok=True))
    assert [entry.status for entry in report.entries] == ["done", "done", "failed"]
    assert report.entries[2].error == f"{case.out / 'c.mcap'}: is a folder; name a file in it"
    assert {path.name for path in case.out.iterdir()} == {"a.mcap", "b.mcap", "c.mcap", "manifest.json"}
    (case.out / "c.mcap").rmdir()
    assert case.run(resume=True).count("done") == 3
    case.check("a", "b", "c")


def test_what_is_complete_when_a_batch_ends_early_is_published(tmp_path: Path) -> None:
    case, until = Case(tmp_path, a=60, b=60, c=LONG), time.monotonic() + 20.0

    def ended(entry: Entry) -> None:
        running = case.out / ".running"
        while not (list(running.glob("*.mcap")) and list(running.glob(".*.mcap.*.tmp"))):  # b is complete, c at work
            assert time.monotonic() < until
        raise RuntimeError(entry.out)

    with pytest.raises(RuntimeError, match=r"a\.mcap"):
        case.run(ended=ended)
    assert {path.name for path in case.out.iterdir()} == {"a.mcap", "b.mcap", "c.partial.mcap", "manifest.json"}
    assert case.run(resume=True).count("done") == 3
    case.check("a", "b", "c")


def test_outputs_that_are_there_are_not_replaced_unasked(tmp_path: Path) -> None:
    case = Case(tmp_path, a=60)
    case.out.mkdir()
    (case.out / "a.mcap").write_bytes(b"precious")
    for options in ({}, {"resume": True}):
        with pytest.raises(geomphys.OutputError, match=r"a\.mcap: exists"):
            case.run(**options)
    assert (case.out / "a.mcap").read_bytes() == b"precious"
    case.run(force=True)
    case.check("a")


def test_a_log_is_never_an_output(tmp_path: Path) -> None:
    case = Case(tmp_path, a=60)
    with pytest.raises(geomphys.OutputError, match="is an input"):
        geomphys.run_batch([case.logs / "a.mcap"], case.scene, case.logs, options=geomphys.BatchOptions(force=True))


def test_a_folder_takes_one_batch_at_a_time(tmp_path: Path) -> None:
    import fcntl

    case = Case(tmp_path, a=60)
    case.out.mkdir()
    lock = os.open(case.out, os.O_RDONLY)
    fcntl.flock(lock, fcntl.LOCK_EX)
    with pytest.raises(geomphys.OutputError, match="another batch"):
        case.run()
    os.close(lock)


def begin(case: Case, *words: str) -> subprocess.Popen[str]:
    """Begin the batch in a process of its own, and wait until its first log is done."""
    command = [
        sys.executable,
        "-m",
        "geomphys_cli",
        "batch",
        str(case.logs),
        "-s",
        str(case.scene),
        "-O",
        str(case.out),
    ]
    process = subprocess.Popen(
        [*command, "--jobs", "1", "--no-timing", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    end = time.monotonic() + 240
    while not any(entry.status == "done" for entry in Manifest.load(case.out).entries.values()):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.02)
    return process


def children(pid: int) -> list[int]:
    """Processes that a process has begun."""
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


@pytest.mark.slow
def test_a_batch_that_is_killed_resumes_to_the_same_files(tmp_path: Path) -> None:
    case = Case(tmp_path, a=60, b=LONG, c=70)
    process = begin(case)
    workers = children(process.pid)
    assert workers
    process.send_signal(signal.SIGKILL)
    process.communicate()
    end = time.monotonic() + 10
    while any(Path(f"/proc/{pid}/cmdline").exists() and Path(f"/proc/{pid}/cmdline").read_bytes() for pid in workers):
        assert time.monotonic() < end, "a worker outlives the batch"
        time.sleep(0.05)
    statuses = [entry.status for _, entry in sorted(Manifest.load(case.out).entries.items())]
    assert statuses == ["done", "pending", "pending"]
    report = case.run(resume=True, jobs=2)
    assert report.up_to_date == ("a.mcap",)
    assert report.count("done") == 3
    case.check("a", "b", "c")


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_batch_that_is_stopped_leaves_finished_parts(tmp_path: Path, number: signal.Signals, code: int) -> None:
    case = Case(tmp_path, a=60, b=LONG)
    process = begin(case)
    time.sleep(0.5)
    process.send_signal(number)
    output, error = process.communicate(timeout=60)
    assert (process.returncode, output) == (code, "")
    assert "Traceback" not in error
    assert {path.name for path in case.out.iterdir()} == {"a.mcap", "b.partial.mcap", "manifest.json"}
    assert case.run(resume=True).count("done") == 2
    case.check("a", "b")


@pytest.mark.slow
def test_a_process_that_dies_is_replaced(tmp_path: Path) -> None:
    case = Case(tmp_path, a=60, b=LONG, c=70)
    process = begin(case)
    for pid in children(process.pid):
        if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes():
            os.kill(pid, signal.SIGKILL)
    output, error = process.communicate(timeout=120)
    assert process.returncode == 0, error
    assert "3 done" in output
    case.check("a", "b", "c")
