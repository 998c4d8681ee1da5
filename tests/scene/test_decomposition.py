"""Convex pieces of meshes: they hold the mesh, stand out little, come out alike, and are kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from manifold3d import Manifold, OpType
from scipy.spatial import ConvexHull

from geomphys.errors import ConfigError, MeshError
from geomphys.scene import coacd_process, coverage, decomposition
from geomphys.scene.coverage import Surface, grow_to_cover, piece_protrusion, uncovered_distance, winding
from geomphys.scene.decomposition import Decomposed, DecompositionTask, decompose, decompose_all, default_threshold
from geomphys.scene.mass import of_mesh
from geomphys.scene.meshes import Mesh, load_mesh
from geomphys.scene.tessellation import merge_surfaces, sphere_triangles
from tests.scene.models import cube, ell
from tests.scene.test_convexity import cup


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of the test's own."""
    monkeypatch.setattr(decomposition, "user_cache_folder", lambda name: tmp_path)
    return tmp_path


def beyond(points: np.ndarray, hulls: tuple[np.ndarray, ...]) -> float:
    """How far the farthest of the points lies outside all hulls."""
    planes = [ConvexHull(h).equations for h in hulls]
    return float(np.max(np.min([np.max(points @ p[:, :3].T + p[:, 3], axis=1) for p in planes], axis=0)))


def spread(vertices: np.ndarray, faces: np.ndarray, count: int = 4000) -> np.ndarray:
    """Points all over a surface."""
    random = np.random.default_rng(1)
    weights = random.dirichlet([0.5, 0.5, 0.5], count)
    return np.einsum("nk,nkj->nj", weights, vertices[faces[random.integers(0, len(faces), count)]])


def table_of_boxes() -> Mesh:
    """A board on two legs as three closed parts."""
    board, left, right = ((cube()[0] * s + t, cube()[1]) for s, t in (
        (np.array([1.0, 0.6, 0.05]), [0, 0, 0.5]),
        (np.array([0.05, 0.05, 0.5]), [-0.4, 0, 0.225]),
        (np.array([0.05, 0.05, 0.5]), [0.4, 0, 0.225]),
    ))  # fmt: skip
    return Mesh("table", *merge_surfaces([board, left, right]))


def test_a_convex_mesh_is_its_hull() -> None:
    mesh = Mesh("ball", *sphere_triangles(0.1, 16))
    pieces = decompose(mesh)
    assert (pieces.method, len(pieces.hulls), pieces.uncovered_m) == ("hull", 1, 0.0)
    assert np.array_equal(pieces.hulls[0], mesh.vertices)
    assert decompose(mesh, "coacd").method == "hull"


def test_boxes_stuck_together_become_exactly_these_boxes() -> None:
    mesh = table_of_boxes()
    assert mesh.is_watertight
    pieces = decompose(mesh)
    assert pieces.method == "parts"
    assert [len(h) for h in pieces.hulls] == [8, 8, 8]
    assert sorted(ConvexHull(h).volume for h in pieces.hulls) == pytest.approx([0.00125, 0.00125, 0.03])


def test_a_hollow_is_not_filled_by_a_part_of_its_own() -> None:
    corners, faces = cube(0.1)
    shell = Mesh("shell", *merge_surfaces([(corners, faces), (0.5 * corners, faces[:, ::-1])]))
    assert shell.signed_volume == pytest.approx(0.008 * (1 - 0.5**3))
    assert decomposition._closed_parts(shell) == [shell]


def test_an_l_is_held_by_its_pieces_and_fills_no_notch(own_cache: Path) -> None:
    mesh = Mesh("ell", *ell())
    said: list[tuple[str, float]] = []
    pieces = decompose(mesh, progress=lambda what, share: said.append((what, share)))
    assert pieces.method == "coacd"
    assert not pieces.cached
    assert 2 <= len(pieces.hulls) <= 4
    assert beyond(spread(mesh.vertices, mesh.faces), pieces.hulls) < 1e-9
    assert piece_protrusion(mesh.vertices, mesh.faces, pieces.hulls) < 1e-3
    assert sum(ConvexHull(h).volume for h in pieces.hulls) == pytest.approx(0.003, rel=0.01)
    assert said[0] == ("convex decomposition of ell (1 of 1)", 0.0)
    assert said[-1][1] == 1.0

    again = decompose(mesh)
    assert again.cached
    same(again, pieces)
    for file in own_cache.iterdir():
        file.write_bytes(file.read_bytes()[:100])  # a damaged cache costs time, not the answer
    repaired = decompose(mesh)
    assert not repaired.cached
    same(repaired, pieces)
    assert decompose(mesh, seed=1).cached is False
    assert decompose(mesh, threshold=0.3).cached is False


def same(a: Decomposed, b: Decomposed) -> None:
    assert len(a.hulls) == len(b.hulls)
    assert all(np.array_equal(x, y) for x, y in zip(a.hulls, b.hulls, strict=True))


def ells(count: int) -> list[DecompositionTask]:
    """L shapes of different sizes."""
    corners, faces = ell()
    return [DecompositionTask(Mesh(f"ell {k}", corners * (1 + 0.2 * k), faces), "auto") for k in range(count)]


def test_how_many_processes_cut_changes_no_piece(own_cache: Path) -> None:
    meshes = ells(3)
    together = decompose_all(meshes, processes=3)
    for file in own_cache.iterdir():
        file.unlink()
    one_by_one = decompose_all(meshes[::-1], processes=1)[::-1]
    for file in own_cache.iterdir():
        file.unlink()
    alone = decompose_all(meshes[:1], processes=4)  # with four threads
    for a, b in zip((*together, together[0]), (*one_by_one, alone[0]), strict=True):
        assert not b.cached
        same(a, b)


def test_what_was_cut_before_an_interruption_is_kept(own_cache: Path) -> None:
    said: list[str] = []

    def interrupt(what: str, share: float) -> None:
        said.append(what)
        if share > 0.3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        decompose_all(ells(3), processes=1, progress=interrupt)
    assert said[0] == "convex decomposition of ell 0 (1 of 3)"
    left = decompose_all(ells(3), processes=1)
    assert [pieces.cached for pieces in left] in ([True, False, False], [True, True, False])


def test_meshes_of_the_cache_start_nothing_and_say_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    decompose_all(ells(2))
    monkeypatch.setattr(coacd_process.subprocess, "Popen", lambda *_, **__: pytest.fail("a process was started"))
    monkeypatch.setattr(decomposition, "is_nearly_convex", lambda *_: pytest.fail("measured again"))
    again = decompose_all(ells(2), progress=lambda what, share: pytest.fail(f"said {what}"))
    assert all(pieces.cached for pieces in again)


def test_the_same_mesh_twice_is_cut_once(monkeypatch: pytest.MonkeyPatch) -> None:
    runs: list[str] = []
    cut = decomposition._decompose_job
    monkeypatch.setattr(
        decomposition, "_decompose_job", lambda job, *more: runs.append(job.mesh.name) or cut(job, *more)
    )
    first, second = decompose_all(ells(1) * 2)
    assert runs == ["ell 0"]
    same(first, second)


def test_a_mesh_that_fails_ends_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(coacd_process, "_run_until_exit", lambda *_: -11)
    with pytest.raises(MeshError, match="ell 0: convex decomposition failed"):
        decompose_all(ells(3), processes=1)


def test_a_ball_with_a_shallow_dent_is_its_hull_without_coacd(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(coacd_process, "_run_until_exit", lambda *_: pytest.fail("CoACD was started"))
    corners, faces = sphere_triangles(0.1, 32)
    corners = corners.copy()
    corners[-1, 2] -= (
        0.003  # 1.1 mm below the ring around it: less than the threshold's 2 mm, and more than CONVEX_SLACK
    )
    mesh = Mesh("dented", corners, faces)
    assert not mesh.is_convex
    pieces = decompose(mesh)
    assert (pieces.method, len(pieces.hulls)) == ("hull", 1)
    assert np.array_equal(pieces.hulls[0], mesh.hull_vertices)


def test_a_cylinder_with_a_screw_hole_is_its_hull_without_coacd(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(coacd_process, "_run_until_exit", lambda *_: pytest.fail("CoACD was started"))
    mesh = cup(0.0012, 0.02)
    pieces = decompose(mesh)
    assert (pieces.method, len(pieces.hulls)) == ("hull", 1)
    assert np.array_equal(pieces.hulls[0], mesh.hull_vertices)


def test_the_hull_of_anything_on_request() -> None:
    corners, faces = ell()
    pieces = decompose(Mesh("open", corners, faces[3:]), "hull")
    assert (pieces.method, len(pieces.hulls)) == ("hull", 1)
    with pytest.raises(MeshError, match="open: is neither watertight nor convex"):
        decompose(Mesh("open", corners, faces[3:]))


def test_the_threshold_is_a_share_of_the_size_within_bounds_in_metres() -> None:
    def half(length: float) -> float:
        mesh = Mesh("ell", ell()[0] * length / 0.1, ell()[1])
        return default_threshold(mesh) * length

    assert half(0.1) == pytest.approx(2e-3)
    assert half(0.03) == pytest.approx(1e-3)
    assert half(0.4) == pytest.approx(5e-3)
    assert half(2.0) == pytest.approx(0.02)  # CoACD goes no finer
    assert half(1e-4) == pytest.approx(1e-4)
    with pytest.raises(ConfigError, match=r"threshold = 0\.001"):
        decompose(Mesh("ell", *ell()), threshold=0.001)


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ([], "gave no pieces|left"),
        ([np.full((4, 3), np.nan)], "NaN"),
    ],
)
def test_what_coacd_fails_at_is_told(monkeypatch: pytest.MonkeyPatch, parts: list[np.ndarray], says: str) -> None:
    def broken(command: list[str], *_: object) -> int:
        starts = np.concatenate([[0], np.cumsum([len(p) for p in parts])]).astype(np.int64)
        np.savez(command[-2], points=np.concatenate([np.zeros((0, 3)), *parts]), starts=starts)
        return 0

    monkeypatch.setattr(coacd_process, "_run_until_exit", broken)
    with pytest.raises(MeshError, match=says) as caught:
        decompose(Mesh("ell", *ell()))
    assert 'decomposition = "hull"' in str(caught.value)


def test_a_crash_of_coacd_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(coacd_process, "_run_until_exit", lambda *_: -11)
    with pytest.raises(MeshError, match="CoACD ended with -11"):
        decompose(Mesh("ell", *ell()))


def two_halves(gap: float) -> list[np.ndarray]:
    """A cube of 1 m cut at x = 0 into halves that leave a gap there and fall short of its corners."""
    corners = cube()[0]
    left, right = corners * [0.5, 1, 1] - [0.25, 0, 0], corners * [0.5, 1, 1] + [0.25, 0, 0]
    return [left * (1 - gap), right * (1 - gap)]


def test_bare_surface_is_found_and_covered() -> None:
    corners, faces = cube()
    pieces = two_halves(1e-3)
    bare = uncovered_distance(corners, faces, pieces)
    assert bare == pytest.approx(0.5e-3, rel=0.05)
    grown = grow_to_cover(corners, faces, pieces)
    assert uncovered_distance(corners, faces, grown) == 0.0
    assert beyond(spread(corners, faces), tuple(grown)) < 1e-9
    assert sum(ConvexHull(g).volume for g in grown) == pytest.approx(1.0, rel=5e-3)


def test_pieces_that_hold_the_surface_are_left_alone() -> None:
    corners, faces = cube()
    pieces = [np.array(p) for p in two_halves(0.0)]
    for grown, piece in zip(grow_to_cover(corners, faces, pieces), pieces, strict=True):
        np.testing.assert_allclose(np.ptp(grown, axis=0), np.ptp(piece, axis=0), atol=4e-4)
    assert uncovered_distance(corners, faces, pieces) == 0.0


def test_pieces_grow_no_farther_than_to_the_surface() -> None:
    """A bar of twelve triangles in ten pieces that fall short of it all around: its walls go to all, not to one."""
    corners, faces = cube()
    bar = corners * [10.0, 1.0, 1.0]
    pieces = [corners * [1.0, 0.99, 0.99] + [k - 4.5, 0.0, 0.0] for k in range(10)]
    grown = grow_to_cover(bar, faces, pieces, 0.011)
    assert uncovered_distance(bar, faces, grown) == 0.0
    assert beyond(spread(bar, faces), tuple(grown)) < 1e-9
    assert max(np.ptp(g[:, 0]) for g in grown) < 1.1
    assert sum(ConvexHull(g).volume for g in grown) < 10.0 * 1.05


def test_what_is_far_from_all_pieces_is_told_bare() -> None:
    corners, faces = cube()
    bare = uncovered_distance(corners, faces, two_halves(0.0)[:1])
    assert bare == pytest.approx(0.5, rel=1e-6)
    assert uncovered_distance(*cube(), [0.9 * corners]) == pytest.approx(0.05, rel=1e-3)


def test_how_far_pieces_stand_out() -> None:
    corners, faces = ell()
    hull = [corners]  # stands over the notch, the middle of its slope 0.05 m off both walls
    assert piece_protrusion(corners, faces, hull) == pytest.approx(0.05, rel=0.02)
    assert piece_protrusion(*cube(), [cube()[0] * 1.1]) == pytest.approx(0.05 * np.sqrt(3), rel=0.1)
    assert piece_protrusion(*cube(), [cube()[0]]) == 0.0


def test_pieces_that_stand_out_by_less_than_asked_for_count_as_none() -> None:
    corners, faces = ell()
    found = piece_protrusion(corners, faces, [corners])
    assert piece_protrusion(corners, faces, [corners], beyond=0.99 * found) == found
    assert piece_protrusion(corners, faces, [corners], beyond=1.01 * found) == 0.0


def test_which_side_points_are_on_is_asked_once_a_free_ball() -> None:
    random = np.random.default_rng(3)
    vertices, faces = sphere_triangles(0.1, 24)
    points = random.uniform(-0.2, 0.2, (300, 3))
    away = Surface(vertices, faces).distance(points)
    asked: list[int] = []

    def counted(*args: np.ndarray) -> np.ndarray:
        asked.append(len(args[2]))
        return winding(*args)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(coverage, "winding", counted)
        outside = coverage._are_outside(vertices, faces, points, away)
    assert np.array_equal(outside, winding(vertices, faces, points) < 0.5)
    assert 0 < np.sum(outside) < len(points)
    assert sum(asked) < len(points)


@pytest.mark.slow
def test_the_pillow(shared_dir: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()  # the user's cache: it takes long
    mesh = load_mesh(shared_dir / "models" / "dfki_pillow" / "pillow_small.stl")
    pieces = decompose(mesh)
    assert len(pieces.hulls) <= 30
    assert pieces.uncovered_m == 0.0
    assert beyond(spread(mesh.vertices, mesh.faces, 5_000), pieces.hulls) < 1e-8
    assert piece_protrusion(mesh.vertices, mesh.faces, pieces.hulls, samples=600) < 4e-3
    solids = [Manifold.hull_points(hull) for hull in pieces.hulls]  # hulls of one body may overlap each other
    union = Manifold.batch_boolean(solids, OpType.Add).volume()
    assert union == pytest.approx(of_mesh(mesh.vertices, mesh.faces, 1.0).mass, rel=0.02)
