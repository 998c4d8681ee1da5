"""The least-distance solver against an exhaustive search over active sets."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from geomphys.driven.least_distance import (
    INFEASIBLE,
    SOLVED,
    begin_least_distance,
    make_least_distance,
    satisfy_rows,
)


def exhaustive(rows, bounds, goal):
    """The nearest feasible point over every choice of rows that hold with equality; None if there is none."""
    best = None
    for size in range(min(rows.shape) + 1):
        for chosen in itertools.combinations(range(len(rows)), size):
            active = rows[list(chosen)]
            if size and np.linalg.matrix_rank(active) < size:
                continue
            x = (
                goal + active.T @ np.linalg.solve(active @ active.T, bounds[list(chosen)] - active @ goal)
                if size
                else goal
            )
            if (rows @ x >= bounds - 1e-9).all() and (best is None or np.sum((x - goal) ** 2) < best[0]):
                best = np.sum((x - goal) ** 2), x
    return None if best is None else best[1]


def solve(rows, bounds, goal):
    m, n = rows.shape
    problem = make_least_distance(n + 2, m + 3)
    problem.rows[:m, :n], problem.rhs[:m], problem.x[:n] = rows, bounds, goal
    begin_least_distance(problem, m)
    status, active = satisfy_rows(problem, n, m, 1e-12, 0)
    return status, problem.x[:n].copy(), active


def random_problem(seed):
    rng = np.random.default_rng(seed)
    n, m = rng.integers(1, 5), rng.integers(1, 8)
    rows = rng.normal(size=(m, n))
    if seed % 3 == 0 and m > 1:
        rows[1] = rows[0] * rng.choice([1, -1])
    if seed % 5 == 0:
        rows = np.round(rows)
        rows[~rows.any(axis=1), 0] = 1
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    return rows, rng.normal(size=m), rng.normal(size=n)


def test_equals_the_exhaustive_search():
    infeasible = 0
    for seed in range(1500):
        rows, bounds, goal = random_problem(seed)
        truth = exhaustive(rows, bounds, goal)
        status, x, _ = solve(rows, bounds, goal)
        if truth is None:
            infeasible += 1
            assert status == INFEASIBLE, seed
        else:
            assert status == SOLVED, seed
            assert x == pytest.approx(truth, rel=1e-7, abs=1e-8), seed
    assert infeasible > 100


def test_a_feasible_goal_comes_back_bit_for_bit():
    rows, _, goal = random_problem(7)
    bounds = rows @ goal - 1e-3
    status, x, active = solve(rows, bounds, goal)
    assert (status, active) == (SOLVED, 0)
    assert np.array_equal(x, goal)


def test_a_corridor_with_no_room_is_infeasible():
    rows = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    assert solve(rows, np.array([1.0, -0.5]), np.zeros(3))[0] == INFEASIBLE
    assert solve(rows, np.array([1.0, -1.5]), np.zeros(3))[0] == SOLVED
