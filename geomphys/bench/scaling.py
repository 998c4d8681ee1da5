"""Measures how the frame time grows with fixed objects, hands, pieces of an object and heaps, in generated worlds."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geomphys.bench.experiments import Experiment
from geomphys.bench.measure import PeerMaker, measure
from geomphys.bench.report import Curve
from geomphys.config import Config
from geomphys.engine.pipeline import compile_ahead
from geomphys.engine.state import make_replay_data
from geomphys.jit.work import progress_to
from geomphys.load import load_world
from geomphys.numerics.transforms import apply, matrix_from_pose
from geomphys.results import Frame
from geomphys.scene.world import World
from geomphys.storage.temporary_folders import TemporaryFolder

Floats = NDArray[np.float64]

FRAMES = 256
HERTZ = 60.0
OVERLAP = 0.01  # m; how deep the recorded hand is in the table
CLEARANCE = 0.05  # m; how far above the table the hand is beside a heap, which is measured by itself
RADIUS, REVOLUTIONS = 0.05, 2.0  # m; the circle a hand slides on
SIDE = 0.8  # m of the table before each hand
EXTENT = (12.0, 12.0, 3.0)  # m
OBJECTS = (20, 60, 200, 600, 2000)
HANDS = (1, 2, 4, 8)
PIECES = (1, 3, 10, 50, 200)
BALLS = (20, 50, 100)
BOXES = (50, 100)
HEAP_FRAMES = 600  # ten seconds: the heap falls, and comes to rest
BALL_RADIUS, BOX_SIDE, BIN_SIDE = 0.02, 0.032, 0.3  # m


def warm_up() -> float:
    """Seconds until the first frames of a small world are done: the kernels' loading or compiling."""
    with TemporaryFolder() as folder, progress_to(None):
        start = time.perf_counter()
        world = world_of_objects(folder, 2, ball=True)
        measure(slide("warm-up", world, 8), Config(), 1)
        return time.perf_counter() - start


def curves(config: Config, repeats: int, peers: Sequence[PeerMaker], report: Callable[[], None]) -> Iterator[Curve]:
    """Measure the curves; `report` is called after each point."""
    deep, above = (FRAMES, OVERLAP), (HEAP_FRAMES, -CLEARANCE)
    families: tuple[tuple[str, str, tuple[int, ...], Callable[[Path, int], World], tuple[int, float]], ...] = (
        (
            "fixed objects spread over a hall, a hand sliding 1 cm deep over a table",
            "objects",
            OBJECTS,
            world_of_objects,
            deep,
        ),
        ("hands sliding 1 cm deep over a table", "hands", HANDS, table_of_hands, deep),
        ("pieces of the object under a hand", "pieces", PIECES, block_of_pieces, deep),
        ("balls that fall into a box and come to rest", "balls", BALLS, box_of_balls, above),
        ("boxes that fall into a box, turned at random, and come to rest", "boxes", BOXES, box_of_boxes, above),
    )
    for name, variable, sizes, make, (frames, overlap) in families:
        points = []
        for size in sizes:
            with TemporaryFolder() as folder:
                world = make(folder, size)
                points.append(measure(slide(f"{size} {variable}", world, frames, overlap), config, repeats, peers))
            report()
        growth = points[-1].step.median / points[0].step.median
        yield Curve(name=name, variable=variable, sizes=sizes, points=tuple(points), growth=growth)


def world_of_objects(folder: Path, count: int, ball: bool = False) -> World:
    """A table under a hand and boxes, `count` objects in all; boxes lie in a volume `EXTENT`, not near the hand."""
    random = np.random.default_rng(0)
    tables = [_box("table", (SIDE, SIDE, 0.1), (0.0, 0.0, -0.05))]
    while len(tables) < count:
        position = random.uniform(-0.5, 0.5, 3) * EXTENT
        if np.linalg.norm(position) > 0.5 + SIDE:
            tables.append(_box(f"box_{len(tables)}", tuple(random.uniform(0.05, 0.2, 3)), tuple(position)))
    if ball:
        tables.append(
            '[[object]]\nname = "ball"\nclass = "simulated"\nsphere = 0.02\n'
            f"position = [{0.4 * SIDE}, {0.4 * SIDE}, 0.020005]\ndensity = 600.0\n"
            'material = "wood"\n'
        )
    return _load(folder, 1, tables)


def table_of_hands(folder: Path, count: int) -> World:
    """Hands in a row, each over its own part of one table."""
    return _load(folder, count, [_box("table", (SIDE, SIDE * count, 0.1), (0.0, 0.5 * SIDE * (count - 1), -0.05))])


def block_of_pieces(folder: Path, count: int) -> World:
    """A hand over a block of `count` columns that make up one object, a table that is a grid of convex pieces."""
    rows = max(divisor for divisor in range(1, math.isqrt(count) + 1) if count % divisor == 0)
    x, y = SIDE / (count // rows), SIDE / rows
    shapes = "".join(
        f'<collision><origin xyz="{(i + 0.5) * x - 0.5 * SIDE} {(j + 0.5) * y - 0.5 * SIDE} -0.05"/>'
        f'<geometry><box size="{x} {y} 0.1"/></geometry></collision>'
        for i in range(count // rows)
        for j in range(rows)
    )
    (folder / "block.urdf").write_text(f'<robot name="block"><link name="top">{shapes}</link></robot>')
    return _load(folder, 1, ['[[object]]\nname = "block"\nclass = "fixed"\nurdf = "block.urdf"\nmaterial = "wood"\n'])


def box_of_balls(folder: Path, count: int) -> World:
    """A hand over a table, and balls in layers above a box without a lid."""
    return _heap(folder, count, lambda random: f"sphere = {BALL_RADIUS}\n")


def box_of_boxes(folder: Path, count: int) -> World:
    """A hand over a table, and boxes in layers, each turned at random, above a box without a lid."""

    def box(random: np.random.Generator) -> str:
        quaternion = random.normal(size=4)
        quaternion /= np.linalg.norm(quaternion)
        return f"box = {[BOX_SIDE] * 3}\norientation = {[float(v) for v in quaternion]}\n"

    return _heap(folder, count, box)


def _heap(folder: Path, count: int, shape: Callable[[np.random.Generator], str]) -> World:
    """A hand over a table, and objects in layers above a box without a lid; `shape` is the part of one in a scene file."""
    half, wall, x = 0.5 * BIN_SIDE, 0.05, 2.0
    tables = [_box("table", (SIDE, SIDE, 0.1), (0.0, 0.0, -0.05)), _box("floor", (1.0, 1.0, 0.1), (x, 0.0, -0.05))]
    for name, sign in (("left", -1.0), ("right", 1.0)):
        at = sign * (half + 0.5 * wall)
        tables.append(_box(f"{name}_x", (wall, BIN_SIDE + 2 * wall, 1.0), (x + at, 0.0, 0.5)))
        tables.append(_box(f"{name}_y", (BIN_SIDE, wall, 1.0), (x, at, 0.5)))
    random, a_row = np.random.default_rng(0), int(BIN_SIDE / (2.5 * BALL_RADIUS))
    for k in range(count):
        row = np.array([k % a_row, k // a_row % a_row, k // a_row**2])
        corner = (row + 0.5) * 2.5 * BALL_RADIUS + random.uniform(-0.2, 0.2, 3) * BALL_RADIUS - (half, half, 0.0)
        tables.append(
            f'[[object]]\nname = "object_{k}"\nclass = "simulated"\n{shape(random)}density = 600.0\n'
            f'position = {[float(v) for v in corner + np.array([x, 0.0, 0.05])]}\nmaterial = "wood"\n'
        )
    return _load(folder, 1, tables)


def slide(name: str, world: World, count: int, overlap: float = OVERLAP) -> Experiment:
    """Every hand of a world of this module goes in circles, its lowest point `overlap` [m] below the table's top."""
    data = make_replay_data(world.scene)
    owner = world.scene.bodies.tree
    lowest = min(
        float(np.min(apply(matrix_from_pose(data.recorded[body]), corners)[:, 2]))
        for body, (corners, _) in enumerate(world.collision_triangles)
        if owner[body] < world.avatar_count and len(corners)
    )
    frames = []
    for k in range(count):
        angle = 2.0 * math.pi * REVOLUTIONS * k / FRAMES
        roots = world.scene.trees.rest.copy()
        for hand in range(world.avatar_count):
            roots[hand, 0] += RADIUS * math.cos(angle)
            roots[hand, 1] += RADIUS * math.sin(angle) + SIDE * hand
            roots[hand, 2] -= lowest + overlap
        angles = np.full(len(world.dof_names), 0.1 + 0.05 * math.sin(angle))
        frames.append(Frame(index=k, time_ns=round(k * 1e9 / HERTZ), roots=roots, angles=angles, held=False))
    return Experiment(name=name, world=world, frames=frames, decode_ns=np.zeros(0))


def _box(name: str, size: tuple[float, ...], position: tuple[float, ...]) -> str:
    """A fixed box in a scene file."""
    return (
        f'[[object]]\nname = "{name}"\nclass = "fixed"\nbox = {[float(v) for v in size]}\n'
        f'position = {[float(v) for v in position]}\nmaterial = "wood"\n'
    )


def _load(folder: Path, hands: int, tables: list[str]) -> World:
    """A world of hands and objects, by way of its files in `folder`."""
    (folder / "hand.urdf").write_text(_hand())
    avatars = [
        f'[[avatar]]\nname = "hand_{k}"\nurdf = "hand.urdf"\nmode = "rigid"\nmaterial = "human"\nmass = 0.4\n'
        f'root = {{ topic = "/wrist_{k}" }}\njoints = {{ topic = "/glove_{k}" }}\n'
        for k in range(hands)
    ]
    scene = folder / "scene.toml"
    scene.write_text("\n".join(['[scene]\nname = "made up"\n', *avatars, *tables]))
    return load_world(scene, assembled=lambda world: compile_ahead(world, Config()))


def _hand() -> str:
    """A URDF: a palm and five fingers of three phalanges, each a cylinder with a ball at its end; 31 primitives."""
    links = ['<link name="palm"><collision><geometry><box size="0.09 0.09 0.025"/></geometry></collision></link>']
    for finger in range(5):
        parent, x, y = "palm", 0.045 if finger else 0.0, 0.045 if not finger else 0.044 - 0.02 * finger
        for phalanx, length in enumerate((0.045, 0.025, 0.02)):
            name = f"f{finger}_{phalanx}"
            links.append(
                f'<link name="{name}"><collision><origin xyz="{length / 2} 0 0" rpy="0 {math.pi / 2} 0"/><geometry>'
                f'<cylinder radius="0.008" length="{length}"/></geometry></collision><collision><origin xyz="{length} 0 0"/>'
                f'<geometry><sphere radius="0.008"/></geometry></collision></link><joint name="{name}" type="revolute">'
                f'<parent link="{parent}"/><child link="{name}"/><origin xyz="{x} {y} 0" rpy="0 0 {0 if finger else 1}"/>'
                '<axis xyz="0 1 0"/><limit lower="-0.3" upper="1.6" effort="1" velocity="10"/></joint>'
            )
            parent, x, y = name, length, 0.0
    return f'<robot name="hand">{"".join(links)}</robot>'
