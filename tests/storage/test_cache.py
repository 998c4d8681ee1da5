"""Where costly things are kept."""

from __future__ import annotations

import hashlib
import os
import pickle
import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from geomphys.jit import folder
from geomphys.jit.folder import _numba_settings, _sources_of_machine_code
from geomphys.storage import cache
from tests.house.sources import imports, modules
from tests.storage.test_records import Evil


@pytest.fixture(autouse=True)
def forgotten() -> Iterator[None]:
    """No folder is remembered from before, nor after."""
    cache.user_cache_folder.cache_clear()
    yield
    cache.user_cache_folder.cache_clear()


def test_machine_code_is_named_after_every_module_with_a_kernel() -> None:
    kernels = {
        name
        for name, text in cache.sources().items()
        if re.search(rb"^@(kernel|noinline|inlined)$", text, re.MULTILINE)
    }
    assert "geomphys.engine.step" in kernels
    assert kernels <= {name for name, _ in _sources_of_machine_code()}


def test_the_users_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache.user_cache_folder("pieces") == tmp_path / "geomphys" / "pieces"
    assert (tmp_path / "geomphys" / "pieces").is_dir()


def test_a_home_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(tmp_path / "temp"))
    folder = cache.user_cache_folder("pieces")
    assert folder.parent.parent == tmp_path / "temp"
    assert folder.is_dir()


def test_nobody_elses_folder_in_a_place_for_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(cache.tempfile, "tempdir", str(tmp_path))
    shared = tmp_path / f"geomphys-{os.getuid()}"
    shared.mkdir()
    shared.chmod(0o777)
    assert not cache.user_cache_folder("kernels").is_relative_to(shared)
    cache.user_cache_folder.cache_clear()
    shared.chmod(0o700)
    assert cache.user_cache_folder("kernels") == shared / "kernels"
    cache.user_cache_folder.cache_clear()
    (shared / "kernels").rmdir()
    shared.rename(tmp_path / "another")
    shared.symlink_to(tmp_path / "another")
    assert not cache.user_cache_folder("kernels").is_relative_to(shared)


@pytest.mark.parametrize("loose", ["base", "folder"])
@pytest.mark.parametrize("how", ["mode", "owner", "link"])
def test_a_folder_of_the_home_that_others_can_write_to_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, loose: str, how: str
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(cache.tempfile, "tempdir", str(tmp_path / "temp"))
    (tmp_path / "temp").mkdir()
    folder = tmp_path / "geomphys" / "worlds"
    folder.mkdir(parents=True)
    folder.parent.chmod(0o700)
    folder.chmod(0o700)
    bad = folder if loose == "folder" else folder.parent
    if how == "mode":
        bad.chmod(0o770)
    elif how == "link":
        bad.rename(tmp_path / "elsewhere")
        bad.symlink_to(tmp_path / "elsewhere")
    elif os.getuid() == 0:
        os.chown(bad, 65534, 65534)
    else:
        pytest.skip("only root gives files away")
    assert cache.user_cache_folder("worlds").is_relative_to(tmp_path / "temp")


def test_no_home_and_no_passwd_entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(cache.Path, "home", classmethod(_no_home))
    monkeypatch.setattr(cache.tempfile, "tempdir", str(tmp_path))
    assert cache.user_cache_folder("worlds") == tmp_path / f"geomphys-{os.getuid()}" / "worlds"


def _no_home(kind: type[Path]) -> Path:
    raise RuntimeError("Could not determine home directory.")


@pytest.mark.parametrize("how", ["flipped", "cut", "loose", "link", "foreign"])
def test_a_stored_value_that_is_damaged_or_not_ours_is_missing(tmp_path: Path, how: str) -> None:
    store = cache.Store(tmp_path)
    store.save("a", {"x": [1, 2.5, b"z"]})
    assert store.load("a") == {"x": [1, 2.5, b"z"]}
    file = tmp_path / "a"
    data = file.read_bytes()
    if how == "flipped":
        for bit in range(8 * len(data)):
            broken = bytearray(data)
            broken[bit // 8] ^= 1 << bit % 8
            file.write_bytes(broken)
            assert store.load("a") is None, bit
    elif how == "cut":
        file.write_bytes(data[:-1])
    elif how == "loose":
        file.chmod(0o666)
    elif how == "link":
        file.rename(tmp_path / "b")
        file.symlink_to("b")
    elif os.getuid() == 0:
        os.chown(file, 65534, 65534)
    else:
        pytest.skip("only root gives files away")
    assert store.load("a") is None
    store.save("a", 3)
    assert store.load("a") == 3
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o600


def test_a_pickle_in_the_cache_does_not_run(tmp_path: Path) -> None:
    """With the right digest in front, as the format before this one had it."""
    data = pickle.dumps(Evil(tmp_path / "ran"))
    (tmp_path / "a").write_bytes(hashlib.sha256(data).digest() + data)
    (tmp_path / "a").chmod(0o600)
    assert cache.Store(tmp_path).load("a") is None
    assert not (tmp_path / "ran").exists()


OF_ITS_OWN_PROCESS = "storage.process_pool"
"""Unpickles what its parent process wrote, by a digest that comes another way; see its tests."""


@pytest.mark.parametrize("module", ["storage", "jit", "scene", "output", "analysis", "recording"])
def test_nothing_that_reads_files_unpickles(module: str) -> None:
    for name, path in modules("geomphys").items():
        if name.startswith(module) and name != OF_ITS_OWN_PROCESS:
            assert "pickle" not in {imported.split(".")[0] for imported in imports(path)}, name
            assert "allow_pickle=True" not in path.read_text()


def test_sources_are_those_of_the_whole_package() -> None:
    """Machine code and scenes in the cache are found by them: what is left out could change unnoticed."""
    names = {"geomphys", *(f"geomphys.{name}" for name in modules("geomphys") if name)}
    assert names <= set(cache.sources())


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package of two modules in place of the own one, and an empty cache."""
    folder = tmp_path / "package"
    (folder / "below").mkdir(parents=True)
    (folder / "__init__.py").write_text("a = 1")
    (folder / "below" / "module.py").write_text("b = 1")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(cache, "PACKAGE", str(folder))
    cache.installed_state.cache_clear()
    yield folder
    cache.installed_state.cache_clear()


def state(*libraries: str) -> str:
    """As a process that starts now sees it."""
    cache.installed_state.cache_clear()
    return cache.installed_state(*libraries)


def test_the_state_of_an_installation_changes_with_each_source_and_library(package: Path) -> None:
    states = [state(), state("numpy"), state("numba")]
    (package / "below" / "module.py").write_text("b = 2")  # as long as before
    states += [state()]
    os.utime(package / "below" / "module.py", (0, 0))  # a copy that keeps its time
    states += [state()]
    (package / "below" / "another.py").write_text("")
    states += [state()]
    assert len(set(states)) == len(states)
    (package / "below" / "note.txt").write_text("")
    assert state() == states[-1]


def test_sources_of_machine_code_are_read_where_the_installation_changed(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts, read = [("module", b"one")], []
    monkeypatch.setattr(folder, "_sources_of_machine_code", lambda: read.append(1) or texts)
    first = folder._digest_of_sources()
    assert folder._digest_of_sources() == first
    assert len(read) == 1
    (package / "__init__.py").write_text("a = 2")
    cache.installed_state.cache_clear()
    assert folder._digest_of_sources() == first  # of other sources than those of machine code
    assert len(read) == 2
    texts[0] = ("module", b"two")
    (package / "__init__.py").write_text("a = 3")
    cache.installed_state.cache_clear()
    assert folder._digest_of_sources() != first


def folder_of_kernels(base: Path, name: str, days: float) -> Path:
    """A folder with a file, last used so many days ago."""
    folder = base / name
    folder.mkdir(mode=0o700)
    (folder / "code").write_bytes(b"machine code")
    used = time.time() - days * 86_400
    os.utime(folder, (used, used))
    return folder


KERNELS = re.compile(r"kernels-[0-9a-f]{16}")


def test_folders_of_kernels_that_were_not_used_for_a_month_are_removed(tmp_path: Path) -> None:
    current = folder_of_kernels(tmp_path, f"kernels-{'0' * 16}", days=40)
    recent = folder_of_kernels(tmp_path, f"kernels-{'1' * 16}", days=29)
    folder_of_kernels(tmp_path, f"kernels-{'2' * 16}", days=31)
    folder_of_kernels(tmp_path, f"kernels-{'3' * 16}.removed-0123abcd", days=31)  # a process ended here
    other = folder_of_kernels(tmp_path, "pieces", days=400)
    writable = folder_of_kernels(tmp_path, f"kernels-{'4' * 16}", days=31)
    writable.chmod(0o777)
    cache.remove_unused(current, KERNELS)
    assert sorted(tmp_path.iterdir()) == sorted([current, recent, writable, other])
    assert time.time() - current.stat().st_mtime < 60  # marked as used


def test_a_folder_that_is_used_while_it_is_removed_keeps_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = folder_of_kernels(tmp_path, f"kernels-{'2' * 16}", days=31)
    rename = Path.rename

    def used_meanwhile(self: Path, target: Path) -> Path:
        os.utime(self)
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", used_meanwhile)
    cache.remove_unused(folder_of_kernels(tmp_path, f"kernels-{'0' * 16}", days=0), KERNELS)
    assert (old / "code").read_bytes() == b"machine code"


def test_nothing_beside_a_temporary_folder_is_removed(tmp_path: Path) -> None:
    foreign = folder_of_kernels(tmp_path, f"kernels-{'2' * 16}", days=31)
    cache.remove_unused(folder_of_kernels(tmp_path, "geomphys-1x2y", days=0), KERNELS)
    assert foreign.is_dir()


def test_machine_code_is_named_after_the_settings_of_numba(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """numba reads them from the environment, and from a file in the working directory."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("NUMBA_OPT", raising=False)
    plain = _numba_settings()
    monkeypatch.setenv("NUMBA_OPT", "1")
    by_variable = _numba_settings()
    (tmp_path / ".numba_config.yaml").write_text("opt: 1\n")
    assert plain != by_variable != _numba_settings()
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/elsewhere")
    monkeypatch.delenv("NUMBA_OPT")
    (tmp_path / ".numba_config.yaml").unlink()
    assert _numba_settings() == plain
