"""One batch at a time in a folder behind a URL."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import cast

import pytest
from geomphys_cli.main import run

from geomphys.batch.remote_lock import LOCK, remote_lock_held
from geomphys.errors import OutputError
from geomphys.storage.cache import user_cache_folder
from geomphys.storage.remote_files import RemotePath, as_path
from tests.cli.press import SCENE, write_log
from tests.servers import s3_server

pytestmark = pytest.mark.filterwarnings("ignore:datetime.datetime.utc:DeprecationWarning")

HOLD = """
import sys
from geomphys.batch.remote_lock import remote_lock_held
from geomphys.storage.remote_files import RemotePath
with remote_lock_held(RemotePath(sys.argv[1])):
    print("held", flush=True)
    input()
"""


def use_cache(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Be a user, or a machine, with this cache."""
    folder.mkdir()
    monkeypatch.setattr("geomphys.batch.remote_lock.user_cache_folder", lambda name: folder)


@pytest.fixture
def lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[RemotePath]:
    """A lock in memory; the user's cache is a new one."""
    use_cache(tmp_path / "cache", monkeypatch)
    path = cast(RemotePath, as_path(f"memory://{tmp_path.name}/out/.running/{LOCK}"))
    yield path
    path.unlink(missing_ok=True)


def test_the_object_is_there_while_the_batch_is(lock: RemotePath) -> None:
    with remote_lock_held(lock):
        content = json.loads(lock.read_bytes())
        assert content["pid"] == os.getpid()
        assert set(content) == {"host", "pid", "began", "machine", "batch"}
    assert not lock.exists()
    with pytest.raises(ZeroDivisionError), remote_lock_held(lock):
        raise ZeroDivisionError
    assert not lock.exists()


def test_a_second_of_this_machine_is_refused(lock: RemotePath) -> None:
    with remote_lock_held(lock):
        with pytest.raises(OutputError, match="another batch of this machine"), remote_lock_held(lock):
            pass
        assert lock.exists()


@pytest.mark.parametrize(
    "content", [b'{"host": "far", "pid": 7, "began": "noon", "machine": "x"}', b"", b"[]", b"\xff"]
)
def test_one_of_another_machine_is_refused_and_named(lock: RemotePath, content: bytes) -> None:
    lock.write_bytes(content)
    with pytest.raises(OutputError) as error, remote_lock_held(lock):
        pass
    assert str(lock) in str(error.value)
    assert f"{lock.parent.parent}: another batch" in str(error.value)
    assert b"far" not in content or "process 7 on 'far' since noon" in str(error.value)
    assert lock.read_bytes() == content


def test_only_what_this_machine_left_is_taken_over(
    lock: RemotePath, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with remote_lock_held(lock):
        existing = lock.read_bytes()
    lock.write_bytes(existing)
    with remote_lock_held(lock):  # the batch that made it is gone: it does not hold the local file
        assert lock.read_bytes() != existing
    lock.write_bytes(existing)
    use_cache(tmp_path / "another", monkeypatch)
    with pytest.raises(OutputError, match="another batch"), remote_lock_held(lock):
        pass


def test_a_store_without_conditional_writes_lets_one_win(lock: RemotePath, monkeypatch: pytest.MonkeyPatch) -> None:
    other = b'{"host": "far", "pid": 7}'

    def create(self: RemotePath, data: bytes) -> None:
        self.write_bytes(data)
        self.write_bytes(other)  # at the same time

    monkeypatch.setattr(RemotePath, "create", create)
    with pytest.raises(OutputError, match="process 7"), remote_lock_held(lock):
        pass
    assert lock.read_bytes() == other


def test_on_s3_one_of_two_is_refused_and_a_killed_one_is_taken_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    user_cache_folder.cache_clear()  # which tests before may have set elsewhere
    write_log(tmp_path / "a.mcap")
    (tmp_path / "scene.toml").write_text(SCENE)
    with s3_server(monkeypatch) as bucket:
        path = cast(RemotePath, as_path(f"{bucket}/out/.running/{LOCK}"))
        path.create(b"{}")
        with pytest.raises(FileExistsError):
            path.create(b"{}")
        words = [
            "batch",
            str(tmp_path / "a.mcap"),
            "-s",
            str(tmp_path / "scene.toml"),
            "-O",
            f"{bucket}/out",
            "-j",
            "1",
        ]
        assert run(words) != 0
        assert f"remove {path}" in capsys.readouterr().err
        path.unlink()
        command = [sys.executable, "-c", HOLD, str(path)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
            assert other.stdout is not None
            assert other.stdout.readline() == "held\n"
            assert run(words) != 0
            assert "another batch of this machine" in capsys.readouterr().err
            other.send_signal(signal.SIGKILL)
        assert path.exists()
        assert run(words) == 0
        assert not path.exists()
