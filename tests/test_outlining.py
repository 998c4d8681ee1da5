"""Outlined kernels: compiled once, jumped to, and loaded before the kernels that jump to them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

KERNELS = """
import math
from geomphys.kernel import kernel, outlined

@outlined
def bottom(x, k):
    return math.sin(x) + k

@kernel
def middle(x):
    return bottom(x, 1) + bottom(x, 2)

@outlined
def upper(x):
    return 2.0 * middle(x)

@kernel
def top(x):
    return upper(x) + middle(x)
"""

RUN = """
import json, sys
import stacked
value = stacked.top(0.5)
hits = sum(sum(k.stats.cache_hits.values()) for k in (stacked.bottom, stacked.upper, stacked.top))
text = "".join(stacked.top.inspect_llvm().values()) if not hits else ""
json.dump({"value": value, "hits": hits, "jumps": "stacked.upper" in text, "copies": "llvm.sin" in text}, sys.stdout)
"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, float]]:
    """What two processes say that share a cache, the first of which finds it empty."""
    folder: Path = tmp_path_factory.mktemp("stack")
    (folder / "stacked.py").write_text(KERNELS)
    path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = os.environ | {"PYTHONPATH": path, "XDG_CACHE_HOME": str(folder / "cache")}
    found = []
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", RUN], env=environment, capture_output=True, text=True, check=True)
        found.append(json.loads(done.stdout))
    return found


def test_results_are_those_of_python(runs: list[dict[str, float]]) -> None:
    import math

    middle = 2.0 * math.sin(0.5) + 3.0
    assert [run["value"] for run in runs] == [3.0 * middle] * 2


def test_callers_jump_and_take_no_copy(runs: list[dict[str, float]]) -> None:
    assert runs[0]["jumps"]
    assert not runs[0]["copies"]


def test_a_second_process_loads_all_of_them(runs: list[dict[str, float]]) -> None:
    assert runs[0]["hits"] == 0
    assert runs[1]["hits"] == 3
