"""The time of a replay in its summary is without the compiling, which another process may begin while the scene is loaded."""

from __future__ import annotations

import time
from typing import Any

import pytest

import geomphys
from geomphys import replays
from geomphys.engine.pipeline import Pipeline
from tests.house.sources import ROOT

COMPILING_S = 3.0


def test_compiling_that_begins_while_the_scene_is_loaded_is_not_in_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    loaded: list[bool] = []
    load, step = replays.load_world, Pipeline.run

    def load_and_begin_to_compile(*args: Any, **kwargs: Any) -> Any:
        loaded.append(True)
        return load(*args, **kwargs)

    def compile_and_step(*args: Any) -> int:
        if len(loaded) == 1:
            time.sleep(COMPILING_S)
            loaded.append(True)
        return step(*args)

    monkeypatch.setattr(replays, "are_compiled", lambda method: bool(loaded))
    monkeypatch.setattr(replays, "load_world", load_and_begin_to_compile)
    monkeypatch.setattr(Pipeline, "run", compile_and_step)
    summary = geomphys.run(
        ROOT / "recordings/finger_snip.mcap",
        ROOT / "assets/scenes/finger_snip.toml",
        config=geomphys.Config(end=0.2),
    )
    assert len(loaded) == 2
    assert summary.elapsed_s < COMPILING_S
