"""Output files: whole or not there, never over an input or a device, two writers of one name both finish."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from geomphys.errors import OutputError, RefusedTargetError
from geomphys.storage.output_file import (
    InputFiles,
    OutputFile,
    check_target,
    check_targets,
    flushed_later,
    publish,
    write_file,
)


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_file_has_its_name_when_it_is_complete_and_not_before(tmp_path: Path) -> None:
    with OutputFile(tmp_path / "a.bin") as output:
        output.stream.write(b"one")
        assert not (tmp_path / "a.bin").exists()
    assert (tmp_path / "a.bin").read_bytes() == b"one"
    assert names(tmp_path) == {"a.bin"}


def test_what_fails_leaves_nothing_and_what_was_there(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(b"old")

    def fail_halfway() -> None:
        with OutputFile(tmp_path / "a.bin", force=True) as output:
            output.stream.write(b"new")
            raise KeyError

    with pytest.raises(KeyError):
        fail_halfway()
    assert names(tmp_path) == {"a.bin"}
    assert (tmp_path / "a.bin").read_bytes() == b"old"


def test_an_output_that_is_dropped_leaves_nothing(tmp_path: Path) -> None:
    output = OutputFile(tmp_path / "a.bin")
    assert len(names(tmp_path)) == 1
    del output
    assert names(tmp_path) == set()


def test_a_part_goes_beside(tmp_path: Path) -> None:
    output = OutputFile(tmp_path / "a.bin", partial=True)
    output.stream.write(b"part")
    assert output.publish(complete=False) == tmp_path / "a.partial.bin"
    assert names(tmp_path) == {"a.partial.bin"}


def test_a_part_that_is_there_needs_force(tmp_path: Path) -> None:
    (tmp_path / "a.partial.bin").write_bytes(b"kept")
    with pytest.raises(RefusedTargetError, match=r"a\.partial\.bin: exists already"):
        OutputFile(tmp_path / "a.bin", partial=True)
    OutputFile(tmp_path / "a.bin", partial=True, force=True).discard()
    OutputFile(tmp_path / "a.bin").discard()
    assert (tmp_path / "a.partial.bin").read_bytes() == b"kept"


@pytest.mark.parametrize("partial", [False, True])
def test_a_part_is_no_input_either(tmp_path: Path, partial: bool) -> None:
    (tmp_path / "a.partial.bin").write_bytes(b"read")
    read = [tmp_path / "a.partial.bin"]
    if partial:
        with pytest.raises(RefusedTargetError, match="is an input"):
            check_target(tmp_path / "a.bin", force=True, inputs=read, partial=True)
    else:
        check_target(tmp_path / "a.bin", force=True, inputs=read)


@pytest.mark.parametrize("how", ["itself", "hard link", "symbolic link", "by another folder"])
def test_an_input_is_no_output_under_any_name(tmp_path: Path, how: str) -> None:
    read, target = tmp_path / "in.bin", tmp_path / "out.bin"
    read.write_bytes(b"read")
    if how == "hard link":
        os.link(read, target)
    elif how == "symbolic link":
        target.symlink_to(read)
    elif how == "by another folder":
        (tmp_path / "folder").symlink_to(tmp_path)
        target = tmp_path / "folder" / "in.bin"
    else:
        target = read
    with pytest.raises(RefusedTargetError, match="is an input"):
        OutputFile(target, force=True, inputs=[read])
    assert read.read_bytes() == b"read"


def test_inputs_are_looked_up_once_and_only_if_an_output_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked_up: list[Path] = []
    read = [tmp_path / "in.bin", tmp_path / "gone.bin"]
    read[0].write_bytes(b"read")
    find = Path.stat

    def counted(path: Path, **options: bool) -> os.stat_result:
        looked_up.extend([path] if path in read else [])
        return find(path, **options)

    monkeypatch.setattr(Path, "stat", counted)
    inputs = InputFiles(read)
    check_target(tmp_path / "out.bin", inputs=inputs)
    assert looked_up == []
    (tmp_path / "out.bin").write_bytes(b"old")
    for _ in range(2):
        check_target(tmp_path / "out.bin", inputs=inputs, force=True)
    assert looked_up == read


def test_a_link_is_replaced_and_what_it_leads_to_is_left(tmp_path: Path) -> None:
    (tmp_path / "other.bin").write_bytes(b"other")
    (tmp_path / "a.bin").symlink_to(tmp_path / "other.bin")
    (tmp_path / "b.bin").symlink_to(tmp_path / "nothing")
    for name in ("a.bin", "b.bin"):
        with pytest.raises(RefusedTargetError, match="exists already"):
            OutputFile(tmp_path / name)
        write_file(tmp_path / name, b"new", force=True)
        assert not (tmp_path / name).is_symlink()
    assert (tmp_path / "other.bin").read_bytes() == b"other"
    assert not (tmp_path / "nothing").exists()


@pytest.mark.parametrize("kind", ["fifo", "device", "folder", "link to a device"])
def test_what_is_no_regular_file_is_refused(tmp_path: Path, kind: str) -> None:
    target = tmp_path / "a.bin"
    if kind == "fifo":
        os.mkfifo(target)
    elif kind == "device":
        target = Path("/dev/null")
    elif kind == "folder":
        target.mkdir()
    else:
        target.symlink_to("/dev/null")
    before = target.lstat()
    with pytest.raises(RefusedTargetError, match=r"is no regular file|is a folder"):
        OutputFile(target, force=True)
    assert target.lstat().st_mode == before.st_mode
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)


def test_a_device_that_came_meanwhile_is_not_replaced(tmp_path: Path) -> None:
    output = OutputFile(tmp_path / "a.bin")
    os.mkfifo(tmp_path / "a.bin")
    with pytest.raises(RefusedTargetError, match="is no regular file"):
        output.publish()
    assert names(tmp_path) == {"a.bin"}
    assert (tmp_path / "a.bin").is_fifo()


@pytest.mark.parametrize("trap", ["symbolic link", "fifo"])
def test_nothing_that_waits_under_the_temporary_name_is_written_through(
    tmp_path: Path, trap: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first name is taken by a trap; another is chosen, and the trap is as it was."""
    chosen = iter(["00000000", "11111111"])
    monkeypatch.setattr("geomphys.storage.output_file.secrets.token_hex", lambda _: next(chosen))
    victim, waiting = tmp_path / "victim", tmp_path / ".a.bin.00000000.tmp"
    victim.write_bytes(b"mine")
    if trap == "fifo":
        os.mkfifo(waiting)
    else:
        waiting.symlink_to(victim)
    write_file(tmp_path / "a.bin", b"new")
    assert victim.read_bytes() == b"mine"
    assert names(tmp_path) == {"a.bin", "victim", waiting.name}


def test_two_writers_of_one_name_both_finish_and_the_last_one_wins(tmp_path: Path) -> None:
    first, second = OutputFile(tmp_path / "a.bin"), OutputFile(tmp_path / "a.bin")
    for output, letter in ((first, b"1"), (second, b"2"), (first, b"1"), (second, b"2")):
        output.stream.write(100_000 * letter)
    assert second.publish() == first.publish()
    assert (tmp_path / "a.bin").read_bytes() == 200_000 * b"1"
    assert names(tmp_path) == {"a.bin"}


def test_what_a_killed_process_left_is_removed_by_the_next_and_what_is_in_use_is_not(tmp_path: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path; from geomphys.storage.output_file import OutputFile\n"
        "kept = OutputFile(Path(sys.argv[1])); print(flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "a.bin")], stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        child.stdout.readline()
        (left,) = names(tmp_path)
        OutputFile(tmp_path / "a.bin").discard()
        assert names(tmp_path) == {left}
        child.send_signal(signal.SIGKILL)
    assert names(tmp_path) == {left}
    OutputFile(tmp_path / "b.bin").discard()
    assert names(tmp_path) == {left}
    OutputFile(tmp_path / "a.bin").discard()
    assert names(tmp_path) == set()


def test_a_hidden_file_of_the_user_is_not_taken_for_stale(tmp_path: Path) -> None:
    for name in (".a.bin.mynotes1.tmp", ".a.bin.1234567.tmp", ".a.bin.0123456789.tmp"):
        (tmp_path / name).write_bytes(b"kept")
    OutputFile(tmp_path / "a.bin").discard()
    assert len(names(tmp_path)) == 3


def test_a_fork_removes_nothing_of_the_process_that_writes(tmp_path: Path) -> None:
    code = (
        "import os, sys; from pathlib import Path; from geomphys.storage.output_file import OutputFile\n"
        "from geomphys.storage.temporary_folders import TemporaryFolder\n"
        "output, folder = OutputFile(Path(sys.argv[1])), TemporaryFolder()\n"
        "if os.fork() == 0: sys.exit()\n"
        "os.wait(); assert folder.path.is_dir(); output.stream.write(b'whole'); output.publish()"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "a.bin")], check=True)
    assert (tmp_path / "a.bin").read_bytes() == b"whole"


def test_what_a_fork_writes_goes_nowhere_and_it_publishes_nothing(tmp_path: Path) -> None:
    """It has a copy of what was buffered, and shares the position in the file."""
    code = (
        "import os, sys; from pathlib import Path; from geomphys.storage.output_file import OutputFile\n"
        "output, part = (OutputFile(Path(name), partial=True) for name in sys.argv[1:])\n"
        "output.stream.write(b'begin')\n"
        "if os.fork() == 0:\n"
        " output.stream.write(bytes(100_000)); part.publish(complete=False); output.publish()\n"
        "assert os.wait()[1] == 256; output.stream.write(b', end'); output.publish()"
    )
    words = [sys.executable, "-c", code, *(str(tmp_path / name) for name in ("a.bin", "b.bin"))]
    done = subprocess.run(words, check=True, capture_output=True, text=True)
    assert done.stderr.endswith("a.bin: is written by the process that this one is a fork of\n")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a.bin": b"begin, end"}


def test_file_and_folder_are_on_disk_before_it_returns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The order of SQLite's manual: the data, then the name, then the folder."""
    calls: list[str] = []
    fsync, replace = os.fsync, os.replace

    def synced(descriptor: int) -> None:
        calls.append("folder" if stat.S_ISDIR(os.fstat(descriptor).st_mode) else "file")
        fsync(descriptor)

    def replaced(source: Path, target: Path) -> None:
        calls.append("rename")
        replace(source, target)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", replaced)
    write_file(tmp_path / "a.bin", b"data")
    assert calls == ["file", "rename", "folder"]
    (tmp_path / "b.bin").write_bytes(b"made elsewhere")
    publish(tmp_path / "b.bin", tmp_path / "c.bin")
    assert calls == 2 * ["file", "rename", "folder"]
    calls.clear()
    with flushed_later():
        write_file(tmp_path / "work", b"data")
    assert calls == ["rename"]
    publish(tmp_path / "work", tmp_path / "d.bin")
    assert calls == ["rename", "file", "rename", "folder"]


def test_a_dash_is_standard_output(tmp_path: Path) -> None:
    code = (
        "from pathlib import Path; from geomphys.storage.output_file import OutputFile\n"
        "with OutputFile(Path('-')) as output: output.stream.write(bytes(range(256)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, cwd=tmp_path)
    assert done.stdout == bytes(range(256))
    assert names(tmp_path) == set()


def test_two_outputs_of_one_name_are_refused(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path)
    for other in (tmp_path / "a.bin", tmp_path / "link" / "a.bin"):
        with pytest.raises(RefusedTargetError, match="two outputs"):
            check_targets([tmp_path / "a.bin", other])
    check_targets([tmp_path / "a.bin", tmp_path / "b.bin"])


def test_long_names_and_missing_folders(tmp_path: Path) -> None:
    write_file(tmp_path / ("ä" * 127), b"long")
    assert (tmp_path / ("ä" * 127)).read_bytes() == b"long"
    with pytest.raises(OutputError, match="cannot be written"):
        write_file(tmp_path / ("ä" * 200), b"too long")
    with pytest.raises(OutputError, match="does not exist; make it first"):
        write_file(tmp_path / "no" / "a.bin", b"data")
    with pytest.raises(OutputError, match="cannot be written"):
        write_file(tmp_path / "nul\0", b"data")
