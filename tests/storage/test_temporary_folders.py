"""Temporary folders: gone with their process, however it ends, and nothing else removed."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from geomphys.storage import temporary_folders
from geomphys.storage.temporary_folders import LOCK, PREFIX, TemporaryFolder, remove_stale

HOLD = "from geomphys.storage.temporary_folders import TemporaryFolder; t = TemporaryFolder(); print(t.path, flush=True); input()"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The temporary folder of this process and its children."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    temporary_folders._remove_stale_once.cache_clear()
    return tmp_path


def test_a_folder_is_gone_after_its_block(folder: Path) -> None:
    with TemporaryFolder() as path:
        assert path.parent == folder
        (path / "inner").mkdir()
        (path / "inner" / "file").write_bytes(b"x")
    assert list(folder.iterdir()) == []


def test_what_a_killed_process_left_goes_at_the_next_start_and_nothing_else(folder: Path) -> None:
    others = ["geomphys-notes", "geomphys-0", "other-1"]
    for name in others:
        (folder / name).mkdir()
        (folder / name / "precious").write_bytes(b"x")
    (folder / "geomphys-file").write_bytes(b"x")
    (folder / "kept").mkdir()
    (folder / "kept" / LOCK).write_bytes(b"")
    (folder / "geomphys-link").symlink_to(folder / "kept")
    (folder / "geomphys-0" / LOCK).symlink_to(folder / "kept" / LOCK)
    before = {path.name for path in folder.iterdir()}
    command = [sys.executable, "-c", HOLD]
    held = [subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    try:
        paths = [Path(process.stdout.readline().strip()) for process in held if process.stdout]
        assert len(paths) == 2
        for path in paths:
            (path / "result.mcap").write_bytes(b"x")
        assert {path.name for path in folder.iterdir()} == before | {path.name for path in paths}
        held[0].send_signal(signal.SIGKILL)
        held[0].wait()
        assert paths[0].is_dir()
        with TemporaryFolder() as own:
            assert not paths[0].exists()
            assert (paths[1] / "result.mcap").is_file()
            remove_stale(folder)
            assert own.is_dir()
    finally:
        for process in held:
            process.kill()
            process.communicate()
    remove_stale(folder)
    assert {path.name for path in folder.iterdir()} == before
    assert all((folder / name / "precious").is_file() for name in others)
    assert PREFIX in paths[1].name
