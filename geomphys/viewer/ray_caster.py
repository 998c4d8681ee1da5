"""Renders triangles in software by casting rays (Embree): no screen, no graphics driver.

Smooth shading from vertex normals, one directional light with shadows, a sky that lights from above. Pixels on edges are
sampled several times. Translucent surfaces and marks are cast separately and blended.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

BACKGROUND = np.array([244.0, 244.0, 246.0]) / 255.0
_TO_LIGHT = np.array([0.35, -0.5, 0.9]) / np.linalg.norm([0.35, -0.5, 0.9])
_KEY, _SKY, _GROUND, _HEAD = 0.50, 0.50, 0.30, 0.14
"""Shares of the light from the lamp, from above, from below and from the eye."""
_SAMPLES = np.array([(-0.375, -0.125), (0.125, -0.375), (0.375, 0.125), (-0.125, 0.375)])
"""Positions in a pixel of the rays of a pixel on an edge, px from its centre."""
_EDGE_NORMAL, _EDGE_DEPTH = 0.9, 0.02
"""Neighbouring pixels whose normals or distances differ by more (cosine, share) lie on an edge."""
_BLOCK = 1 << 18  # rays at a time
_OFFSET = 2e-3  # of the distance: shadow rays begin this far off the surface, which is made of flat triangles
_GHOST_IN_FRONT, _GHOST_HIDDEN, _MARK_HIDDEN = 0.42, 0.15, 0.35
"""Opacity of translucent surfaces in front of the others and behind them, and of marks behind them."""
_GHOST_FADE = 5e-3  # of the distance: nearer than this to a solid surface, translucent ones fade


class Surface(NamedTuple):
    """Triangles in the world, m, with vertex normals and a colour."""

    triangles: Floats  # (n, 3, 3)
    normals: Floats  # (n, 3, 3) unit
    colour: Floats  # (3,) 0 to 1


@dataclass(frozen=True)
class Camera:
    """A perspective camera with world z up."""

    position: Floats  # (3,) m
    target: Floats  # (3,) m
    width: int
    height: int
    view_angle: float = 40.0
    """Degrees, vertical."""

    def axes(self) -> Floats:
        """Rows: right, up, towards the eye; unit."""
        towards = self.position - self.target
        towards = towards / np.linalg.norm(towards)
        up = np.array([0.0, 0.0, 1.0]) if abs(towards[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
        right = np.cross(up, towards)
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(towards, right), towards])

    def pixel_size(self) -> float:
        """Width of a pixel at the distance of the target, m."""
        distance = float(np.linalg.norm(self.position - self.target))
        return 2.0 * distance * float(np.tan(np.radians(self.view_angle) / 2)) / self.height

    def directions(self, x: Floats, y: Floats) -> Floats:
        """Directions (n, 3) of rays through points of the picture [px], from its upper left corner."""
        scale = 2.0 * np.tan(np.radians(self.view_angle) / 2) / self.height
        right, up, towards = self.axes()
        rays = ((x - self.width / 2) * scale)[:, None] * right + ((self.height / 2 - y) * scale)[:, None] * up - towards
        unit: Floats = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        return unit


def render(camera: Camera, solid: list[Surface], translucent: list[Surface], marks: list[Surface]) -> NDArray[np.uint8]:
    """Pixels (height, width, 3): `solid` surfaces, `translucent` ones blended over them, `marks` on top.

    What is translucent or a mark shows faintly also behind solid surfaces.
    """
    layers = _Layers(camera, solid, translucent, marks)
    y, x = (axis.ravel() + 0.5 for axis in np.divmod(np.arange(camera.width * camera.height), camera.width))
    colours, seen = layers.cast(x, y)
    edges = _edges(seen.reshape(camera.height, camera.width)).ravel()
    if edges.any():
        samples = [layers.cast(x[edges] + dx, y[edges] + dy)[0] for dx, dy in _SAMPLES]
        colours[edges] = np.mean(samples, axis=0)
    pixels: NDArray[np.uint8] = np.rint(255.0 * np.clip(colours, 0.0, 1.0)).astype(np.uint8)
    return pixels.reshape(camera.height, camera.width, 3)


_PIXEL = np.dtype(
    [
        ("distance", np.float64),  # m, of the solid surface
        ("normal", np.float64, 3),
        ("lit", np.bool_),
        ("ghost", np.bool_),  # a translucent surface is hit
        ("mark", np.bool_),
    ]
)
"""What is seen at a pixel: where neighbours differ in it, there is an edge."""


def _edges(pixels: NDArray[np.void]) -> Flags:
    """(h, w) whether a pixel of (h, w) `_PIXEL` differs from a neighbour."""
    found = np.zeros(pixels.shape, bool)
    for axis in (0, 1):
        first, second = (pixels[:-1], pixels[1:]) if axis == 0 else (pixels[:, :-1], pixels[:, 1:])
        depth, other = first["distance"], second["distance"]
        differs = np.abs(depth - other) > _EDGE_DEPTH * np.minimum(depth, other)
        differs |= np.einsum("hwk,hwk->hw", first["normal"], second["normal"]) < _EDGE_NORMAL
        for name in ("lit", "ghost", "mark"):
            differs |= first[name] != second[name]
        if axis == 0:
            found[:-1] |= differs
            found[1:] |= differs
        else:
            found[:, :-1] |= differs
            found[:, 1:] |= differs
    return found


class _Hits(NamedTuple):
    """What rays hit first: a row each."""

    distance: Floats  # (n,) m; a large number for nothing
    normal: Floats  # (n, 3) unit, towards the eye; 0 for nothing
    colour: Floats  # (n, 3) of the surface
    hit: Flags  # (n,)


class _Layer:
    """The triangles of one layer, in an Embree scene of their own, relative to `origin`."""

    def __init__(self, surfaces: list[Surface], origin: Floats) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene: Any = None
        filled = [surface for surface in surfaces if len(surface.triangles)]
        if filled:
            self._scene = EmbreeScene()
            corners = np.concatenate([surface.triangles for surface in filled]) - origin
            TriangleMesh(self._scene, corners.astype(np.float32))
            self._normals = np.concatenate([surface.normals for surface in filled])
            counts = [len(surface.triangles) for surface in filled]
            self._colours = np.repeat([surface.colour for surface in filled], counts, axis=0)

    def cast(self, eye: Floats, rays: Floats) -> _Hits:
        count = len(rays)
        far, none = np.full(count, 1e9), np.zeros((count, 3))
        if self._scene is None:
            return _Hits(far, none, none.copy(), np.zeros(count, bool))
        starts = np.broadcast_to(eye.astype(np.float32), rays.shape).copy()
        found = self._scene.run(starts, rays.astype(np.float32), query="INTERSECT", output=1)
        hit = found["primID"] >= 0
        triangle, u, v = found["primID"][hit], found["u"][hit, None], found["v"][hit, None]
        corner = self._normals[triangle]
        normal = (1.0 - u - v) * corner[:, 0] + u * corner[:, 1] + v * corner[:, 2]
        normal *= np.where(np.einsum("ij,ij->i", normal, rays[hit]) > 0.0, -1.0, 1.0)[:, None]
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        far[hit], none[hit] = found["tfar"][hit], normal
        colours = np.zeros((count, 3))
        colours[hit] = self._colours[triangle]
        return _Hits(far, none, colours, hit)

    def occluded(self, points: Floats, direction: Floats) -> Flags:
        """(n,) whether something lies between points and the light."""
        rays = np.broadcast_to(direction.astype(np.float32), points.shape).copy()
        found = self._scene.run(points.astype(np.float32), rays, query="OCCLUDED")
        return np.asarray(found) >= 0


class _Layers:
    """Solid, translucent and mark layers as seen from a camera."""

    def __init__(self, camera: Camera, solid: list[Surface], translucent: list[Surface], marks: list[Surface]) -> None:
        self._camera = camera
        self._eye = camera.position - camera.target
        self._solid, self._ghost, self._marks = (_Layer(s, camera.target) for s in (solid, translucent, marks))

    def cast(self, x: Floats, y: Floats) -> tuple[Floats, NDArray[np.void]]:
        """Colours (n, 3) at points of the picture, and (n,) `_PIXEL`."""
        blocks = [self._cast(x[k : k + _BLOCK], y[k : k + _BLOCK]) for k in range(0, len(x), _BLOCK)]
        return np.concatenate([block[0] for block in blocks]), np.concatenate([block[1] for block in blocks])

    def _cast(self, x: Floats, y: Floats) -> tuple[Floats, NDArray[np.void]]:
        rays = self._camera.directions(x, y)
        solid, ghost, marks = (layer.cast(self._eye, rays) for layer in (self._solid, self._ghost, self._marks))
        lamp = self._lamp(solid, rays)
        colours = np.where(solid.hit[:, None], _shaded(solid, rays, lamp), BACKGROUND)
        rim = 1.0 - np.abs(np.einsum("ij,ij->i", ghost.normal, rays))  # a thin shell looks denser at its edge
        apart = solid.distance - ghost.distance
        opacity = np.where(apart > 0.0, _GHOST_IN_FRONT, _GHOST_HIDDEN) * (1.0 + 0.8 * rim**2)
        opacity *= ghost.hit * np.clip(np.abs(apart) / (_GHOST_FADE * ghost.distance), 0.0, 1.0)
        colours += opacity[:, None] * (_shaded(ghost, rays) - colours)
        opacity = marks.hit * np.where(marks.distance < solid.distance + 1e-3, 1.0, _MARK_HIDDEN)
        colours += opacity[:, None] * (_shaded(marks, rays) - colours)
        seen = np.zeros(len(rays), _PIXEL)
        seen["distance"], seen["normal"], seen["lit"] = solid.distance, solid.normal, lamp > 0.0
        seen["ghost"], seen["mark"] = ghost.hit, marks.hit
        return colours, seen

    def _lamp(self, hits: _Hits, rays: Floats) -> Floats:
        """(n,) share of the lamp's light on hits: 0 in shadow."""
        facing = np.einsum("ij,j->i", hits.normal, _TO_LIGHT)
        lit = np.flatnonzero(hits.hit & (facing > 0.0))
        lamp = np.zeros(len(rays))
        if len(lit):
            distance = hits.distance[lit, None]
            points = self._eye + distance * rays[lit] + _OFFSET * distance * hits.normal[lit]
            lamp[lit] = facing[lit] * ~self._solid.occluded(points, _TO_LIGHT)
        return lamp


def _shaded(hits: _Hits, rays: Floats, lamp: Floats | None = None) -> Floats:
    """Colours (n, 3) of hits in the light of the sky and, where `lamp` (n,) is given, of the lamp."""
    if lamp is None:
        lamp = np.clip(np.einsum("ij,j->i", hits.normal, _TO_LIGHT), 0.0, None)
    above = 0.5 + 0.5 * hits.normal[:, 2]
    head = np.abs(np.einsum("ij,ij->i", hits.normal, rays))
    light = _KEY * lamp + _SKY * above + _GROUND * (1.0 - above) + _HEAD * head
    colours: Floats = hits.colour * light[:, None]
    return colours
