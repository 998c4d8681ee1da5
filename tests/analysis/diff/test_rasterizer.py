"""Pictures without a graphics driver: what is nearer hides, glass shows through, and the PNG holds the pixels."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from geomphys.analysis.diff.rasterizer import Surface, View, png, render

RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def square(z: float, half: float = 0.5) -> np.ndarray:
    """Two triangles at a height, facing up."""
    corners = np.array([[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]])
    return corners[[[0, 1, 2], [0, 2, 3]]]


@pytest.fixture
def view() -> View:
    """Almost straight from above, one metre to either side."""
    return View(np.zeros(3), np.array([0.0, -1e-6, 1.0]), 1.0, width=80, height=80)


def middle(pixels: np.ndarray) -> np.ndarray:
    """The colour in the middle, 0 to 1."""
    return pixels[40, 40] / 255.0


def test_a_square_covers_its_share(view: View) -> None:
    pixels = render(view, [Surface(square(0.0), RED)], [])
    covered = (pixels[..., 1] == 0).mean()
    assert covered == pytest.approx(0.25, abs=0.02)
    assert middle(pixels)[0] > 0.4
    assert middle(pixels)[1:].tolist() == [0.0, 0.0]


def test_the_nearer_one_hides(view: View) -> None:
    both = [Surface(square(0.1), BLUE), Surface(square(0.2), RED)]
    for order in (both, both[::-1]):
        assert middle(render(view, order, [])).argmax() == 0


def test_what_faces_away_is_not_drawn(view: View) -> None:
    assert (render(view, [Surface(square(0.0)[:, ::-1], RED)], []) == render(view, [], [])).all()


def test_what_is_behind_the_eye_is_not_drawn(view: View) -> None:
    near = View(view.target, view.direction, view.radius, view.width, view.height, near=0.15)
    assert middle(render(near, [Surface(square(0.1), BLUE), Surface(square(0.2), RED)], [])).argmax() == 2


@pytest.mark.parametrize(("glass_at", "seen"), [(0.2, True), (-0.2, False)])
def test_glass_is_laid_over_what_is_behind_it(view: View, glass_at: float, seen: bool) -> None:
    solid, translucent = [Surface(square(0.0), BLUE)], [Surface(square(glass_at), RED)]
    colour = middle(render(view, solid, translucent))
    assert (colour[0] > 0.1) == seen
    assert colour[2] > 0.1


def test_the_png_holds_the_pixels() -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (7, 5, 3), dtype=np.uint8)
    assert (np.asarray(Image.open(io.BytesIO(png(pixels)))) == pixels).all()
