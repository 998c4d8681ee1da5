"""At the frame's end a body that is deep in something is moved out of it, else back to where it was when the frame began."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box
from geomphys.simulated.update import STEP, enable_pairs, project_or_put_back
from tests.simulated.scenes import Player, Thing
from tests.simulated.stages import Stage

CUBE = Box((0.05, 0.05, 0.05))
GAP, DEEP, END = 2e-6, 5e-4, 0.5


def moved_to_the_end(*walls: float) -> Stage:
    """A cube that moves from x = 0 to `END` in a step, and cubes that stand at x of `walls`."""
    cubes = [Thing(shape=CUBE, role=s.FIXED, at=(x, 0, 0)) for x in walls]
    stage = Stage(Player([Thing(shape=CUBE, v=(END / STEP, 0, 0)), *cubes], gravity=(0, 0, 0), gap=GAP))
    stage.motion["position"][0] = END, 0, 0
    stage.motion["travelled"][0] += END
    return stage


def test_where_there_is_space_it_is_moved_out_and_keeps_its_velocity() -> None:
    stage = moved_to_the_end(END + 0.1 - DEEP)
    stage.call(project_or_put_back)
    assert stage.motion["position"][0, 0] == pytest.approx(END - DEEP, abs=GAP)
    assert stage.motion["velocity"][0, 0] == END / STEP


def test_between_two_it_goes_back_to_where_it_was_at_rest() -> None:
    stage = moved_to_the_end(END - 0.1 + DEEP, END + 0.1 - DEEP)
    stage.call(project_or_put_back)
    assert np.array_equal(stage.motion["position"][0], (0, 0, 0))
    assert np.array_equal(stage.motion["velocity"][0], (0, 0, 0))


def test_it_stays_where_that_would_be_deeper_in_something() -> None:
    stage = moved_to_the_end(-0.1 + 4 * DEEP, END - 0.1 + DEEP, END + 0.1 - DEEP)
    stage.call(project_or_put_back)
    assert stage.motion["position"][0, 0] == pytest.approx(END, abs=DEEP)


def test_disabled_pairs_are_enabled_again() -> None:
    stage = moved_to_the_end(END + 0.1 - DEEP)
    assert not stage.call(enable_pairs)
    stage.pairs["disabled"] = 1
    assert stage.call(enable_pairs)
    assert not stage.pairs["disabled"].any()
