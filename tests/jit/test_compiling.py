"""Kernels are compiled once, by whoever is there to do it, and give the same whoever did."""

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
from geomphys.jit.kernel import inlined, kernel, outlined

class Pair(NamedTuple):
    first: float
    second: int

@inlined
def tiny(x: float) -> float:
    return x * 0.1

@outlined
def bottom(x: float, k: int) -> Pair:
    return Pair(math.sin(x) + tiny(x), k)

@kernel
def middle(x: float) -> float:
    return bottom(x, 1).first + bottom(x, 2).second

@outlined
def upper(x: float) -> tuple[float, bool]:
    return 2.0 * middle(x), x > 0.0

@kernel
def top(x: float) -> float:
    value, positive = upper(x)
    return value + middle(x) if positive else -1.0

@kernel
def wrong(x: float) -> int:
    return 2.0 * x
"""

ALL = {"tiny", "bottom", "middle", "upper", "top"}

RUN = """
import json, sys
import geomphys.jit.compiling.crew as crew
import geomphys.jit.compiling.sketches as sketches

mode = sys.argv[1]
made, told, helpers = [], [], []
sketch = sketches.sketch

def counted(key, *rest):
    made.append(key.name)
    return sketch(key, *rest)

sketches.sketch = counted
crew.WORTHWHILE = 99 if mode == "alone" else 0
crew.processes = lambda: 1 if mode == "alone" else 2

class Helper(crew.Helper):
    def __init__(self):
        if mode == "no helper":
            sys.executable = "/there/is/no/python"
        super().__init__()
        helpers.append(self._process)
        if mode == "waiting":
            self.is_ready()

    def do(self, job):
        if mode == "killed":
            self._process.kill()
        return super().do(job)

crew.Helper = Helper

def tell(done, known):
    told.append((done, known))
    if mode == "interrupted" and helpers:
        raise KeyboardInterrupt

import stacked
value = left = None
try:
    with crew.telling(tell):
        value = stacked.top(0.5).hex()
except KeyboardInterrupt:
    left = [process.poll() is None for process in helpers]
json.dump(
    {"value": value, "made": sorted(made), "told": told, "helpers": len([h for h in helpers if h]), "left": left},
    sys.stdout,
)
"""

EXPECTED = 3.0 * (math.sin(0.5) + 0.5 * 0.1 + 2.0)


class Place:
    """A folder with the kernels, and the cache they are compiled into."""

    def __init__(self, folder: Path, cache: Path) -> None:
        folder.mkdir(exist_ok=True)
        (folder / "stacked.py").write_text(KERNELS)
        self.folder = folder
        path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
        self.environment = os.environ | {"PYTHONPATH": path, "XDG_CACHE_HOME": str(cache)}

    def start(self, *command: str) -> subprocess.Popen[str]:
        pipe = subprocess.PIPE
        return subprocess.Popen(
            [sys.executable, *command], env=self.environment, stdout=pipe, stderr=pipe, text=True, cwd=self.folder
        )

    def run(self, mode: str) -> Any:
        return result(self.start("-c", RUN, mode))


def result(process: subprocess.Popen[str]) -> Any:
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    return json.loads(out)


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> tuple[Place, Any]:
    """Kernels compiled by one process, and what it said."""
    folder = tmp_path_factory.mktemp("alone")
    place = Place(folder, folder / "cache")
    return place, place.run("alone")


def products(place: Place, kind: str) -> list[str]:
    """Names of the kernels there are products of, sorted."""
    cache = Path(place.environment["XDG_CACHE_HOME"])
    return sorted(path.name.split(".")[1] for path in cache.rglob(f"stacked.*.{kind}"))


def test_each_kernel_is_sketched_once(alone: tuple[Place, Any]) -> None:
    place, said = alone
    assert float.fromhex(said["value"]) == pytest.approx(EXPECTED, rel=1e-15)
    assert said["made"] == products(place, "part") == sorted(ALL)


def test_outlined_kernels_are_units_and_what_python_calls_is_an_entry(alone: tuple[Place, Any]) -> None:
    place, _ = alone
    assert products(place, "unit") == ["bottom", "upper"]
    assert products(place, "entry") == ["top"]


def test_progress_grows_to_its_end(alone: tuple[Place, Any]) -> None:
    _, said = alone
    done, known = zip(*said["told"], strict=True)
    assert list(done) == sorted(done)
    assert list(known) == sorted(known)
    assert done[-1] == known[-1] == len(ALL) + 2  # two units


def test_a_second_process_compiles_nothing(alone: tuple[Place, Any]) -> None:
    place, said = alone
    again = place.run("alone")
    assert again["made"] == again["told"] == []
    assert again["value"] == said["value"]


def test_the_same_sources_elsewhere_share_the_cache(alone: tuple[Place, Any], tmp_path: Path) -> None:
    place, said = alone
    elsewhere = Place(tmp_path / "copy", Path(place.environment["XDG_CACHE_HOME"]))
    again = elsewhere.run("alone")
    assert again["made"] == []
    assert again["value"] == said["value"]


def test_a_changed_kernel_is_compiled_anew(alone: tuple[Place, Any], tmp_path: Path) -> None:
    place, _ = alone
    changed = Place(tmp_path / "changed", Path(place.environment["XDG_CACHE_HOME"]))
    source = tmp_path / "changed" / "stacked.py"
    source.write_text(source.read_text().replace("x * 0.1", "x * 0.3"))
    value = float.fromhex(changed.run("alone")["value"])
    assert value == pytest.approx(3.0 * (math.sin(0.5) + 0.5 * 0.3 + 2.0), rel=1e-15)


@pytest.mark.parametrize(
    ("mode", "shared"), [("waiting", True), ("killed", False), ("no helper", False)], ids=["helper", "killed", "none"]
)
def test_the_same_with_a_helper_that_works_dies_or_never_comes(
    alone: tuple[Place, Any], tmp_path: Path, mode: str, shared: bool
) -> None:
    _, expected = alone
    place = Place(tmp_path, tmp_path / "cache")
    said = place.run(mode)
    assert said["value"] == expected["value"]
    assert said["helpers"] == (mode != "no helper")
    assert products(place, "part") == sorted(ALL)
    assert products(place, "unit") == ["bottom", "upper"]
    if shared:
        assert said["made"] != sorted(ALL)  # some were left to the helper
    else:
        assert said["made"] == sorted(ALL)


def test_an_interruption_leaves_no_helper_behind(tmp_path: Path) -> None:
    said = Place(tmp_path, tmp_path / "cache").run("interrupted")
    assert said["value"] is None
    assert said["left"] == [False]


def test_of_two_processes_at_once_one_compiles(alone: tuple[Place, Any], tmp_path: Path) -> None:
    _, expected = alone
    place = Place(tmp_path, tmp_path / "cache")
    both = [result(process) for process in [place.start("-c", RUN, "alone") for _ in range(2)]]
    assert [said["value"] for said in both] == [expected["value"]] * 2
    assert sorted(both[0]["made"] + both[1]["made"]) == sorted(ALL)


def test_a_script_without_a_guard_has_kernels_of_its_own(tmp_path: Path) -> None:
    place = Place(tmp_path, tmp_path / "cache")
    calls = "import geomphys.jit.compiling.crew as crew\ncrew.WORTHWHILE = 0\ncrew.processes = lambda: 2\n"
    (tmp_path / "script.py").write_text(f"{KERNELS}\n{calls}\nprint(top(0.5))\n")
    assert result(place.start("script.py")) == pytest.approx(EXPECTED, rel=1e-15)


def test_a_cache_that_cannot_be_written_costs_only_time(tmp_path: Path) -> None:
    place = Place(tmp_path, tmp_path / "cache")
    full = "import geomphys.storage.cache as cache\ncache.Store.save = lambda *_: None\n"
    process = place.start("-c", f"{full}import stacked\nprint(stacked.top(0.5))")
    assert result(process) == pytest.approx(EXPECTED, rel=1e-15)
    assert products(place, "part") == []


def test_what_a_kernel_returns_is_what_it_is_annotated_to(alone: tuple[Place, Any]) -> None:
    place, _ = alone
    process = place.start("-c", "import stacked\nstacked.wrong(0.5)")
    _, err = process.communicate(timeout=120)
    assert process.returncode != 0
    assert "stacked.wrong: annotated to return int64, but returns float64" in err
