"""A mug: hollow, open at the top, with a handle, in one closed surface of genus one."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
from files import write_obj
from solids import Solid

RADIUS, HEIGHT, WALL, BOTTOM = 0.040, 0.095, 0.005, 0.006
SIDES = 24
ROWS = (0.0, 0.012, 0.024, 0.040, 0.055, 0.071, 0.083, HEIGHT)  # heights of the rings of the outer wall
LOWER, UPPER = 1, 5  # rows of the wall where the handle begins and ends
REACH = 0.034  # how far the handle stands out
STEPS = 9


def make(folder: Path) -> int:
    """Write ``mug.obj`` into ``folder``; returns the number of triangles."""
    return write_obj(folder / "mug.obj", mug(), "mug with a handle")


def mug() -> Solid:
    """The mug standing on z = 0, its axis along z, its handle towards +x."""
    turn = 2 * np.pi * (np.arange(SIDES) - 0.5) / SIDES  # the first wall panel faces +x
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)

    def ring(radius: float, height: float) -> np.ndarray:
        return np.c_[radius * circle, np.full(SIDES, height)]

    inside = RADIUS - WALL
    profile = [ring(RADIUS, z) for z in ROWS] + [ring(inside, z) for z in (HEIGHT, 0.5 * HEIGHT, BOTTOM)]
    vertices = [np.array([[0.0, 0.0, 0.0]]), *profile, np.array([[0.0, 0.0, BOTTOM]])]
    last = 1 + SIDES * len(profile)
    quads, triangles = [], []
    for j in range(SIDES):
        n = (j + 1) % SIDES
        triangles += [(0, 1 + n, 1 + j), (last - SIDES + j, last - SIDES + n, last)]
        for i in range(len(profile) - 1):
            if j == 0 and i in (LOWER, UPPER):
                continue
            a = 1 + i * SIDES
            quads.append((a + j, a + n, a + n + SIDES, a + j + SIDES))
    vertices.append(_handle())
    quads += _handle_quads(last + 1)
    for a, b, c, d in quads:
        triangles += [(a, b, c), (a, c, d)]
    return Solid(np.vstack(vertices), np.array(triangles))


def _handle() -> np.ndarray:
    """Corners of the handle between its two ends on the wall: ``STEPS`` sections of four points.

    The four run like the corners of a panel of the wall, the handle's outer edge first.
    """
    low, high = (ROWS[LOWER] + ROWS[LOWER + 1]) / 2, (ROWS[UPPER] + ROWS[UPPER + 1]) / 2
    middle, half = (low + high) / 2, (high - low) / 2
    wall = RADIUS * np.cos(np.pi / SIDES)
    width, thick = 0.0065, 0.0045
    sections = []
    for k in range(1, STEPS + 1):
        angle = -np.pi / 2 + np.pi * k / (STEPS + 1)
        out, up = np.cos(angle), np.sin(angle)
        x, z = wall + 0.004 + REACH * np.abs(out) ** 0.7, middle + half * np.sign(up) * np.abs(up) ** 0.8
        normal = np.array([out / REACH, up / half])
        normal /= np.linalg.norm(normal)
        for side, lift in ((-1, 1), (1, 1), (1, -1), (-1, -1)):
            sections.append([x + lift * thick * normal[0], side * width, z + lift * thick * normal[1]])
    return np.array(sections)


def _handle_quads(first: int) -> list[tuple[int, int, int, int]]:
    """Sides of the handle, from the hole in the lower row of the wall to the one in the upper row."""

    def panel(row: int, flipped: bool) -> tuple[int, ...]:
        a = 1 + row * SIDES
        low, high = (a, a + 1), (a + SIDES, a + 1 + SIDES)
        return (*high, *reversed(low)) if flipped else (*low, *reversed(high))

    rings = [panel(LOWER, False)]
    rings += [tuple(first + 4 * k + c for c in range(4)) for k in range(STEPS)]
    rings.append(panel(UPPER, True))
    quads = []
    for a, b in pairwise(rings):
        for c in range(4):
            n = (c + 1) % 4
            quads.append((a[c], a[n], b[n], b[c]))
    return quads
