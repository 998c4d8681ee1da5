"""The eye from which a recording is first seen."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from geomphys.output import camera
from geomphys.output.camera import ContactFrame, choose_viewpoint

POINTS = 0.1 * np.random.default_rng(1).normal(size=(200, 3))


def wall(azimuth: float) -> camera.Floats:
    """Triangles (2, 3, 3) of a wall beside the points, in this direction of them [rad]."""
    across, up = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0]), np.array([0.0, 0.0, 1.0])
    middle = 0.4 * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    corners = [middle + 9.0 * (x * across + z * up) for x, z in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return np.array([[corners[k] for k in triangle] for triangle in ((0, 1, 2), (0, 2, 3))])


@pytest.mark.parametrize("azimuth", np.linspace(0.0, 5.0, 7))
def test_no_wall_is_between_the_eye_and_the_points(azimuth: float) -> None:
    eye = choose_viewpoint(POINTS, wall(azimuth)).position
    assert camera._visible_fraction(eye, POINTS, wall(azimuth)) == 1.0


def test_nor_between_the_eye_and_contacts() -> None:
    contacts, hidden = ContactFrame(POINTS[:4], wall(0.0)), choose_viewpoint(POINTS, wall(0.0)[:0]).position
    assert camera._visible_fraction(hidden, POINTS, wall(0.0)) < 1.0
    eye = choose_viewpoint(POINTS, wall(0.0)[:0], [contacts]).position
    assert camera._visible_fraction(eye, POINTS[:4], wall(0.0)) == 1.0


def test_only_eyes_that_may_be_better_are_looked_from(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a hundred; with many triangles that took seconds."""
    found, looks = camera._visible_fraction, []

    def counted(eye: camera.Floats, *of: Any) -> float:
        looks.append(tuple(eye))
        return found(eye, *of)

    monkeypatch.setattr(camera, "_visible_fraction", counted)
    choose_viewpoint(POINTS, wall(4.0) * 5.0, [ContactFrame(POINTS[:4], wall(4.0) * 5.0)])
    assert len(set(looks)) == 1
