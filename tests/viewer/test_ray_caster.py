"""Pictures cast by rays against closed forms: silhouettes, shadows, what lies in front, and marks behind."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from geomphys.viewer.ray_caster import BACKGROUND, Camera, Surface, render

RED, GREEN, BLUE, GREY = (
    np.array(c, float) for c in ((0.9, 0.1, 0.1), (0.1, 0.8, 0.1), (0.1, 0.1, 0.9), (0.8, 0.8, 0.8))
)
FAR = np.array([1000.0, -500.0, 200.0])


def surface(mesh: trimesh.Trimesh, colour: NDArray[np.float64], at: NDArray[np.float64]) -> Surface:
    corners = np.array(mesh.vertices)[mesh.faces] + at
    return Surface(corners, np.array(mesh.vertex_normals)[mesh.faces], colour)


def ball(radius: float, colour: NDArray[np.float64], at: NDArray[np.float64]) -> Surface:
    return surface(trimesh.creation.icosphere(4, radius), colour, at)


def hue(pixels: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Index of the strongest channel where one stands out, else -1."""
    values = pixels.astype(int)
    return np.where(np.ptp(values, axis=2) > 40, values.argmax(axis=2), -1)


@pytest.mark.parametrize("origin", [np.zeros(3), FAR])
def test_a_ball_covers_the_disc_that_perspective_gives(origin: NDArray[np.float64]) -> None:
    radius, distance, height = 0.1, 1.0, 300
    camera = Camera(origin - np.array([0.0, distance, 0.0]), origin, 400, height)
    pixels = render(camera, [ball(radius, RED, origin)], [], [])
    covered = (hue(pixels) == 0).sum()
    tangent = radius / np.sqrt(distance**2 - radius**2)  # of half the angle it is seen at
    disc = np.pi * (tangent / np.tan(np.radians(20.0)) * height / 2) ** 2
    assert covered == pytest.approx(disc, rel=0.02)
    rows, columns = np.nonzero(hue(pixels) == 0)
    assert rows.mean() + 0.5 == pytest.approx(height / 2, abs=0.5)
    assert columns.mean() + 0.5 == pytest.approx(200, abs=0.5)


def test_where_nothing_is_there_is_background() -> None:
    pixels = render(Camera(np.array([0.0, -1.0, 0.0]), np.zeros(3), 40, 30), [], [], [])
    assert (pixels == np.rint(255 * BACKGROUND)).all()


def test_up_is_up_and_right_is_right() -> None:
    camera = Camera(np.array([0.0, -1.0, 0.0]), np.zeros(3), 200, 200)
    pixels = hue(
        render(camera, [ball(0.05, RED, np.array([0.2, 0, 0])), ball(0.05, BLUE, np.array([0, 0, 0.2]))], [], [])
    )
    assert np.nonzero(pixels == 0)[1].min() > 110
    assert np.nonzero(pixels == 2)[0].max() < 90


def test_the_nearer_of_two_is_seen() -> None:
    camera = Camera(np.array([0.0, -1.0, 0.0]), np.zeros(3), 100, 100)
    near, behind = ball(0.1, GREEN, np.array([0.0, -0.3, 0.0])), ball(0.2, RED, np.array([0.0, 0.3, 0.0]))
    assert hue(render(camera, [near, behind], [], []))[50, 50] == 1
    assert np.array_equal(render(camera, [near, behind], [], []), render(camera, [behind, near], [], []))


def test_a_shadow_falls_away_from_the_lamp() -> None:
    """The lamp's direction is (0.35, -0.5, 0.9): the shadow of a ball at height h is at -h (0.35, -0.5)/0.9."""
    floor = surface(trimesh.creation.box((4, 4, 0.1)), GREY, np.array([0, 0, -0.05]))
    height = 0.6
    camera = Camera(np.array([0.0, -0.001, 3.0]), np.zeros(3), 301, 301)
    alone = render(camera, [floor], [], []).astype(int)
    pixels = render(camera, [floor, ball(0.1, RED, np.array([0.0, 0.0, height]))], [], []).astype(int)
    shadow = (np.abs(pixels - alone).max(axis=2) > 20) & (hue(pixels.astype(np.uint8)) == -1)
    rows, columns = np.nonzero(shadow)
    metres = camera.pixel_size()
    assert (columns.mean() - 150) * metres == pytest.approx(-height * 0.35 / 0.9, abs=0.03)
    assert (150 - rows.mean()) * metres == pytest.approx(height * 0.5 / 0.9, abs=0.03)


def test_what_is_translucent_lets_through_and_marks_do_not() -> None:
    camera = Camera(np.array([0.0, -1.0, 0.0]), np.zeros(3), 60, 60)
    solid = ball(0.2, GREY, np.zeros(3))
    front, inside = ball(0.05, BLUE, np.array([0.0, -0.4, 0.0])), ball(0.05, BLUE, np.zeros(3))
    plain = render(camera, [solid], [], [])[30, 30].astype(int)
    mixed, hidden = (render(camera, [solid], [b], [])[30, 30].astype(int) for b in (front, inside))
    assert 0 < np.ptp(hidden) < np.ptp(mixed) < np.ptp(render(camera, [solid], [], [front])[30, 30].astype(int))
    assert plain[0] > mixed[0]


def test_edges_are_smooth() -> None:
    camera = Camera(np.array([0.0, -1.0, 0.0]), np.zeros(3), 120, 120)
    pixels = render(camera, [ball(0.2, BLUE, np.zeros(3))], [], []).astype(int)
    across = pixels[60, :60, 0]  # red falls from the background's to the ball's
    between = (across > across.min() + 30) & (across < 244 - 30)
    rim = [pixels[row, :60, 0] for row in range(40, 80)]
    assert between.any() or any(((r > r.min() + 30) & (r < 214)).any() for r in rim)
