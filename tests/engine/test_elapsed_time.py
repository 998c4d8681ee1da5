"""The time of a replay in its summary is without the compiling, which another process may begin while the scene is loaded."""

from __future__ import annotations

from typing import Any

import pytest

import geomphys
from geomphys import replays
from geomphys.engine.pipeline import Pipeline
from tests.house.sources import ROOT

COMPILING_S, STEPPING_S = 100.0, 1.0


def test_compiling_that_begins_while_the_scene_is_loaded_is_not_in_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    load, step = replays.load_world, Pipeline.run
    state = {"begun": False, "compiled": False, "clock": 0.0}

    def load_and_begin_to_compile(*args: Any, **kwargs: Any) -> Any:
        state["begun"] = True
        return load(*args, **kwargs)

    def compile_and_step(*args: Any) -> int:
        state["clock"] += STEPPING_S if state["compiled"] else COMPILING_S
        state["compiled"] = True
        return step(*args)

    monkeypatch.setattr(replays, "are_compiled", lambda method: state["begun"])
    monkeypatch.setattr(replays, "load_world", load_and_begin_to_compile)
    monkeypatch.setattr(replays.time, "perf_counter", lambda: state["clock"])
    monkeypatch.setattr(Pipeline, "run", compile_and_step)
    summary = geomphys.run(
        ROOT / "recordings/finger_snip.mcap",
        ROOT / "assets/scenes/finger_snip.toml",
        config=geomphys.Config(end=6.0),
    )
    assert 0.0 < summary.elapsed_s < COMPILING_S
