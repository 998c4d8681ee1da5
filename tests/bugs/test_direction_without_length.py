"""A direction without length, or of no number, was looked up far outside the table of cells: memory of others was read."""

from __future__ import annotations

import math

import pytest

from geomphys.scene.direction_cells import CELLS, cell_of


@pytest.mark.parametrize("x", [0.0, math.nan, math.inf])
@pytest.mark.parametrize("y", [0.0, math.nan, -1.0])
@pytest.mark.parametrize("z", [0.0, math.nan, 1.0])
def test_every_direction_has_a_cell(x: float, y: float, z: float) -> None:
    assert 0 <= cell_of((x, y, z)) < CELLS
