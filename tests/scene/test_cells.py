"""Cells of directions: the kernel finds the cell that the table was made for, at its middle and all over it."""

from __future__ import annotations

import numpy as np

from geomphys.scene.direction_cells import CELLS, CELLS_PER_EDGE, cell_centres, cell_of, farthest_in_cells


def test_the_middle_of_a_cell_lies_in_it() -> None:
    centres = cell_centres()
    assert [cell_of((float(x), float(y), float(z))) for x, y, z in centres] == list(range(CELLS))
    assert [cell_of((float(x), float(y), float(z))) for x, y, z in 1e-9 * centres] == list(range(CELLS))


def test_every_direction_has_the_cell_of_the_nearest_middle_on_its_side() -> None:
    rng = np.random.default_rng(5)
    directions = np.vstack([rng.normal(size=(500, 3)), np.eye(3), -np.eye(3), np.ones((1, 3)), -np.ones((1, 3))])
    centres = cell_centres()
    for x, y, z in directions:
        k = cell_of((float(x), float(y), float(z)))
        on_cube = np.array([x, y, z]) / max(abs(x), abs(y), abs(z))
        assert np.abs(on_cube - centres[k]).max() <= 1.0 / CELLS_PER_EDGE + 1e-12


def test_a_cell_names_the_corner_that_lies_farthest_in_its_middle() -> None:
    corners = np.random.default_rng(6).normal(size=(60, 3))
    reach = corners @ cell_centres().T
    assert np.array_equal(reach.max(axis=0), reach[farthest_in_cells(corners), np.arange(CELLS)])
