"""Contact contacts solved together: groups by a graph library, forces by non-negative least squares, friction by its cone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from geomphys.scene.arrays import SIMULATED
from geomphys.scene.pieces import Box, Sphere
from geomphys.simulated.contact_solver import (
    HEAP_VISITS,
    add_reversal,
    begin_contact,
    disturb,
    extrapolated_impulse,
    group_contacts,
    group_of,
    is_disturbed,
    solve_contacts,
    solve_normals,
)
from geomphys.simulated.motion import load_velocities
from tests.simulated.scenes import Player, Thing, floor
from tests.simulated.stages import Stage

CUBE = Box((0.05, 0.05, 0.05))


def resting(seed: int, cubes: int, friction: float) -> Stage:
    """Stacks of two cubes beside each other, in random motion; targets are zero."""
    rng = np.random.default_rng(seed)
    things = [
        Thing(shape=CUBE, at=(0.3 * (k // 2), 0, 0.05 + 0.1000004 * (k % 2)), mass=float(rng.uniform(0.5, 2.0)))
        for k in range(cubes)
    ]
    stage = Stage(Player([*things, floor()]))
    stage.call(load_velocities)
    velocity = stage.player.simulation.velocity
    velocity[:cubes] = rng.normal(size=(cubes, 6)) * [0.5, 0.5, 1, 0.5, 0.5, 0.5]
    velocity[:cubes:2, 2] = -abs(velocity[:cubes:2, 2])  # the lower ones fall
    contacts = stage.contacts
    contacts["mode"], contacts["friction"], contacts["speed"], contacts["target_speed"] = 1, friction, 1.0, 0.0
    contacts["normal_impulse"], contacts["tangent_impulse"] = 0.0, 0.0
    return stage


def jacobian(stage: Stage, names: tuple[str, ...]) -> np.ndarray:
    """(n, 6 B) of the velocities along directions of the contacts."""
    contacts, bodies = stage.contacts, len(stage.bodies)
    out = np.zeros((len(names) * len(contacts), 6 * bodies))
    for k, (r, name) in enumerate((r, name) for r in contacts for name in names):
        for body, arm, sign in ((int(r["a"]), r["arm_a"], 1.0), (int(r["b"]), r["arm_b"], -1.0)):
            if stage.bodies["role"][body] == SIMULATED:
                out[k, 6 * body : 6 * body + 6] = sign * np.array([*r[name], *np.cross(arm, r[name])])
    return out


def root_of_masses(stage: Stage) -> np.ndarray:
    """(6 B, 6 B) square root of the mass matrix; 1 for bodies that are not simulated."""
    root = np.eye(6 * len(stage.bodies))
    for body in np.flatnonzero(stage.bodies["role"] == SIMULATED):
        m = stage.motion[body]
        values, vectors = np.linalg.eigh(np.linalg.inv(m["inverse_inertia"].reshape(3, 3)))
        at = 6 * body
        root[at : at + 3, at : at + 3] = np.sqrt(m["mass"]) * np.eye(3)
        root[at + 3 : at + 6, at + 3 : at + 6] = vectors @ np.diag(np.sqrt(values)) @ vectors.T
    return root


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("cubes", [1, 2, 4])
@pytest.mark.parametrize("normals_first", [False, True])
def test_without_friction_velocities_are_the_nearest_that_no_contact_forbids(
    seed: int, cubes: int, normals_first: bool
) -> None:
    """In the metric of the masses (Gauss): non-negative least squares gives the same."""
    stage = resting(seed, cubes, 0.0)
    before = stage.player.simulation.velocity.ravel().copy()
    root, normals = root_of_masses(stage), jacobian(stage, ("normal",))
    force, _ = nnls(np.linalg.solve(root, normals.T), -root @ before, maxiter=1000)
    expected = before + np.linalg.solve(root @ root, normals.T @ force)
    stage.call(solve_contacts, 2000, 0.0, normals_first)
    after = stage.player.simulation.velocity.ravel()
    assert after == pytest.approx(expected, abs=2e-5)
    assert (stage.contacts["normal_impulse"] >= 0.0).all()
    assert (normals @ after >= -2e-5).all()


@pytest.mark.parametrize("seed", range(4))
def test_friction_is_in_its_cone_and_sticks_or_opposes_the_sliding_with_all_of_it(seed: int) -> None:
    stage = resting(seed, 4, 0.3)
    stage.call(solve_contacts, 4000, 0.0, False)
    v = (jacobian(stage, ("tangent", "binormal")) @ stage.player.simulation.velocity.ravel()).reshape(-1, 2)
    p, j = stage.contacts["normal_impulse"], stage.contacts["tangent_impulse"]
    size, speed = np.linalg.norm(j, axis=1), np.linalg.norm(v, axis=1)
    assert (size <= 0.3 * p * (1.0 + 1e-9)).all()
    sliding = (speed > 1e-3) & (p > 1e-6)
    assert sliding.any()
    assert size[sliding] == pytest.approx(0.3 * p[sliding], rel=1e-3)
    assert np.einsum("ij,ij->i", v, j)[sliding] == pytest.approx(-(size * speed)[sliding], rel=1e-2)


def test_momentum_of_bodies_that_press_each_other_is_kept() -> None:
    """In a stack that falls as one no force acts but between the two."""
    things = [Thing(shape=CUBE, at=(0, 0, 0.05 + 0.1000004 * k)) for k in range(2)]
    stage = Stage(Player(things))
    stage.call(load_velocities)
    velocity = stage.player.simulation.velocity
    velocity[:] = np.random.default_rng(0).normal(size=(2, 6))
    velocity[0, 2], velocity[1, 2] = 1.0, -1.0
    before = stage.motion["mass"] @ velocity[:, :3]
    stage.contacts["mode"], stage.contacts["speed"] = 1, 1.0
    stage.call(solve_contacts, 400, 0.0, False)
    assert stage.contacts["normal_impulse"].sum() > 0.1
    assert stage.motion["mass"] @ velocity[:, :3] == pytest.approx(before, abs=1e-12)


def test_visits_to_the_contacts_of_a_large_heap_are_bounded() -> None:
    """Fifty cubes face to face, too slow to be left after `STACK_SWEEPS`."""
    cubes = [Thing(shape=CUBE, at=(0.1 * (k % 5), 0.1 * (k // 5 % 5), 0.05 + 0.1 * (k // 25))) for k in range(50)]
    stage = Stage(Player([*cubes, floor()]))
    stage.call(load_velocities)
    stage.player.simulation.velocity[:50] = 0.1 * np.random.default_rng(0).normal(size=(50, 6))
    stage.contacts["mode"], stage.contacts["speed"], stage.contacts["target_speed"] = 1, 0.01, 0.0
    stage.call(solve_contacts, 400, 0.0, False)
    assert HEAP_VISITS / 400 < len(stage.contacts) < HEAP_VISITS / 100
    assert 0.9 * HEAP_VISITS < stage.contacts["visit"].max() <= HEAP_VISITS


def test_slow_groups_are_left_out() -> None:
    stage = resting(0, 4, 0.0)
    first = np.isin(stage.contacts["a"], (0, 1))
    stage.contacts["speed"] = np.where(first, 0.5, 2.0)
    stage.call(solve_contacts, 100, 1.0, False)
    assert (stage.contacts["normal_impulse"][first] == 0.0).all()
    assert (stage.contacts["normal_impulse"][~first] > 0.0).any()


@pytest.mark.parametrize("seed", range(10))
def test_groups_are_the_connected_components_of_the_rows(seed: int) -> None:
    """Contacts between random bodies; what is not simulated connects nothing, and contacts that are left out do not either."""
    rng = np.random.default_rng(seed)
    balls, contacts = 9, 8
    stage = Stage(Player([*(Thing(shape=Sphere(0.05), at=(0.2 * k, 0, 0.05)) for k in range(balls)), floor()]))
    stage.player.simulation.counts["contacts"] = contacts
    a = rng.integers(0, balls, contacts)
    b = np.array([balls if rng.random() < 0.4 else rng.choice(np.setdiff1d(np.arange(balls), [x])) for x in a])
    stage.contacts["a"], stage.contacts["b"], stage.contacts["mode"] = a, b, rng.choice([0, 1], contacts, p=[0.2, 0.8])
    solved = np.flatnonzero(stage.contacts["mode"] == 1)
    edges = solved[b[solved] < balls]
    graph = coo_matrix((np.ones(len(edges)), (a[edges], b[edges])), shape=(balls, balls))
    _, label = connected_components(graph, directed=False)
    stage.call(group_contacts)
    bodies, order = stage.bodies, stage.player.simulation.order
    seen: list[int] = []
    for body in range(balls):
        group = int(stage.call(group_of, body))  # type: ignore[call-overload]
        assert group == np.flatnonzero(label == label[body])[0]  # its first body
        if group != body:
            assert bodies["contact_count"][body] == 0
            continue
        end, count = int(bodies["contact_end"][body]), int(bodies["contact_count"][body])
        own = order[end - count : end].tolist()
        assert own == [k for k in solved if label[a[k]] == label[body]]  # in their order
        seen += own
    assert sorted(seen) == solved.tolist()


def test_a_row_is_visited_again_only_after_one_of_its_bodies_was_disturbed() -> None:
    stage = resting(0, 2, 0.0)
    sim, contacts = stage.sim, stage.contacts
    between = contacts[np.flatnonzero((contacts["a"] < 2) & (contacts["b"] < 2))[0]]
    stage.bodies["disturbed"] = 0
    for r in contacts:
        r["visit"] = 5
    ground = contacts[np.flatnonzero(contacts["b"] == 2)[0]]
    assert not is_disturbed(sim, ground)
    disturb(sim, between, 6)
    assert is_disturbed(sim, ground)  # it shares the lower cube
    assert stage.bodies["disturbed"].tolist() == [6, 6, 0]
    disturb(sim, ground, 7)
    assert stage.bodies["disturbed"].tolist() == [7, 6, 0]  # the floor is not disturbed


def test_an_extrapolated_impulse_goes_on_as_before_within_its_bounds() -> None:
    stage = resting(0, 1, 0.5)
    r = stage.contacts[0]
    r["normal_impulse"], r["tangent_impulse"] = 2.0, (0.2, 0.1)
    begin_contact(r)
    r["normal_impulse"], r["tangent_impulse"] = 3.0, (0.3, -0.1)
    assert extrapolated_impulse(r, 0.5) == pytest.approx((3.5, 0.35, -0.2))
    assert r["previous_impulse"] == pytest.approx([3.0, 0.3, -0.1])
    assert r["normal_impulse"] == 3.0  # not set yet
    r["normal_impulse"], r["tangent_impulse"] = 1.0, (0.9, 0.0)
    n, t, b = extrapolated_impulse(r, 1.0)  # -1 would pull, and no normal force means no friction
    assert (n, t, b) == (0.0, 0.0, 0.0)
    r["normal_impulse"], r["tangent_impulse"] = 1.0, (0.9, 0.0)
    n, t, b = extrapolated_impulse(r, 1.0)
    assert (n, t, b) == pytest.approx((1.0, 0.5, 0.0))
    r["impulse_limit"], r["previous_impulse"] = 1.2, (0.0, 0.0, 0.0)
    assert extrapolated_impulse(r, 1.0)[0] == 1.2


def test_a_reversal_is_the_work_of_the_change_against_the_extrapolation() -> None:
    """Σ mass⁻¹ (extrapolated - now)·(now - before): positive where a sweep went back on it."""
    stage = resting(0, 1, 0.5)
    r = stage.contacts[0]
    r["extrapolated"], r["previous_impulse"] = (2.0, 0.3, 0.0), (1.0, 0.1, -0.2)
    r["normal_impulse"], r["tangent_impulse"] = 1.5, (0.2, 0.1)
    normal = (2.0 - 1.5) * (1.5 - 1.0) * r["inverse_mass_n"]
    tangential = ((0.3 - 0.2) * (0.2 - 0.1) + (0.0 - 0.1) * (0.1 + 0.2)) * r["inverse_mass_most"]
    assert add_reversal(0.25, r) == pytest.approx(0.25 + normal + tangential, rel=1e-12)


def test_normal_forces_are_found_first_only_where_none_is_known() -> None:
    for known in (False, True):
        stage = resting(1, 1, 0.0)
        stage.player.simulation.velocity[0] = (0, 0, -1, 0, 0, 0)
        stage.call(group_contacts)
        count = len(stage.contacts)
        if known:
            stage.contacts["tangent_impulse"][0] = (1e-9, 0.0)
        stage.call(solve_normals, 0, count)
        total = stage.contacts["normal_impulse"].sum()
        assert total == pytest.approx(0.0 if known else stage.motion["mass"][0], abs=1e-9)
