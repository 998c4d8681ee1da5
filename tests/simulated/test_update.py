"""The loop itself: repeatability, frame rate, bounds, sleep, bad numbers, reports."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.engine.frame_buffer import CONTACT
from geomphys.results import FLAG_IMPACT_BOUND, FLAG_QUARANTINED, FLAG_TABLE_FULL
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Capsule, Cylinder, Sphere
from geomphys.simulated.allocation import Capacity
from geomphys.simulated.frame_contacts import write_touches
from tests.simulated.scenes import GRAVITY, Player, Thing, floor, make_scene


def mixed_things() -> list[Thing]:
    turn = Rotation.from_rotvec([0.4, 0.2, 0.1]).as_quat()
    return [
        Thing(shape=Sphere(0.05), at=(-0.5, 0, 0.05), v=(1.5, 0, 0)),
        Thing(shape=Box((0.05, 0.05, 0.05)), at=(0, 0.01, 0.05)),
        Thing(shape=Box((0.04, 0.06, 0.03)), at=(0.3, 0.1, 0.5), turn=turn, w=(1, 2, 3), material="metal"),
        floor(),
    ]


def touches(player: Player) -> np.ndarray:
    """(n,) CONTACT."""
    contacts = np.zeros(64, CONTACT)
    return contacts[: write_touches(player.packed, player.poses, contacts, 0)]


def test_a_repetition_is_equal_in_every_bit() -> None:
    a, b = (Player(mixed_things()) for _ in range(2))
    assert np.array_equal(a.run(2.0), b.run(2.0))
    assert np.array_equal(a.velocity, b.velocity)
    assert a.impacts == b.impacts > 0


def test_the_frame_rate_is_no_physical_parameter() -> None:
    ends = []
    for rate in (30, 60, 120, 240):
        player = Player(mixed_things())
        player.run(1.0, rate)
        ends.append(player.poses[:3].copy())
    for end in ends[1:]:
        np.testing.assert_allclose(end, ends[0], rtol=0, atol=2e-3)


def heap_things() -> list[Thing]:
    rng = np.random.default_rng(0)
    return [
        Thing(
            shape=Box(tuple(rng.uniform(0.03, 0.08, 3))),
            at=(*rng.uniform(-0.05, 0.05, 2), 0.15 + 0.2 * k),
            turn=Rotation.random(random_state=k).as_quat(),
            w=3 * rng.normal(size=3),
        )
        for k in range(4)
    ] + [floor()]


def wobbling_things() -> list[Thing]:
    turn = Rotation.from_rotvec([np.pi / 2 - 0.1, 0, 0]).as_quat()
    coin = Thing(shape=Cylinder(0.05, 0.003), at=(0, 0, 0.052), turn=turn, w=(0, 0, 25), material="metal")
    return [coin, floor("metal")]


@pytest.mark.parametrize("things", [heap_things, wobbling_things])
def test_a_heap_and_a_wobbling_coin_do_not_know_the_frame_rate(things: Callable[[], list[Thing]]) -> None:
    ends = []
    for rate in (30, 60, 120, 240):
        player = Player(things())
        player.run(1.5, rate)
        ends.append(player.poses.copy())
    for end in ends[1:]:
        np.testing.assert_allclose(end, ends[0], rtol=0, atol=1e-5)


@pytest.mark.parametrize("room", [1e-6, 0.0, -1e-6, -2e-6, -4e-6])
@pytest.mark.parametrize("shape", [Box((0.05, 0.05, 0.05)), Cylinder(0.05, 0.05)])
def test_what_fits_exactly_into_a_slot_sleeps_there(shape: Box | Cylinder, room: float) -> None:
    walls = [Thing(shape=Box((0.05, 0.25, 0.25)), role=s.FIXED, at=(x * (0.1 + room), 0, 0.25)) for x in (-1, 1)]
    player = Player([Thing(shape=shape, at=(0, 0, 0.05)), floor(), *walls])
    player.run(4.0)
    assert player.simulation.bodies["activation"][0] == 0
    assert np.abs(player.poses[0, :3] - [0, 0, 0.05]).max() < 1e-5


def test_fifty_bodies_fall_into_a_box_and_come_to_rest_without_hitting_a_bound() -> None:
    rng, side, things = np.random.default_rng(0), 0.25, []
    for k in range(50):
        shapes = (
            Box(tuple(rng.uniform(0.02, 0.04, 3))),
            Sphere(rng.uniform(0.02, 0.04)),
            Cylinder(rng.uniform(0.02, 0.035), rng.uniform(0.015, 0.04)),
            Capsule(rng.uniform(0.015, 0.03), rng.uniform(0.02, 0.04)),
        )
        at = (*rng.uniform(-side + 0.07, side - 0.07, 2), 0.1 + 0.09 * k)
        turn = Rotation.random(random_state=k).as_quat()
        things.append(Thing(shape=shapes[k % 4], at=at, turn=turn, material=("wood", "metal", "human")[k % 3]))
    for axis in range(2):
        for sign in (-1, 1):
            at, half = [0.0, 0.0, 3.0], [side + 0.04, side + 0.04, 3.0]
            at[axis], half[axis] = sign * (side + 0.02), 0.02
            things.append(Thing(shape=Box(tuple(half)), role=s.FIXED, at=at))
    player = Player([*things, floor()])
    energy = player.energy()
    for _ in range(240):
        player.step(1 / 60)
        assert player.energy() <= energy + 1e-9
        energy = player.energy()
    assert player.flags == 0
    assert player.overlap() < 1e-5
    # balls may go on to spin where they lie: a point has no friction against that
    assert np.abs(player.velocity[:50, :3]).max() < 0.05
    assert np.abs(player.poses[:50, :2]).max() < side


def test_hitting_the_bound_is_told_and_makes_no_momentum() -> None:
    balls = [Thing(shape=Sphere(0.02), at=(0.05 * k, 0, 0), v=(2.0 - k, 0, 0), material="rubber") for k in range(5)]
    player = Player(balls, gravity=(0, 0, 0))
    p = player.scene.bodies.mass @ player.velocity[:, :3]
    energy = player.energy()
    for _ in range(4):
        player.step(1 / 30, max_impacts=1)
    assert player.flags & FLAG_IMPACT_BOUND
    np.testing.assert_allclose(player.scene.bodies.mass @ player.velocity[:, :3], p, rtol=0, atol=1e-14)
    assert player.energy() <= energy
    assert player.overlap() < 1e-5


@pytest.mark.parametrize(("most", "told"), [(1, FLAG_IMPACT_BOUND), (500, 0)])
def test_more_slow_landings_than_a_frame_has_room_for_are_told(most: int, told: int) -> None:
    """They are no collisions, but each halts the motion; beyond the bound bodies wait where they are."""
    balls = [
        Thing(shape=Sphere(0.02), at=(0.041 * (k % 19), 0.041 * (k // 19), 0.02 + 1e-5 + 2e-7 * k), v=(0, 0, -0.03))
        for k in range(19**2)
    ]
    player = Player([*balls, floor()])
    energy = player.energy()
    player.step(1 / 240, most)
    assert player.flags == told
    assert player.impacts == 0
    assert player.energy() <= energy
    assert player.overlap() < 1e-5


def test_without_room_for_pairs_bodies_stay_and_it_is_told() -> None:
    player = Player([Thing(shape=Sphere(0.05), at=(0.1 * k, 0, 0.0505)) for k in range(4)] + [floor()])
    player.set_up(Capacity(pairs=2))
    before = player.poses.copy()
    player.step(1 / 60)
    assert player.flags & FLAG_TABLE_FULL
    assert np.array_equal(player.poses, before)


def test_a_body_that_is_not_finite_is_put_back_at_rest() -> None:
    player = Player([Thing(shape=Sphere(0.05), at=(0, 0, 1)), Thing(shape=Sphere(0.05), at=(1, 0, 1)), floor()])
    player.run(0.1)
    before = player.poses.copy()
    player.velocity[0, 1] = np.nan
    player.step(1 / 60)
    assert player.flags & FLAG_QUARANTINED
    assert np.array_equal(player.poses[0], before[0])
    assert not player.velocity[0].any()
    player.step(1 / 60)
    assert player.poses[0, 2] < before[0, 2]
    assert player.poses[1, 2] < before[1, 2]


def test_the_contacts_of_a_resting_body_carry_its_weight() -> None:
    for shape, low, rate in ((Box((0.1, 0.06, 0.03)), 0.03, 60), (Sphere(0.05), 0.05, 100)):
        player = Player([Thing(shape=shape, at=(0, 0, low)), floor()])
        for seconds in (0.1, 1.0):  # awake, then asleep
            player.run(seconds, rate)
            found = touches(player)
            assert (found["body_a"] == 0).all()
            assert (found["body_b"] == 1).all()
            np.testing.assert_allclose(found["normal"], [[0, 0, 1]] * len(found), atol=1e-12)
            assert np.abs(found["point"][:, 2]).max() < 1e-5
            assert found["depth"].max() < 1e-6
            weight = player.scene.bodies.mass[0] * GRAVITY / rate
            assert found["normal_impulse"].sum() == pytest.approx(weight, rel=1e-9)
            assert found["tangential_impulse"].max() < 1e-4 * weight
        assert player.simulation.bodies["activation"][0] == 0


def test_the_contact_of_a_bounce_carries_its_impulse() -> None:
    player = Player(
        [Thing(shape=Sphere(0.05), at=(0, 0, 0.5), v=(0, 0, -3), material="rubber"), floor("rubber")], gravity=(0, 0, 0)
    )
    while not player.impacts:
        player.step(1 / 60)
    contact = touches(player)[0]
    assert (contact["body_a"], contact["body_b"]) == (0, 1)
    assert contact["normal_impulse"] == pytest.approx(1.9 * 3 * player.scene.bodies.mass[0], rel=1e-12)
    assert contact["tangential_impulse"] == 0.0
    player.run(0.1)
    assert len(touches(player)) == 0


def test_a_sleeping_body_stays_bit_for_bit_and_wakes_when_hit() -> None:
    ball = Thing(shape=Sphere(0.03), at=(-0.8, 0, 0.03))
    player = Player([Thing(shape=Box((0.05, 0.05, 0.05)), at=(0, 0, 0.05)), ball, floor()])
    player.run(1.0)
    assert not player.simulation.bodies["activation"][:2].any()
    asleep = player.poses.copy()
    track = player.run(1.0)
    assert np.array_equal(track[-1], asleep)
    player.velocity[1, :3] = (2.5, 0, 0)
    player.run(1.0)
    assert player.poses[0, 0] > 1e-3


def test_a_sleeping_body_falls_when_its_support_goes() -> None:
    support = Thing(shape=Box((0.2, 0.2, 0.05)), role=s.FIXED, moving=True, at=(0, 0, -0.05))
    player = Player([Thing(shape=Box((0.05, 0.05, 0.05)), at=(0, 0, 0.05)), support])
    player.targets[1] = lambda _: (0, 0, -0.05, 0, 0, 0, 1)
    player.run(1.0)
    assert player.simulation.bodies["activation"][0] == 0
    gone = player.time
    player.targets[1] = lambda t: (2.0 * (t - gone) / 0.1, 0, -0.05, 0, 0, 0, 1)
    player.run(0.5)
    assert player.poses[0, 2] < -0.3


def test_a_body_moved_by_the_caller_wakes() -> None:
    player = Player([Thing(shape=Sphere(0.05), at=(0, 0, 0.05)), floor()])
    player.run(1.0)
    player.poses[0, 2] += 0.2
    player.run(0.1)
    assert player.velocity[0, 2] < -0.5


def test_many_still_objects_do_not_matter() -> None:
    things = [Thing(shape=Sphere(0.05), at=(0, 0, 0.05), v=(0.5, 0, 0)), floor()]
    crowd = [
        Thing(shape=Box((0.1, 0.1, 0.1)), role=s.FIXED, at=(k % 40 - 20.0, k // 40 + 1.0, 1.0)) for k in range(800)
    ]
    alone, among = Player(things), Player(things + crowd)
    assert np.array_equal(alone.run(1.0)[:, 0], among.run(1.0)[:, 0])


def test_a_scene_without_simulated_bodies_is_left_alone() -> None:
    player = Player([floor()])
    before = player.poses.copy()
    player.step(1 / 60)
    assert np.array_equal(player.poses, before)
    assert make_scene([floor()]).bodies.role[0] == s.FIXED


@pytest.mark.parametrize("rate", [30, 60])
@pytest.mark.parametrize("seed", range(3))
def test_the_contacts_of_a_tumbling_box_carry_all_that_the_floor_gave_it(seed: int, rate: int) -> None:
    """Whatever points come and go: the sum of the frames' normal impulses is m (Δv + g t)."""
    turn = Rotation.random(random_state=seed).as_quat()
    player = Player([Thing(shape=Box((0.05, 0.04, 0.03)), at=(0, 0, 0.3), turn=turn, w=(5, -8, 3)), floor()])
    given = 0.0
    for _ in range(rate):
        player.step(1.0 / rate)
        given += touches(player)["normal_impulse"].sum()
    gained = player.scene.bodies.mass[0] * (player.velocity[0, 2] + GRAVITY * player.time)
    assert given == pytest.approx(gained, rel=1e-6)
