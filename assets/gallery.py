"""The gallery: two rooms with a doorway, 21 objects, 476 triangles, and the scene file that furnishes them.

World: x east, y north, z up from the floor, metres. The main room is x 0 to 6, the small one 6.2 to 10.2; both are
y 0 to 5. The rooms have no ceiling, so that one can look in from above.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from files import number, write_obj
from solids import Solid, block, extruded, from_faces, globe, regular, upright

TRIANGLES = 476
BALL_TRIANGLES = 960
BALL_RADIUS = 0.05
TABLE = (1.6, 0.8, 0.76)  # length, width, height
TABLE_AT = (2.0, 1.5)
BALL_AT = (1.95, 1.62)
BALL_GAP = 5e-6  # between the ball's lowest face and the table top


class Thing(NamedTuple):
    """A fixed object of the gallery: mesh file (without ending), place, turn about z in degrees, material, density."""

    name: str
    mesh: str
    position: tuple[float, float, float]
    yaw: float = 0.0
    material: str = "wood"


def meshes() -> dict[str, Solid]:
    """Every mesh of the gallery by file name, standing on z = 0 (pictures: centred, facing +y)."""
    return {
        "floor": block(10.6, 5.4, 0.1),
        "wall_long": block(10.6, 0.2, 3.0),
        "wall_short": block(0.2, 5.0, 3.0),
        "partition": partition(),
        "table": table(),
        "bench": portal(1.5, 0.42, 0.42, 0.06, 0.07),
        "pedestal_square": block(0.36, 0.36, 0.95),
        "pedestal_hexagon": extruded(regular(6, 0.24), 0.85, taper=0.8),
        "plinth": block(0.9, 0.9, 0.25),
        "picture_wide": block(1.2, 0.04, 0.8),
        "picture_tall": block(0.7, 0.04, 1.0),
        "picture_framed": framed(1.6, 1.1, 0.06, 0.08, 0.03),
        "crystal": icosahedron(0.17),
        "star": upright(star(5, 0.32, 0.13, 0.12)).moved((0.0, 0.06, 0.0)),
        "arch": upright(arch(0.42, 0.28, 0.75, 7)).moved((0.0, 0.15, 0.0)),
        "column": extruded(regular(8, 0.16), 3.0),
        "vase": extruded(regular(6, 0.12), 0.5, taper=1.5),
    }


THINGS = (
    Thing("floor", "floor", (5.1, 2.5, -0.1)),
    Thing("wall_south", "wall_long", (5.1, -0.1, 0.0)),
    Thing("wall_north", "wall_long", (5.1, 5.1, 0.0)),
    Thing("wall_west", "wall_short", (-0.1, 2.5, 0.0)),
    Thing("wall_east", "wall_short", (10.3, 2.5, 0.0)),
    Thing("partition", "partition", (6.1, 2.5, 0.0)),
    Thing("table", "table", (*TABLE_AT, 0.0)),
    Thing("bench_main", "bench", (4.2, 3.0, 0.0)),
    Thing("bench_small", "bench", (8.2, 2.2, 0.0), 90.0),
    Thing("pedestal_crystal", "pedestal_square", (0.8, 4.2, 0.0)),
    Thing("pedestal_star", "pedestal_hexagon", (3.0, 4.2, 0.0)),
    Thing("plinth", "plinth", (8.9, 3.9, 0.0)),
    Thing("picture_north", "picture_wide", (1.9, 4.97, 1.25), 180.0),
    Thing("picture_south", "picture_tall", (7.6, 0.03, 1.2)),
    Thing("picture_east", "picture_tall", (10.17, 2.2, 1.2), 90.0),
    Thing("picture_large", "picture_framed", (4.4, 4.96, 1.1), 180.0),
    Thing("crystal", "crystal", (0.8, 4.2, 0.95), 20.0, "metal"),
    Thing("star", "star", (3.0, 4.2, 0.85), 15.0, "metal"),
    Thing("arch", "arch", (8.9, 3.9, 0.25), 30.0, "metal"),
    Thing("column", "column", (5.3, 0.8, 0.0), 22.5),
    Thing("vase", "vase", (9.7, 0.5, 0.0), 0.0, "metal"),
)


def make(folder: Path, ball_folder: Path, scene: Path) -> int:
    """Write the meshes, the ball and the scene file; returns the number of triangles of all things (not the ball)."""
    counts = {n: write_obj(folder / f"{n}.obj", s, f"gallery, {n.replace('_', ' ')}") for n, s in meshes().items()}
    total = sum(counts[thing.mesh] for thing in THINGS)
    ball = globe(BALL_RADIUS, 32, 16)
    balls = write_obj(ball_folder / "ball.obj", ball, "ball of 32 meridians and 16 bands")
    if (total, balls) != (TRIANGLES, BALL_TRIANGLES):
        raise ValueError(
            f"gallery and ball have {total} and {balls} triangles, wanted {TRIANGLES} and {BALL_TRIANGLES}"
        )
    scene.parent.mkdir(parents=True, exist_ok=True)
    scene.write_text(scene_text(), encoding="ascii", newline="\n")
    return total


def table() -> Solid:
    """A table with four legs flush with its corners, in one piece: 60 triangles."""
    (length, width, height), leg, board = TABLE, 0.07, 0.05
    x, y, low = length / 2, width / 2, height - board
    vertices: list[tuple[float, float, float]] = []
    for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        beside, inner, before = (sx * (x - leg), sy * y), (sx * (x - leg), sy * (y - leg)), (sx * x, sy * (y - leg))
        first, last = (before, beside) if sx * sy > 0 else (beside, before)
        vertices += [(sx * x, sy * y, height), (*first, low), (*inner, low), (*last, low)]
        vertices += [(sx * x, sy * y, 0.0), (*first, 0.0), (*inner, 0.0), (*last, 0.0)]
    faces: list[tuple[int, ...]] = [(0, 8, 16, 24)]
    under: list[int] = []
    for k in range(4):
        c, n = 8 * k, 8 * ((k + 1) % 4)
        # of corner c: +0 top, +1 +2 +3 first, inner and last point under the board, +4 to +7 the same on the floor
        under += [c + 1, c + 2, c + 3]
        faces.append((c + 4, c + 5, c + 6, c + 7))
        faces += [(c + 1, c + 2, c + 6, c + 5), (c + 2, c + 3, c + 7, c + 6)]
        faces.append((c, c + 4, c + 7, c + 3, n + 1, n + 5, n + 4, n))
    faces.append(tuple(reversed(under)))
    corners = np.array(vertices)
    return _outward(corners, faces)


def _outward(vertices: np.ndarray, faces: list[tuple[int, ...]]) -> Solid:
    """Solid from faces that all wind alike; turned inside out if that encloses a negative volume."""
    solid = from_faces(vertices, faces)
    a, b, c = (solid.vertices[solid.triangles[:, k]] for k in range(3))
    if np.einsum("ij,ij->", a, np.cross(b, c)) < 0:
        return Solid(solid.vertices, solid.triangles[:, ::-1])
    return solid


def portal(length: float, depth: float, height: float, board: float, leg: float) -> Solid:
    """A board on two slabs (bench): a portal outline pulled through ``depth``; 28 triangles."""
    x = length / 2
    outline = [(-x, 0.0), (-x + leg, 0.0), (-x + leg, height - board), (x - leg, height - board)]
    outline += [(x - leg, 0.0), (x, 0.0), (x, height), (-x, height)]
    return upright(extruded(outline, depth)).moved((0.0, depth / 2, 0.0))


def partition() -> Solid:
    """The wall between the rooms, 0.2 m thick along y, with a doorway 1.2 m wide and 2.2 m high; 28 triangles."""
    wall = portal(5.0, 0.2, 3.0, 0.8, 1.9)
    v = wall.vertices
    return Solid(np.stack([-v[:, 1], v[:, 0], v[:, 2]], axis=1), wall.triangles)


def framed(width: float, height: float, depth: float, border: float, recess: float) -> Solid:
    """A picture sunk into its frame, facing +y; 28 triangles."""
    outer = [(-width / 2, 0.0), (width / 2, 0.0), (width / 2, height), (-width / 2, height)]
    inner = [(-width / 2 + border, border), (width / 2 - border, border)]
    inner += [(width / 2 - border, height - border), (-width / 2 + border, height - border)]
    front, deep = depth / 2, depth / 2 - recess
    vertices = [(x, -depth / 2, z) for x, z in outer] + [(x, front, z) for x, z in outer]
    vertices += [(x, front, z) for x, z in inner] + [(x, deep, z) for x, z in inner]
    faces: list[tuple[int, ...]] = [(0, 1, 2, 3), (15, 14, 13, 12)]
    for k in range(4):
        n = (k + 1) % 4
        for ring in (0, 4, 8):
            faces.append((ring + n, ring + k, ring + 4 + k, ring + 4 + n))
    return _outward(np.array(vertices), faces)


def star(points: int, outer: float, inner: float, thickness: float) -> Solid:
    """A star standing on two of its points; 8 n - 4 triangles."""
    turn = np.pi / 2 + np.pi * np.arange(2 * points) / points
    radius = np.where(np.arange(2 * points) % 2 == 0, outer, inner)
    outline = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=1)
    outline[:, 1] -= outline[:, 1].min()
    return extruded([(float(x), float(y)) for x, y in outline], thickness)


def arch(outer: float, inner: float, height: float, steps: int) -> Solid:
    """A round arch: an outline of 2 ``steps`` + 2 corners, pulled through 0.3 m."""
    rise = height - outer
    angles = np.pi * np.arange(steps - 1) / (steps - 2)
    outline = [(outer, 0.0)] + [(outer * np.cos(a), rise + outer * np.sin(a)) for a in angles] + [(-outer, 0.0)]
    outline += [(-inner, 0.0)] + [(inner * np.cos(a), rise + inner * np.sin(a)) for a in angles[::-1]] + [(inner, 0.0)]
    return extruded([(float(x), float(y)) for x, y in outline], 0.3)


def icosahedron(radius: float) -> Solid:
    """A regular icosahedron resting on one face at z = 0."""
    g = (1 + 5**0.5) / 2
    raw = [(0, s, t * g) for s in (-1, 1) for t in (-1, 1)]
    points = np.array(raw + [(b, c, a) for a, b, c in raw] + [(c, a, b) for a, b, c in raw], dtype=float)
    gaps = np.linalg.norm(points[:, None] - points[None], axis=2)
    near = (gaps > 0) & (gaps < 2.1)
    triangles = []
    for i in range(12):
        for j in range(i + 1, 12):
            for k in range(j + 1, 12):
                if near[i, j] and near[j, k] and near[i, k]:
                    turn = np.cross(points[j] - points[i], points[k] - points[i]) @ points[i] > 0
                    triangles.append((i, j, k) if turn else (i, k, j))
    points *= radius / np.linalg.norm(points[0])
    down = -points[list(triangles[0])].mean(axis=0)
    z = down / np.linalg.norm(down)
    x = points[triangles[0][0]] + down
    x /= np.linalg.norm(x)
    turned = points @ np.stack([x, np.cross(z, x), z], axis=1)
    turned[:, 2] -= turned[:, 2].min()
    return Solid(turned, np.array(triangles))


def ball_rest() -> tuple[float, tuple[float, float, float, float]]:
    """Height of the ball's centre over its support, and its turn (x y z w), lying on a face beside its equator."""
    ring = np.cos(np.pi / 16)
    # the face between the equator and the next parallel, about the meridian half way between two corners
    middle = BALL_RADIUS * np.cos(np.pi / 32)
    below, above = np.array([middle, 0.0]), np.array([middle * ring, BALL_RADIUS * np.sin(np.pi / 16)])
    along = (above - below) / np.linalg.norm(above - below)
    normal = np.array([along[1], -along[0]])
    # the face's normal lies in the plane of that meridian; a turn about z brings it over x, one about y points it down
    tip = np.arctan2(normal[1], normal[0]) + np.pi / 2
    yaw = -np.pi / 32
    turn = _product((0.0, np.sin(tip / 2), 0.0, np.cos(tip / 2)), (0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)))
    return float(normal @ below), turn


def _product(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, float, float, float]:
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    return (
        float(aw * bx + ax * bw + ay * bz - az * by),
        float(aw * by - ax * bz + ay * bw + az * bx),
        float(aw * bz + ax * by - ay * bx + az * bw),
        float(aw * bw - ax * bx - ay * by - az * bz),
    )


HEAD = """# The gallery of two rooms: a hand rests in the air, slides over the table and back, and pushes the ball.
# Written by make_assets.py.
[scene]
name = "gallery"
gravity = [0.0, 0.0, -9.81]

[[avatar]]
name = "hand"
urdf = "../hand/hand.urdf"
mode = "rigid"
material = "human"
mass = 0.4
root = { topic = "/tracker/wrist", position = [-0.015, 0.0, -0.034], orientation = [0.0, 0.0, 0.0, 1.0] }
joints = { topic = "/glove/joint_states", unit = "rad" }
coupling = { stiffness = 1000.0, damping = 40.0 }

"""


def scene_text() -> str:
    """The gallery's scene file."""
    height, turn = ball_rest()
    centre = (*BALL_AT, TABLE[2] + height + BALL_GAP)
    lines = ["[[object]]", 'name = "ball"', 'class = "simulated"', 'mesh = "../ball/ball.obj"']
    lines += [f"position = {_row(centre)}", f"orientation = {_row(turn, 15)}"]
    lines += ['material = "wood"', "density = 600.0", ""]
    for thing in THINGS:
        half = np.radians(thing.yaw) / 2
        lines += ["[[object]]", f'name = "{thing.name}"', 'class = "fixed"', f'mesh = "../gallery/{thing.mesh}.obj"']
        lines += ["scale = 1", f"position = {_row(thing.position)}"]  # in metres, long as it may be
        if thing.yaw:
            lines.append(f"orientation = {_row((0.0, 0.0, np.sin(half), np.cos(half)), 15)}")
        lines += [f'material = "{thing.material}"', ""]
    return HEAD + "\n".join(lines)


def _row(values: tuple[float, ...], digits: int = 9) -> str:
    texts = [number(v, digits) for v in values]
    return "[" + ", ".join(t if "." in t else f"{t}.0" for t in texts) + "]"
