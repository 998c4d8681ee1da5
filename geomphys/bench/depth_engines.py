"""Adapters that let coal and python-fcl measure the same pairs of shapes, one call a pair."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from geomphys.bench.pair_loop import SEPARATION, Separations
from geomphys.errors import ConfigError
from geomphys.scene.arrays import BOX, CAPSULE, CYLINDER, SPHERE, Pieces

Floats = NDArray[np.float64]


class DepthPeer(Protocol):
    """A library that finds contacts of pairs of shapes."""

    name: str

    def run(self, first: int, last: int) -> None:
        """Find the contacts of the pairs `first` to `last` and discard them."""

    def answers(self) -> Separations:
        """(N,) SEPARATION of all pairs; 0 where it finds no contact."""

    def all(self, frames: Floats) -> Separations:
        """The same with the pieces at `frames` (2 N, 12)."""


def _primitive(engine: Any, pieces: Pieces, k: int) -> Any:
    """Piece k as a primitive of coal or python-fcl, which name them alike; None for a hull."""
    kind, (x, y, z) = int(pieces.kind[k]), pieces.size[k]
    if kind == SPHERE:
        return engine.Sphere(x)
    if kind == BOX:
        return engine.Box(2 * x, 2 * y, 2 * z)
    if kind in (CAPSULE, CYLINDER):
        return (engine.Capsule if kind == CAPSULE else engine.Cylinder)(x, 2 * y)
    return None


class Coal:
    """Calls of coal's `collide`.

    Raises
    ------
    ConfigError
        coal is not installed.
    """

    def __init__(self, pieces: Pieces, frames: Floats) -> None:
        try:
            import coal
        except ImportError:
            raise ConfigError("peers need MuJoCo and coal: pip install 'geomphys[bench]'") from None
        self._coal = coal
        self.name = f"coal {coal.__version__}"
        self._shapes = [self._shape(pieces, k) for k in range(len(pieces.kind))]
        self._transforms = self._transforms_of(frames)
        self._request, self._result = coal.CollisionRequest(), coal.CollisionResult()
        self._request.enable_contact = True
        self._request.num_max_contacts = 1

    def run(self, first: int, last: int) -> None:
        """Find the contacts of the pairs `first` to `last`."""
        collide, request, result = self._coal.collide, self._request, self._result
        shapes, transforms = self._shapes, self._transforms
        for k in range(2 * first, 2 * last, 2):
            result.clear()
            collide(shapes[k], transforms[k], shapes[k + 1], transforms[k + 1], request, result)

    def answers(self) -> Separations:
        """(N,) SEPARATION of all pairs."""
        out = np.zeros(len(self._shapes) // 2, SEPARATION)
        for k in range(len(out)):
            self.run(k, k + 1)
            if self._result.isCollision():
                contact = self._result.getContact(0)
                out[k] = -contact.normal, -abs(contact.penetration_depth)
        return out

    def all(self, frames: Floats) -> Separations:
        """(N,) SEPARATION with the pieces at `frames` (2 N, 12)."""
        before, self._transforms = self._transforms, self._transforms_of(frames)
        answers = self.answers()
        self._transforms = before
        return answers

    def _transforms_of(self, frames: Floats) -> list[Any]:
        rotations, positions = frames[:, :9].reshape(-1, 3, 3), frames[:, 9:]
        pairs = zip(rotations, positions, strict=True)
        return [self._coal.Transform3s(np.ascontiguousarray(r), np.ascontiguousarray(p)) for r, p in pairs]

    def _shape(self, pieces: Pieces, k: int) -> Any:
        coal = self._coal
        if (primitive := _primitive(coal, pieces, k)) is not None:
            return primitive
        points = coal.StdVec_Vec3s()
        for corner in pieces.vertices[pieces.vertex_start[k] : pieces.vertex_start[k + 1]]:
            points.append(corner)
        return coal.Convex.convexHull(points, True, "Qt")


class Fcl:
    """Calls of python-fcl's `collide`."""

    def __init__(self, pieces: Pieces, frames: Floats) -> None:
        import fcl

        self._fcl = fcl
        self.name = f"python-fcl {fcl.__version__}"
        self._shapes = [self._shape(pieces, k) for k in range(len(pieces.kind))]
        self._objects = self._transforms_of(frames)
        self._request: Callable[[], Any] = lambda: fcl.CollisionRequest(num_max_contacts=1, enable_contact=True)

    def run(self, first: int, last: int) -> None:
        """Find the contacts of the pairs `first` to `last`."""
        for k in range(first, last):
            self._contact(k)

    def answers(self) -> Separations:
        """(N,) SEPARATION of all pairs."""
        out = np.zeros(len(self._shapes) // 2, SEPARATION)
        for k in range(len(out)):
            contacts = self._contact(k).contacts
            if contacts:
                out[k] = -np.asarray(contacts[0].normal), -abs(contacts[0].penetration_depth)
        return out

    def all(self, frames: Floats) -> Separations:
        """(N,) SEPARATION with the pieces at `frames` (2 N, 12)."""
        before, self._objects = self._objects, self._transforms_of(frames)
        answers = self.answers()
        self._objects = before
        return answers

    def _contact(self, pair: int) -> Any:
        """The result of one pair; a request serves once."""
        result = self._fcl.CollisionResult()
        self._fcl.collide(self._objects[2 * pair], self._objects[2 * pair + 1], self._request(), result)
        return result

    def _transforms_of(self, frames: Floats) -> list[Any]:
        fcl = self._fcl
        return [
            fcl.CollisionObject(shape, fcl.Transform(frame[:9].reshape(3, 3), frame[9:]))
            for shape, frame in zip(self._shapes, frames, strict=True)
        ]

    def _shape(self, pieces: Pieces, k: int) -> Any:
        fcl = self._fcl
        if (primitive := _primitive(fcl, pieces, k)) is not None:
            return primitive
        first, last = pieces.face_start[k], pieces.face_start[k + 1]
        faces: list[int] = []
        for face in range(first, last):
            loop = pieces.loops[pieces.loop_start[face] : pieces.loop_start[face + 1]]
            faces += [len(loop), *(int(corner) for corner in loop)]
        corners = pieces.vertices[pieces.vertex_start[k] : pieces.vertex_start[k + 1]]
        return fcl.Convex(corners.copy(), int(last - first), np.array(faces, dtype=np.int64))
