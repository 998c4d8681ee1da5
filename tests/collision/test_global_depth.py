"""Equation (1) and the recorded penetration, against the Minkowski difference by scipy and numpy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from geomphys.collision.detect import Near, make_near
from geomphys.collision.global_depth import global_depths, make_global_depths
from geomphys.jit.packed_records import pack
from geomphys.numerics.transforms import apply
from geomphys.scene.pieces import PosedShape, Sphere, build_pieces
from tests.driven.logs import Engine, Run, Thing, play
from tests.scene.models import link, urdf

PARTS = ((0.1, 0.04, 0.06, "0 0 0"), (0.03, 0.12, 0.03, "0.05 0.02 0.04"), (0.05, 0.05, 0.1, "-0.04 -0.03 0.03"))


def depth_by_hull(a: np.ndarray, b: np.ndarray) -> tuple[float, np.ndarray] | None:
    """Depth [m] of two corner clouds and the normal out of b into a: the nearest face of the hull of A - B to 0."""
    faces = ConvexHull((a[:, None] - b[None]).reshape(-1, 3)).equations
    k = int(np.argmax(faces[:, 3]))
    return None if faces[k, 3] >= 0 else (-float(faces[k, 3]), -faces[k, :3])


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A link of three boxes and a hull, both recorded in and out of two fixed objects and each other, anywhere."""
    folder = tmp_path_factory.mktemp("depths")
    rng = np.random.default_rng(11)
    boxes = [
        f'<origin xyz="{at}" rpy="0.2 0.1 0.3"/><geometry><box size="{x} {y} {z}"/></geometry>' for x, y, z, at in PARTS
    ]
    urdf(folder / "hand.urdf", link("palm", *boxes))
    urdf(folder / "rack.urdf", link("rack", *boxes[1:]))
    avatar = '[[avatar]]\nname="hand"\nurdf="hand.urdf"\nmaterial="human"\nroot={topic="/palm"}\n'
    rack = '[[object]]\nname="rack"\nclass="fixed"\nurdf="rack.urdf"\nmaterial="wood"\nposition=[0.05,0.02,-0.05]\n'
    hull = rng.normal(size=(20, 3)).astype(np.float32).astype(float) * 0.03125

    def anywhere(n: int) -> np.ndarray:
        return np.hstack([rng.uniform(-0.07, 0.07, (n, 3)), Rotation.random(n, rng).as_quat()])

    return play(
        folder,
        [Thing(name="block", shape=("box", 0.08, 0.1, 0.05)), Thing(name="stone", shape=hull, role="driven", path=anywhere(40))],
        avatars=avatar + rack, roots={"/palm": anywhere(40)},
    )  # fmt: skip


def direct(run: Run, poses: np.ndarray) -> dict[tuple[int, int], tuple[np.ndarray, int, float]]:
    """Of each overlapping pair of bodies: PD_g, pairs of pieces, deepest."""
    pieces = run.world.scene.pieces
    engine = Engine(run.world)
    frames = engine.frames(poses)
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    clouds = []
    for k in range(len(pieces.kind)):
        corners = pieces.vertices[pieces.vertex_start[k] : pieces.vertex_start[k + 1]]
        clouds.append(apply(frames[k], corners if len(corners) else signs * pieces.size[k]))
    found: dict[tuple[int, int], list[tuple[float, np.ndarray]]] = {}
    for i, j in engine.pairs:
        pair = (int(pieces.body[i]), int(pieces.body[j]))
        hit = depth_by_hull(clouds[i], clouds[j])
        if hit is not None:
            found.setdefault(pair, []).append(hit)
    return {
        pair: (sum(d * d * n for d, n in hits) / sum(d for d, _ in hits), len(hits), max(d for d, _ in hits))
        for pair, hits in found.items()
    }


def test_global_depths_are_equation_1(run: Run) -> None:
    several = 0
    for result in run.results:
        expected = direct(run, result.recorded)
        p = result.penetrations
        found = {}
        for k in range(len(p.body_a)):
            pair, sign = (int(p.body_a[k]), int(p.body_b[k])), 1.0
            if pair[0] > pair[1]:
                pair, sign = pair[::-1], -1.0
            assert pair not in found
            found[pair] = (sign * p.pd[k], int(p.convex_pairs[k]), float(p.largest[k]))
        assert set(found) == set(expected)
        for pair, (pd, count, largest) in expected.items():
            assert found[pair][0] == pytest.approx(pd, abs=1e-8)
            assert found[pair][1] == count
            assert found[pair][2] == pytest.approx(largest, rel=1e-6)
            several += count > 1
    assert several > 30


def test_recorded_penetration_is_the_deepest_pair(run: Run) -> None:
    for result in run.results:
        expected = max((largest for _, _, largest in direct(run, result.recorded).values()), default=0.0)
        assert result.metrics.recorded_penetration_m == pytest.approx(expected, rel=1e-6)


def test_the_corrected_poses_are_free(run: Run) -> None:
    engine = Engine(run.world)
    assert max(engine.deepest(poses) for poses in run.corrected) <= 1e-5
    assert run.residual.max() <= 1e-5


PIECES = pack(build_pieces([PosedShape(Sphere(0.1), np.eye(4), body) for body in (0, 0, 0, 1, 1, 2, 2, 2, 3)]))
"""Nine pieces of four bodies."""


def random_contacts(rng: np.random.Generator, count: int) -> Near:
    """Pairs of pieces of different bodies, sorted by bodies; a third of them do not overlap."""
    body = np.asarray(PIECES.body)
    a, b = np.sort(rng.integers(0, len(body), (2, 4 * count)), axis=0)
    a, b = a[body[a] != body[b]][:count], b[body[a] != body[b]][:count]
    order = np.lexsort((body[b], body[a]))
    near = make_near(len(a))
    near.a[:], near.b[:], near.counts["filled"] = a[order], b[order], len(a)
    near.separation[:] = rng.uniform(-2e-2, 1e-2, len(a))
    normals = rng.normal(size=(len(a), 3))
    near.normal[:] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return near


def by_numpy(near: Near) -> dict[tuple[int, int], tuple[np.ndarray, int, float]]:
    """Equation (1) as it is printed: of each pair of bodies PD_g, the number of overlaps and the deepest."""
    n = int(near.counts["filled"])
    bodies = np.column_stack([PIECES.body[near.a[:n]], PIECES.body[near.b[:n]]])
    found = {}
    for pair in np.unique(bodies[near.separation[:n] < 0.0], axis=0):
        chosen = (bodies == pair).all(axis=1) & (near.separation[:n] < 0.0)
        pd = -near.separation[:n][chosen]
        value = (pd**2) @ near.normal[:n][chosen] / pd.sum()
        found[int(pair[0]), int(pair[1])] = (value, int(chosen.sum()), float(pd.max()))
    return found


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("count", [1, 3, 40])
def test_the_kernel_is_equation_1_on_random_contacts(seed: int, count: int) -> None:
    near, depths = random_contacts(np.random.default_rng(seed), count), make_global_depths(50)
    for array in depths:
        array[:] = 7  # of the frame before
    filled = global_depths(PIECES, pack(near), pack(depths))
    expected = by_numpy(near)
    assert [(int(depths.body_a[k]), int(depths.body_b[k])) for k in range(filled)] == sorted(expected)
    for k in range(filled):
        pd, pairs, largest = expected[int(depths.body_a[k]), int(depths.body_b[k])]
        assert depths.pd[k] == pytest.approx(pd, rel=1e-12, abs=1e-15)
        assert (depths.pairs[k], depths.largest[k]) == (pairs, largest)


def test_one_contact_gives_its_depth_along_its_normal_and_opposite_ones_cancel() -> None:
    near, depths = make_near(2), make_global_depths(2)
    near.a[:2], near.b[:2], near.counts["filled"] = (0, 1), (3, 4), 2
    near.separation[:2] = -0.01
    near.normal[:2] = (0, 0.6, 0.8), (0, -0.6, -0.8)
    assert global_depths(PIECES, pack(near), pack(depths)) == 1
    assert depths.pd[0].tolist() == [0.0, 0.0, 0.0]
    near.counts["filled"] = 1
    assert global_depths(PIECES, pack(near), pack(depths)) == 1
    assert depths.pd[0] == pytest.approx([0.0, 0.006, 0.008], rel=1e-14)


def test_touching_is_no_overlap() -> None:
    near, depths = make_near(1), make_global_depths(1)
    near.a[0], near.b[0], near.counts["filled"], near.normal[0] = 0, 3, 1, (1, 0, 0)
    assert global_depths(PIECES, pack(near), pack(depths)) == 0


def test_pairs_beyond_the_capacity_of_the_table_do_not_spoil_the_others() -> None:
    near = random_contacts(np.random.default_rng(3), 40)
    whole, small = make_global_depths(50), make_global_depths(2)
    assert global_depths(PIECES, pack(near), pack(whole)) > 2
    assert global_depths(PIECES, pack(near), pack(small)) == 2
    assert np.array_equal(small.pd, whole.pd[:2])
