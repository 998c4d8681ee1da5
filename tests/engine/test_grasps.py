"""What is said of grasps: held, lifted, dropped, set down, or touched and not held."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.engine.grasps import GraspMeter
from geomphys.results import Grasp
from tests.laws.test_grasp import Task, grasp
from tests.laws.test_pressed import HAND, frictions, play, ramp, thing


def said(run: object) -> tuple[Grasp, list[str]]:
    """The grasp of a run's one simulated object, and what its log says of it."""
    meter = GraspMeter(run.world)  # type: ignore[attr-defined]
    texts = []
    for result in run.results:  # type: ignore[attr-defined]
        texts += [text for _, text in meter.add(result)]
        assert set(texts) >= {text for _, text in result.messages if text.startswith("thing")}
    (found,) = meter.grasps()
    return found, texts


def test_what_is_lifted_and_let_go_in_the_air_was_held_lifted_and_dropped(tmp_path: Path) -> None:
    found, texts = said(grasp(tmp_path, Task(opens=3.0), 4.0).run)
    assert found.outcome == "dropped"
    assert found.dropped == 1
    assert found.lifted_m == pytest.approx(0.2, abs=2e-3)
    assert found.held_s == pytest.approx(1.7, abs=0.3)
    assert found.grip_force_n == pytest.approx(10.0, rel=0.01)
    assert texts == ["thing: held with 10 N", "thing: dropped"]


def test_the_margin_is_friction_available_over_needed(tmp_path: Path) -> None:
    """2 μ K x over m g at rest; the acceleration of lifting needs a little more."""
    found, _ = said(grasp(tmp_path, Task(), 3.0).run)
    at_rest = 2 * 0.8 * 5.0 / (0.2 * 9.81)
    assert 0.85 * at_rest < found.margin < at_rest
    assert found.outcome == "lifted"


def test_what_is_only_pushed_is_touched_and_not_held(tmp_path: Path) -> None:
    things = [
        thing("thing", box=(0.05, 0.05, 0.05), position=(0, 0, 0.025), mass=0.2),
        thing("floor", "fixed", box=(4, 4, 0.2), position=(0, 0, -0.1), material="metal"),
        thing("hand", "driven", box=(0.02, 0.04, 0.04), topic="/hand", **HAND),
    ]
    way = lambda t: (-0.06 + ramp(t, 0.2, 1.5, 0.1), 0, 0.03, 0, 0, 0, 1)  # noqa: E731
    found, texts = said(play(tmp_path, things, 2.0, pairs=frictions(0.5), paths={"/hand": way}))
    assert found.outcome == "touched"
    assert found.held_s == 0.0
    assert np.isfinite(found.grip_force_n)
    assert texts == []
