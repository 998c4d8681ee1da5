"""A cone as another would add it: what is inserted in which file. `tests/house/test_new_shape.py` makes a copy with it."""

from __future__ import annotations

import shutil
from pathlib import Path

ADDED = {
    "scene/arrays.py": [("HULL = 4\n", "CONE = 5\n")],
    "scene/pieces.py": [
        ("from geomphys.scene.arrays import BOX, CAPSULE, ", "CONE, "),
        (
            "        return Row(CYLINDER, (r, h, 0.0), _ORIGIN, math.hypot(r, h), 2.0 * min(r, h), _NO_POLYTOPE)\n",
            '''

@dataclass(frozen=True)
class Cone(Shape):
    """A solid cone about the origin along z, its apex up: `radius` and `half_height` in m."""

    radius: float
    half_height: float

    def __post_init__(self) -> None:
        """Raise MeshError if a length is out of its range."""
        _require_positive("cone", radius=self.radius, half_height=self.half_height)

    def row(self) -> Row:
        """Its entries in the arrays."""
        r, h = self.radius, self.half_height
        width = min(2.0 * h, 4.0 * r * h / math.hypot(r, 2.0 * h))
        return Row(CONE, (r, h, 0.0), _ORIGIN, math.hypot(r, h), width, _NO_POLYTOPE)
''',
        ),
    ],
    "scene/primitives.py": [
        ("from geomphys.scene.pieces import Box, Capsule, ", "Cone, "),
        ("from geomphys.scene.tessellation import (\n", "    surface_of_revolution,\n"),
        (
            "PRIMITIVES = {\n",
            """    "cone": Primitive(
        attributes={"radius": 1, "length": 1},
        piece=lambda n: Cone(n[0], 0.5 * n[1]),
        mass=lambda n, density: _cone_mass(density * math.pi * n[0] ** 2 * n[1] / 3.0, n[0], n[1]),
        triangles=lambda n, k: surface_of_revolution(np.array([0.0, n[0], 0.0]), 0.5 * n[1] * np.array([-1.0, -1.0, 1.0]), k),
        parts=lambda n: [("cylinder", (n[0] * (7.5 - k) / 8, n[1] / 8), n[1] * (k - 3.5) / 8) for k in range(8)],
    ),
""",
        ),
        ("from __future__ import annotations\n\n", "import math\n\nimport numpy as np\n\n"),
        (
            "Lengths: TypeAlias = tuple[float, ...]\n",
            """

def _cone_mass(mass: float, radius: float, length: float) -> MassProperties:
    side = mass * (3.0 * radius**2 / 20.0 + 3.0 * length**2 / 80.0)
    centre = np.array([0.0, 0.0, -0.25 * length])
    return MassProperties(mass, centre, np.diag([side, side, 0.3 * mass * radius**2]))


""",
        ),
    ],
    "scene/scene_file.py": [
        (
            '    sphere: Length | None = Field(default=None, description="radius, m")\n',
            '    cone: Lengths2 | None = Field(default=None, description="radius and height along z, m")\n',
        )
    ],
    "collision/support.py": [
        ("from geomphys.scene.arrays import BOX, CAPSULE, ", "CONE, "),
        (
            "        return vec_at(core.pieces.vertices, core.first + farthest_corner(core, d))\n",
            """    if core.kind == CONE:
        around = math.sqrt(d[0] * d[0] + d[1] * d[1])
        if 2.0 * core.y * d[2] > core.x * around:
            return (0.0, 0.0, core.y)
        if around == 0.0:
            return (core.x, 0.0, -core.y)
        return (core.x * d[0] / around, core.x * d[1] / around, -core.y)
""",
        ),
        (
            "    local = rotate_back(rot, d)\n",
            """    if kind == CONE:
        around = math.sqrt(local[0] * local[0] + local[1] * local[1])
        slant = (2.0 * y * around + x * local[2]) / math.sqrt(4.0 * y * y + x * x)
        if slant > 0.95:
            set_vec_at(out, 0, add(at, rotate(rot, (0.0, 0.0, y))))
            set_vec_at(out, 1, add(at, rotate(rot, (x * local[0] / around, x * local[1] / around, -y))))
            return 2, d
        if local[2] > 0.0:
            return 1, d
        for k in range(RIM):
            angle = -k * (2.0 * math.pi / RIM)
            set_vec_at(out, k, add(at, rotate(rot, (x * math.cos(angle), x * math.sin(angle), -y))))
        return RIM, neg(axis)
""",
        ),
        ("    dot,\n", "    neg,\n"),
    ],
}
"""File of the package -> (a text that is there once, what is inserted after it)."""


def package_with_cone(source: Path, folder: Path) -> Path:
    """Copy the package `source` into a folder and insert the cone; returns the copy."""
    target = folder / source.name
    shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
    for name, insertions in ADDED.items():
        text = (target / name).read_text()
        for after, added in insertions:
            assert text.count(after) == 1, (name, after)
            text = text.replace(after, after + added)
        (target / name).write_text(text)
    return target
