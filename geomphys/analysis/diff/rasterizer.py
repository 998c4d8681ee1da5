"""A software rasterizer for triangles: depth buffer, flat shading, PNG output."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Colour = tuple[float, float, float]

_LIGHT = np.array([0.35, -0.5, 0.8]) / np.linalg.norm([0.35, -0.5, 0.8])
_AMBIENT = 0.45
_BACKGROUND: Colour = (0.965, 0.965, 0.972)


class Surface(NamedTuple):
    """Triangles (n, 3, 3) in the world, m, and their colour, 0 to 1."""

    triangles: Floats
    colour: Colour


@dataclass(frozen=True)
class View:
    """An orthographic projection of a region of `radius` [m] about `target`, from `direction` (towards the eye)."""

    target: Floats
    direction: Floats
    radius: float
    width: int = 480
    height: int = 360
    near: float = np.inf
    """m; near plane: distance from `target` towards the eye beyond which geometry is clipped."""

    def axes(self) -> Floats:
        """Rows: right, up, towards the eye."""
        towards = self.direction / np.linalg.norm(self.direction)
        right = np.cross([0.0, 0.0, 1.0], towards)
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(towards, right), towards])


def render(view: View, solid: list[Surface], translucent: list[Surface], opacity: float = 0.55) -> NDArray[np.uint8]:
    """Pixels (height, width, 3); `translucent` surfaces are blended over solid ones behind them."""
    colours, depths = _buffer(view)
    for surface in solid:
        _rasterise(view, surface, colours, depths)
    over, over_depths = _buffer(view)
    for surface in translucent:
        _rasterise(view, surface, over, over_depths)
    shown = (over_depths >= depths - 1e-9) & np.isfinite(over_depths)
    colours[shown] = (1.0 - opacity) * colours[shown] + opacity * over[shown]
    pixels: NDArray[np.uint8] = np.rint(255.0 * np.clip(colours, 0.0, 1.0)).astype(np.uint8)
    return pixels


def png(pixels: NDArray[np.uint8]) -> bytes:
    """The PNG file of pixels (h, w, 3)."""
    height, width, _ = pixels.shape
    rows = np.zeros((height, 1 + 3 * width), np.uint8)
    rows[:, 1:] = pixels.reshape(height, -1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 9)), (b"IEND", b""))
    parts = [struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def _buffer(view: View) -> tuple[Floats, Floats]:
    shape = (view.height, view.width)
    return np.broadcast_to(_BACKGROUND, (*shape, 3)).copy(), np.full(shape, -np.inf)


def _rasterise(view: View, surface: Surface, colours: Floats, depths: Floats) -> None:
    """Draw triangles that face the eye; of two in one pixel the nearer one stays."""
    axes = view.axes()
    a, b, c = (surface.triangles[:, k] for k in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    facing = (lengths > 0) & (normals @ axes[2] > 0)
    units = normals[facing] / lengths[facing, None]
    shades = _AMBIENT + (1.0 - _AMBIENT) * np.clip(units @ _LIGHT, 0.0, 1.0)
    scale = 0.5 * min(view.width, view.height) / view.radius
    corners = (surface.triangles[facing] - view.target) @ axes.T
    x = 0.5 * view.width + scale * corners[:, :, 0]
    y = 0.5 * view.height - scale * corners[:, :, 1]
    z = corners[:, :, 2]
    inside = (x.max(1) >= 0) & (x.min(1) < view.width) & (y.max(1) >= 0) & (y.min(1) < view.height)
    for k in np.flatnonzero(inside):
        _fill(x[k], y[k], z[k], shades[k] * np.array(surface.colour), colours, depths, view.near)


def _fill(x: Floats, y: Floats, z: Floats, colour: Floats, colours: Floats, depths: Floats, near: float) -> None:
    """Fill the pixels whose centres lie in a triangle, by barycentric coordinates."""
    height, width = depths.shape
    left, right = max(int(x.min()), 0), min(int(x.max()) + 2, width)
    top, bottom = max(int(y.min()), 0), min(int(y.max()) + 2, height)
    area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
    if area == 0.0 or left >= right or top >= bottom:
        return
    px = np.arange(left, right) + 0.5
    py = (np.arange(top, bottom) + 0.5)[:, None]
    v = ((px - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (py - y[0])) / area
    w = ((x[1] - x[0]) * (py - y[0]) - (px - x[0]) * (y[1] - y[0])) / area
    depth = z[0] + v * (z[1] - z[0]) + w * (z[2] - z[0])
    region = (slice(top, bottom), slice(left, right))
    nearer = (v >= 0) & (w >= 0) & (v + w <= 1) & (depth > depths[region]) & (depth <= near)
    depths[region][nearer] = depth[nearer]
    colours[region][nearer] = colour
