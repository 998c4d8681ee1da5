"""The narrow phase for use alone."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.collision.query import query
from geomphys.errors import MeshError
from geomphys.scene.pieces import Box, Hull
from tests.collision.pairs import pose


def test_a_box_sunk_into_a_box() -> None:
    found = query(Box((1.0, 1.0, 1.0)), pose((0.5, 0.0, 1.9)), Box((1.0, 1.0, 1.0)), pose())
    assert found.separation == pytest.approx(-0.1)
    assert np.allclose(found.normal, (0, 0, 1))
    assert np.allclose(found.point_a - found.point_b, found.separation * found.normal)
    assert found.contacts_a.shape == found.contacts_b.shape == (4, 3)
    assert sorted(found.contacts_a[:, 0]) == pytest.approx([-0.5, -0.5, 1.0, 1.0])


def test_a_flat_hull_is_refused() -> None:
    with pytest.raises(MeshError, match="flat"):
        query(Hull(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])), pose(), Box((1.0, 1.0, 1.0)), pose())
