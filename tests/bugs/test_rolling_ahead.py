"""A ball that rolled ahead of a hand was never reached by it: the hand kept clear of where the ball had been."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import geomphys

CENTRE = 1.95  # m, x of the ball before it is pushed


@pytest.fixture(scope="module")
def pushed(root: Path) -> list[geomphys.FrameResult]:
    """The last part of the gallery, where the hand pushes the ball."""
    config = geomphys.Config(start=54.5, end=57.0)
    return list(
        geomphys.replay(root / "recordings/gallery_hand.mcap", root / "assets/scenes/gallery.toml", config=config)
    )


def test_the_hand_pushes_the_ball_instead_of_staying_behind(pushed: list[geomphys.FrameResult]) -> None:
    correction = np.array([result.metrics.correction_m for result in pushed])
    assert correction.max() < 0.03


def test_the_ball_goes_where_the_hand_goes(pushed: list[geomphys.FrameResult], root: Path) -> None:
    world = geomphys.load_world(root / "assets/scenes/gallery.toml")
    ball = world.body_names.index("ball")
    x = np.array([result.corrected[ball, 0] for result in pushed])
    assert x[0] == pytest.approx(CENTRE, abs=1e-3)
    assert x[-1] < CENTRE - 0.3
