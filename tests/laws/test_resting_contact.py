"""Bodies that rest, slide and roll, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.engine.frame_buffer import CONTACT
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Capsule, Cylinder, Hull, Shape, Sphere
from geomphys.simulated.frame_contacts import write_touches
from tests.simulated.scenes import FRICTION, GRAVITY, Player, Thing, floor

MU = FRICTION[0, 0]
LYING = Rotation.from_rotvec([0, np.pi / 2, 0]).as_quat()


def angle(a: np.ndarray, b: np.ndarray) -> float:
    """Degrees between two orientations."""
    return float(np.degrees((Rotation.from_quat(a) * Rotation.from_quat(b).inv()).magnitude()))


def on_slope(degrees: float, **more: object) -> Player:
    turn = Rotation.from_rotvec([0, np.radians(degrees), 0])
    n = turn.apply([0, 0, 1])
    slope = Thing(shape=Box((6, 2, 0.1)), role=s.FIXED, at=-0.1 * n, turn=turn.as_quat())
    box = Thing(shape=Box((0.08, 0.06, 0.03)), at=0.03 * n, turn=turn.as_quat(), **more)  # type: ignore[arg-type]
    return Player([box, slope])


@pytest.mark.parametrize("share", [0.5, 0.98, 0.999])
def test_a_block_sticks_on_a_slope_below_the_angle_of_friction(share: float) -> None:
    player = on_slope(np.degrees(np.arctan(share * MU)))
    track = player.run(5.0, 30)
    assert np.linalg.norm(track[-1, 0, :3] - track[1, 0, :3]) < 1e-6
    assert angle(track[-1, 0, 3:], track[0, 0, 3:]) < 1e-4


@pytest.mark.parametrize(("degrees", "rate"), [(np.degrees(np.arctan(1.01 * MU)), 60), (20, 30), (20, 240), (30, 60)])
def test_a_block_slides_down_a_steeper_slope_by_the_law(degrees: float, rate: int) -> None:
    player = on_slope(degrees)
    track = player.run(1.0, rate)
    theta = np.radians(degrees)
    a = GRAVITY * (np.sin(theta) - MU * np.cos(theta))
    down = Rotation.from_rotvec([0, theta, 0]).apply([1, 0, 0])
    assert (track[-1, 0, :3] - track[0, 0, :3]) @ down == pytest.approx(a / 2, rel=1e-2)
    assert player.velocity[0, :3] @ down == pytest.approx(a, rel=1e-3)


@pytest.mark.parametrize("shape", [Box((0.08, 0.06, 0.05)), Cylinder(0.06, 0.03)])
def test_a_sliding_body_stops_where_friction_lets_it(shape: Shape) -> None:
    low = shape.half_extents[2] if isinstance(shape, Box) else shape.half_height  # type: ignore[union-attr]
    player = Player([Thing(shape=shape, at=(-1, 0, low), v=(1.5, 0, 0)), floor()])
    track = player.run(1.5)
    way = track[-1, 0, :3] - track[0, 0, :3]
    assert way[0] == pytest.approx(1.5**2 / (2 * MU * GRAVITY), rel=1e-3)
    assert abs(way[1]) < 1e-5
    assert angle(track[-1, 0, 3:], track[0, 0, 3:]) < 1e-2


@pytest.mark.parametrize("rate", [30, 60, 120, 240])
def test_a_sliding_ball_ends_up_rolling_at_five_sevenths(rate: int) -> None:
    player = Player([Thing(shape=Sphere(0.05), at=(-1, 0, 0.05), v=(1, 0, 0)), floor()])
    slip = 2 / (7 * MU * GRAVITY)  # s until it rolls
    track = player.run(0.5, rate)
    v = player.velocity[0]
    assert v[0] == pytest.approx(5 / 7, rel=1e-3)
    assert v[4] == pytest.approx(v[0] / 0.05, rel=1e-4)
    way = slip - MU * GRAVITY * slip**2 / 2 + 5 / 7 * (0.5 - slip)
    assert track[-1, 0, 0] - track[0, 0, 0] == pytest.approx(way, rel=2e-3)


SHAPES: dict[str, tuple[Shape, float, tuple[float, ...]]] = {
    "box": (Box((0.1, 0.08, 0.05)), 0.05, (0, 0, 0, 1)),
    "ball": (Sphere(0.05), 0.05, (0, 0, 0, 1)),
    "standing cylinder": (Cylinder(0.05, 0.08), 0.08, (0, 0, 0, 1)),
    "lying cylinder": (Cylinder(0.05, 0.08), 0.05, tuple(LYING)),
    "lying capsule": (Capsule(0.03, 0.08), 0.03, tuple(LYING)),
    "octahedron": (Hull(0.1 * np.vstack([np.eye(3), -np.eye(3)])), 0.1 / np.sqrt(3), (0, 0, 0, 1)),
}


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("above", [0.0, 1e-3])
def test_a_body_left_on_a_table_stays_for_a_minute(name: str, above: float) -> None:
    shape, low, turn = SHAPES[name]
    if name == "octahedron":  # one face down
        turn = tuple(Rotation.align_vectors([[0, 0, -1]], [np.ones(3) / np.sqrt(3)])[0].as_quat())
    player = Player([Thing(shape=shape, at=(0.2, -0.1, low + above), turn=turn), floor()])
    track = player.run(1.0)
    track = np.concatenate([track[-1:], player.run(59.0, 30)])
    assert np.abs(track[:, 0, :3] - track[0, 0, :3]).max() < 1e-6
    assert angle(track[-1, 0, 3:], track[0, 0, 3:]) < 1e-3
    assert track[0, 0, 2] == pytest.approx(low, abs=1e-5)
    assert player.overlap() < 1e-10
    assert player.flags == 0


@pytest.mark.parametrize("above", [0.0, 1e-3])
def test_a_stack_of_three_boxes_stays_for_a_minute(above: float) -> None:
    boxes = [Thing(shape=Box((0.1, 0.1, 0.05)), at=(0.01 * k, 0, 0.05 + 0.1 * k + above * (k + 1))) for k in range(3)]
    player = Player([*boxes, floor()])
    player.run(1.0)
    track = player.run(59.0, 30)
    assert np.abs(track[:, :3, :3] - track[0, :3, :3]).max() < 1e-6
    assert max(angle(track[-1, b, 3:], track[0, b, 3:]) for b in range(3)) < 1e-3
    assert player.overlap() < 1e-10


@pytest.mark.parametrize("top", [1.0, 20.0])
def test_a_tower_of_ten_boxes_stands(top: float) -> None:
    boxes = [
        Thing(shape=Box((0.1, 0.1, 0.05)), at=(0, 0, 0.05 + 0.1 * k), mass=top if k == 9 else 1.0) for k in range(10)
    ]
    player = Player([*boxes, floor()])
    start, energy = player.poses.copy(), player.energy()
    # surfaces that touched are moved a gap apart, which lifts the topmost by ten gaps
    lift = 1.5 * 10 * player.gap * GRAVITY * (9.0 + top)
    for _ in range(120):
        player.step(1 / 60)
        assert player.energy() <= energy + lift
    assert np.abs(player.poses[:, :3] - start[:, :3]).max() < 2e-4
    assert player.overlap() < 1e-5


@pytest.mark.parametrize("count", [12, 14])
def test_a_tower_does_not_creep_sideways(count: int) -> None:
    """In six seconds by 8 and 15 µm; by 41 and 103 where heaps are swept as little at rest as while they move."""
    cubes = [
        Thing(shape=Box((0.025,) * 3), at=(0, 0, 0.025 + 0.05 * k + 1e-5 * (k + 1)), mass=0.075) for k in range(count)
    ]
    player = Player([*cubes, floor()])
    start = player.poses.copy()
    player.run(6.0)
    assert np.abs(player.poses[:, :2] - start[:, :2]).max() < 2.5e-5


def test_each_floor_of_a_tower_carries_what_is_above_it() -> None:
    boxes = [Thing(shape=Box((0.1, 0.1, 0.05)), at=(0.004 * k, 0, 0.05 + 0.1 * k), mass=1.0 + k) for k in range(6)]
    player = Player([*boxes, floor()])
    player.run(0.2)
    contacts = np.zeros(64, CONTACT)
    contacts = contacts[: write_touches(player.packed, player.poses, contacts, 0)]
    for k in range(6):
        below = 6 if k == 0 else k - 1
        between = [{contact["body_a"], contact["body_b"]} == {k, below} for contact in contacts]
        weight = sum(1.0 + i for i in range(k, 6)) * GRAVITY / 60
        assert contacts["normal_impulse"][between].sum() == pytest.approx(weight, rel=1e-6)


def test_a_coin_that_spins_and_settles_never_gains_energy() -> None:
    turn = Rotation.from_rotvec([np.pi / 2 - 0.1, 0, 0]).as_quat()
    coin = Thing(shape=Cylinder(0.05, 0.003), at=(0, 0, 0.052), turn=turn, w=(0, 0, 25), material="metal")
    player = Player([coin, floor("metal")])
    energy = player.energy()
    for _ in range(180):
        player.step(1 / 60)
        assert player.energy() <= energy + 1e-12
        energy = player.energy()
        assert player.overlap() < 1e-5


def test_a_box_on_one_that_is_slid_away_falls() -> None:
    """A stack is no glue: pushed beyond its support a box tips over."""
    player = Player(
        [
            Thing(shape=Box((0.1, 0.1, 0.05)), at=(0.13, 0, 0.15)),
            Thing(shape=Box((0.1, 0.1, 0.05)), at=(0, 0, 0.05), mass=1e3),
            floor(),
        ]
    )
    player.run(1.5)
    assert player.poses[0, 2] < 0.12


@pytest.mark.parametrize("seed", [0, 1])
def test_a_falling_pile_never_gains_energy_and_comes_to_rest(seed: int) -> None:
    rng = np.random.default_rng(seed)
    things = [
        Thing(
            shape=Box(tuple(rng.uniform(0.03, 0.08, 3))),
            at=(*rng.uniform(-0.05, 0.05, 2), 0.15 + 0.2 * k),
            turn=Rotation.random(random_state=10 * seed + k).as_quat(),
            w=3 * rng.normal(size=3),
        )
        for k in range(5)
    ]
    player = Player([*things, floor()])
    energy = player.energy()
    for frame in range(240):
        player.step(1 / 60)
        after = player.energy()
        assert after <= energy + 1e-9
        energy = after
        if frame % 5 == 0:
            assert player.overlap() < 1e-5
    assert np.abs(player.velocity[:5]).max() < 1e-3


def test_a_spinning_box_that_falls_on_a_corner_never_gains_energy() -> None:
    turn = Rotation.from_rotvec([0.5, 0.6, 0.3]).as_quat()
    player = Player([Thing(shape=Box((0.08, 0.06, 0.04)), at=(0, 0, 0.4), turn=turn, w=(5, -3, 8)), floor()])
    energy = player.energy()
    for _ in range(180):
        player.step(1 / 60)
        after = player.energy()
        assert after <= energy + 1e-10
        energy = after
    assert player.poses[0, 2] == pytest.approx(0.04, abs=1e-5)
