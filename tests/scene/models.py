"""Small models written for tests."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

SPHERE = '<geometry><sphere radius="{}"/></geometry>'


def stl(path: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    """A binary STL."""
    corners = np.asarray(vertices, dtype="<f4")[np.asarray(faces)]
    record = np.zeros(len(corners), dtype=[("n", "<3f4"), ("v", "<9f4"), ("a", "<u2")])
    record["v"] = corners.reshape(-1, 9)
    path.write_bytes(b"\0" * 80 + struct.pack("<I", len(corners)) + record.tobytes())
    return path


def link(name: str, *collisions: str) -> str:
    """A link with these `<geometry>` elements for collision."""
    return f'<link name="{name}">' + "".join(f"<collision>{c}</collision>" for c in collisions) + "</link>"


def ball(name: str, radius: float = 0.01, at: str = "0 0 0") -> str:
    """A link with a ball."""
    return link(name, f'<origin xyz="{at}"/>' + SPHERE.format(radius))


def joint(name: str, parent: str, child: str, kind: str = "revolute", inside: str = "", xyz: str = "0 0 0.1") -> str:
    """A joint about z with limits of ±1."""
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>' if kind in ("revolute", "prismatic") else ""
    if "<limit" in inside:
        limit = ""
    axis = "" if "<axis" in inside else '<axis xyz="0 0 1"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/>{axis}{limit}{inside}</joint>'
    )


def urdf(path: Path, *elements: str) -> Path:
    """A URDF of these elements."""
    path.write_text(f'<robot name="model">{"".join(elements)}</robot>')
    return path


def cube(half: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """Corners and outward triangles of a cube about the origin."""
    corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))])


def ell() -> tuple[np.ndarray, np.ndarray]:
    """Corners and triangles of an L: 0.2 x 0.2 x 0.1 m with a quarter left out, so 0.003 m³."""
    outline = 0.1 * np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], dtype=float)
    corners = np.vstack([np.column_stack([outline, np.full(6, z)]) for z in (0.0, 0.1)])
    caps = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
    faces = [(c, b, a) for a, b, c in caps] + [(a + 6, b + 6, c + 6) for a, b, c in caps]
    for k in range(6):
        j = (k + 1) % 6
        faces += [(k, j, j + 6), (k, j + 6, k + 6)]
    return corners, np.array(faces)
