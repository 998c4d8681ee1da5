"""Kernels are compiled once per machine and version, by whoever is there to do it, and give the same whoever did."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

KERNELS = """
import math
from typing import NamedTuple
from geomphys.jit.kernel import inlined, kernel, noinline

class Pair(NamedTuple):
    first: float
    second: int

@inlined
def tiny(x: float) -> float:
    return x * 0.1

@noinline
def bottom(x: float, k: int) -> Pair:
    return Pair(math.sin(x) + tiny(x), k)

@kernel
def middle(x: float) -> float:
    return bottom(x, 1).first + bottom(x, 2).second

@noinline
def upper(x: float) -> tuple[float, bool]:
    return 2.0 * middle(x), x > 0.0

@kernel
def top(x: float) -> float:
    value, positive = upper(x)
    return value + middle(x) if positive else -1.0
"""

RUN = """
import json, sys
import numba
import geomphys.jit.work as work

mode = sys.argv[1]
compiled, told, helpers = [], [], []
cfunc, helper = numba.cfunc, work._helper

def counted(*args, **kwargs):
    def compile(function):
        if not function.__name__.startswith("entry"):
            compiled.append(function.__name__)
        return cfunc(*args, **kwargs)(function)
    return compile

def start(entries, units):
    helpers.append(helper(entries, units))
    if mode == "killed":
        helpers[-1].kill()
    if mode == "helped":
        helpers[-1].wait()
    return helpers[-1]

numba.cfunc = counted
work._helper = start
work.MIN_FOR_HELPERS = 99 if mode == "alone" else 1
work.processes = lambda: 2

def tell(done, known):
    told.append((done, known))
    if mode == "interrupted" and helpers:
        raise KeyboardInterrupt

import stacked
value = left = None
try:
    with work.progress_to(tell):
        if mode in ("ahead", "left"):
            stacked.top.compile_ahead(0.5)
        if mode == "ahead":
            helpers[-1].wait()
        if mode == "left":
            raise KeyboardInterrupt
        value = stacked.top(0.5).hex()
except KeyboardInterrupt:
    left = [process.poll() is None for process in helpers]
json.dump({"value": value, "compiled": sorted(compiled), "told": told, "helpers": len(helpers), "left": left}, sys.stdout)
"""

EXPECTED = 3.0 * (math.sin(0.5) + 0.5 * 0.1 + 2.0)


class Place:
    """A folder with the kernels, and the cache they are compiled into."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(exist_ok=True)
        (folder / "stacked.py").write_text(KERNELS)
        self.folder = folder
        path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
        self.environment = os.environ | {"PYTHONPATH": path, "XDG_CACHE_HOME": str(folder / "cache")}

    def start(self, *command: str) -> subprocess.Popen[str]:
        pipe = subprocess.PIPE
        return subprocess.Popen(
            [sys.executable, *command], env=self.environment, stdout=pipe, stderr=pipe, text=True, cwd=self.folder
        )

    def run(self, mode: str) -> Any:
        return result(self.start("-c", RUN, mode))

    def products(self, kind: str) -> list[str]:
        """Names of the kernels that are on disk."""
        return sorted(path.name.split(".")[1] for path in (self.folder / "cache").rglob(f"stacked.*.{kind}"))


def result(process: subprocess.Popen[str]) -> Any:
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    return json.loads(out)


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> tuple[Place, Any]:
    """Kernels compiled by one process, and what it said."""
    place = Place(tmp_path_factory.mktemp("alone"))
    return place, place.run("alone")


def test_outlined_kernels_are_compiled_once_and_what_python_calls_is_an_entry(alone: tuple[Place, Any]) -> None:
    place, said = alone
    assert float.fromhex(said["value"]) == pytest.approx(EXPECTED, rel=1e-15)
    assert said["compiled"] == place.products("unit") == ["bottom", "upper"]
    assert place.products("entry") == ["top"]


def test_progress_grows_to_its_end(alone: tuple[Place, Any]) -> None:
    _, said = alone
    done, known = zip(*said["told"], strict=True)
    assert list(done) == sorted(done)
    assert all(d < k for d, k in zip(done, known, strict=True))
    assert known[-1] == 2


def test_a_second_process_compiles_nothing(alone: tuple[Place, Any]) -> None:
    place, said = alone
    again = place.run("alone")
    assert again["compiled"] == []
    assert again["value"] == said["value"]


def test_what_is_compiled_runs_without_numba(alone: tuple[Place, Any]) -> None:
    place, said = alone
    process = place.start(
        "-c", "import json, sys, stacked\nprint(json.dumps([stacked.top(0.5).hex(), 'numba' in sys.modules]))"
    )
    assert result(process) == [said["value"], False]


@pytest.mark.parametrize("damage", ["cut", "changed", "gone", "link", "open to others", "of another user"])
@pytest.mark.parametrize(("name", "compiled"), [("bottom.*.unit", ["bottom"]), ("top.*.program", [])])
def test_damaged_and_foreign_files_are_made_anew(
    alone: tuple[Place, Any], tmp_path: Path, damage: str, name: str, compiled: list[str]
) -> None:
    """Only machine code that was written by this user and is as it was written is run."""
    place, said = alone
    (file,) = (place.folder / "cache").rglob(f"*.{name}")
    data = file.read_bytes()
    if compiled:  # it is looked for where there is no program
        for program in (place.folder / "cache").rglob("*.program"):
            program.unlink()
    if damage == "cut":
        file.write_bytes(data[: len(data) // 2])
    elif damage == "changed":
        file.write_bytes(data[:-40] + bytes([data[-40] ^ 1]) + data[-39:])
    elif damage == "gone":
        file.unlink()
    elif damage == "link":
        file.rename(tmp_path / "elsewhere")
        file.symlink_to(tmp_path / "elsewhere")
    elif damage == "open to others":
        file.chmod(0o666)
    elif os.getuid() == 0:
        os.chown(file, 65534, 65534)
    else:
        pytest.skip("only root gives files away")
    again = place.run("alone")
    assert again["compiled"] == compiled
    assert again["value"] == said["value"]
    assert not file.is_symlink()
    assert compiled or file.read_bytes() == data
    assert place.run("alone")["compiled"] == []


def test_a_changed_kernel_is_compiled_anew(tmp_path: Path) -> None:
    place = Place(tmp_path)
    place.run("alone")
    source = tmp_path / "stacked.py"
    source.write_text(source.read_text().replace("x * 0.1", "x * 0.3"))
    value = float.fromhex(place.run("alone")["value"])
    assert value == pytest.approx(3.0 * (math.sin(0.5) + 0.5 * 0.3 + 2.0), rel=1e-15)


@pytest.mark.parametrize("mode", ["helped", "killed"])
def test_the_same_with_a_helper_that_works_or_dies(alone: tuple[Place, Any], tmp_path: Path, mode: str) -> None:
    _, expected = alone
    place = Place(tmp_path)
    said = place.run(mode)
    assert said["value"] == expected["value"]
    assert said["helpers"] == 1
    assert place.products("unit") == ["bottom", "upper"]
    assert (said["compiled"] == ["bottom", "upper"]) == (mode == "killed")


def test_what_a_helper_compiled_ahead_is_not_compiled_again(alone: tuple[Place, Any], tmp_path: Path) -> None:
    _, expected = alone
    place = Place(tmp_path)
    said = place.run("ahead")
    assert said["value"] == expected["value"]
    assert said["helpers"] == 1
    assert said["compiled"] == []
    assert place.products("unit") == ["bottom", "upper"]


@pytest.mark.parametrize("mode", ["interrupted", "left"])
def test_an_interruption_leaves_no_helper_behind(tmp_path: Path, mode: str) -> None:
    said = Place(tmp_path).run(mode)
    assert said["value"] is None
    assert said["left"] == [False]


def test_two_processes_at_once_share_the_work(alone: tuple[Place, Any], tmp_path: Path) -> None:
    _, expected = alone
    place = Place(tmp_path)
    both = [result(process) for process in [place.start("-c", RUN, "alone") for _ in range(2)]]
    assert [said["value"] for said in both] == [expected["value"]] * 2
    assert sorted(both[0]["compiled"] + both[1]["compiled"]) == ["bottom", "upper"]


def test_without_what_spares_the_counting_of_references_the_result_is_the_same(
    alone: tuple[Place, Any], tmp_path: Path
) -> None:
    _, expected = alone
    stock = "import geomphys.jit.compiler as k\nk.OPTIONS.pop('_nrt', None)\nk.INSIDE.pop('_nrt', None)\n"
    process = Place(tmp_path).start("-c", f"{stock}import json, stacked\nprint(json.dumps(stacked.top(0.5).hex()))")
    assert result(process) == expected["value"]


def test_a_cache_that_cannot_be_written_costs_only_time(tmp_path: Path) -> None:
    place = Place(tmp_path)
    full = "import geomphys.storage.cache as cache\ncache.Store.save = lambda *_: None\n"
    process = place.start("-c", f"{full}import stacked\nprint(stacked.top(0.5))")
    assert result(process) == pytest.approx(EXPECTED, rel=1e-15)
    assert place.products("unit") == []
