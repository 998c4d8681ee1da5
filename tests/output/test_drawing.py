"""Normals, points of view and the columns behind the pictures."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from geomphys.output.camera import ContactFrame, choose_viewpoint
from geomphys.output.colours import colour_of_material
from geomphys.output.contact_arrows import (
    ARROW_SCALE,
    FORCE_SCALE,
    MAX_ARROW_LENGTH,
    MIN_ARROW_LENGTH,
    arrow_lengths,
    frame_durations,
)
from geomphys.output.frame_columns import changed_rows, rows_with_content
from geomphys.output.vertex_normals import with_vertex_normals
from geomphys.results import Contacts
from tests.output.made_world import box


def corners(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    return vertices[faces].reshape(-1, 3)


def test_a_box_has_the_normals_of_its_faces() -> None:
    vertices, faces = box((1.0, 2.0, 3.0))
    points, indices, normals = with_vertex_normals(vertices, faces)
    assert np.array_equal(corners(points, indices), corners(vertices, faces)), "the triangles stay"
    assert len(points) == 24, "three copies of each corner"
    a, b, c = (points[indices[:, i]] for i in range(3))
    flat = np.cross(b - a, c - a)
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    assert normals[indices] == pytest.approx(np.repeat(flat[:, None], 3, axis=1))


def test_a_sphere_has_the_normals_of_its_points() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=3)
    points, indices, normals = with_vertex_normals(np.asarray(sphere.vertices), np.asarray(sphere.faces))
    assert len(points) == len(sphere.vertices), "no edge is sharp"
    assert np.einsum("ij,ij->i", normals, points).min() > 0.999
    assert np.array_equal(corners(points, indices), corners(sphere.vertices, sphere.faces))


def test_vertices_that_are_not_shared_are_smoothed_too() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=2)
    soup = corners(sphere.vertices, sphere.faces)
    points, _, _ = with_vertex_normals(soup, np.arange(len(soup)).reshape(-1, 3))
    assert len(points) == len(sphere.vertices)


def test_empty_and_flat_triangles_have_finite_normals() -> None:
    assert [len(part) for part in with_vertex_normals(np.zeros((0, 3)), np.zeros((0, 3), np.int64))] == [0, 0, 0]
    _, _, normals = with_vertex_normals(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    assert np.isfinite(normals).all()


def sees(eye: np.ndarray, point: np.ndarray, triangles: np.ndarray) -> bool:
    mesh = trimesh.Trimesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), process=False)
    way = point - eye
    hits, _, _ = mesh.ray.intersects_location([eye], [way])
    return all(np.dot(hit - eye, way) > 0.97 * np.dot(way, way) for hit in hits)


@pytest.mark.parametrize("open_side", [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)])
def test_the_eye_looks_into_a_room_from_its_open_side(open_side: tuple[int, int, int]) -> None:
    vertices, faces = box((4.0, 4.0, 2.0))
    triangles = vertices[faces]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    triangles = triangles[normals @ np.array(open_side) <= 0]
    points = np.random.default_rng(0).uniform(-0.9, 0.9, (100, 3)) * np.array([1.9, 1.9, 0.5])
    eye = choose_viewpoint(points, triangles)
    assert eye.position @ np.array(open_side) > 0
    assert np.mean([sees(eye.position, p, triangles) for p in points]) > 0.8
    assert np.allclose(eye.target, 0, atol=0.2)


@pytest.mark.parametrize("side", [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)])
def test_the_eye_sees_a_touch_past_the_body_that_touches(side: tuple[int, int, int]) -> None:
    outwards = np.array(side, float)
    across = np.array([-outwards[1], outwards[0], 0.0])
    up = np.array([0.0, 0.0, 3.0])
    a, b, c, d = (0.4 * outwards + s * 3.0 * across + t * up for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    moment = ContactFrame(np.zeros((1, 3)), np.array([[a, b, c], [a, c, d]]))
    points = np.array([[-1.0, -1.0, -0.2], [1.0, 1.0, 0.2]])
    assert choose_viewpoint(points, np.zeros((0, 3, 3)), [moment]).position @ outwards < 0.4


def test_the_eye_keeps_clear_of_walls() -> None:
    vertices, faces = box((0.2, 8.0, 8.0))
    walls = [(vertices + np.array([x, 0.0, 0.0]))[faces] for x in (-1.3, 1.3)]
    points = np.random.default_rng(1).uniform(-0.6, 0.6, (100, 3))
    eye = choose_viewpoint(points, np.concatenate(walls))
    assert abs(eye.position[0]) < 0.7


def test_the_eye_is_somewhere_even_in_an_empty_world() -> None:
    for points, triangles in (
        (np.zeros((0, 3)), np.zeros((0, 3, 3))),
        (np.ones((1, 3)), np.zeros((0, 3, 3))),
        (np.zeros((0, 3)), np.ones((1, 3, 3))),
    ):
        eye = choose_viewpoint(points, triangles)
        assert np.isfinite(eye.position).all()
        assert np.linalg.norm(eye.position - eye.target) > 0.1


@settings(max_examples=50)
@given(st.lists(st.integers(0, 2), min_size=1, max_size=12), st.integers(0, 2), st.integers(1, 5))
def test_what_is_sent_shows_what_is(values: list[int], before: int, size: int) -> None:
    """Whatever the batches, a viewer that keeps the last value sees every value, and nothing is sent twice."""
    shown, kept, sent = before, before, []
    for start in range(0, len(values), size):
        batch = np.array(values[start : start + size]).reshape(-1, 1)
        rows = set(np.flatnonzero(changed_rows(batch, np.array([kept]))).tolist())
        for row, value in enumerate(batch[:, 0].tolist()):
            if row in rows:
                assert value != shown, "a change"
                shown = value
                sent.append(value)
            assert shown == value
        kept = int(batch[-1, 0])
    assert changed_rows(np.array(values).reshape(-1, 1), None)[0], "the first row of all is sent"


@given(st.lists(st.integers(0, 3), min_size=1, max_size=12), st.integers(0, 3))
def test_rows_that_hold_or_end_something(held: list[int], before: int) -> None:
    rows, counts = rows_with_content(np.array(held), before)
    found = dict(zip(rows.tolist(), counts.tolist(), strict=True))
    shown = before
    for row, count in enumerate(held):
        shown = found.get(row, shown)
        assert shown == count
    assert sum(counts) == sum(held)


def contacts(depths: list[float], impulses: list[float]) -> Contacts:
    count = len(depths)
    bodies, vectors = np.zeros(count, np.int64), np.zeros((count, 3))
    return Contacts(bodies, bodies, vectors, vectors, np.array(depths), np.array(impulses), np.zeros(count))


def test_arrows_grow_with_the_force_at_every_frame_rate() -> None:
    for rate in (30.0, 240.0):
        some = contacts([5e-3, 5e-3, 0.0, 0.0], [0.0, 1.0 / rate, 3.0 / rate, 1e9])
        lengths = arrow_lengths(some, np.full(4, 1.0 / rate))
        pressed = [MIN_ARROW_LENGTH + FORCE_SCALE * 1.0, MIN_ARROW_LENGTH + FORCE_SCALE * 3.0, MAX_ARROW_LENGTH]
        assert lengths == pytest.approx([MIN_ARROW_LENGTH + ARROW_SCALE * 5e-3, *pressed])


def test_frames_last_since_the_one_before() -> None:
    assert frame_durations(np.array([5, 7, 10]), None).tolist() == pytest.approx([0.0, 2e-9, 3e-9])
    assert frame_durations(np.array([5, 7]), 1).tolist() == pytest.approx([4e-9, 2e-9])


def test_arrows_grow_with_depth_where_no_force_is_known_and_end() -> None:
    lengths = arrow_lengths(contacts([0.0, 1e-3, 2e-3, 10.0], [1.0] * 4), np.zeros(4))
    assert lengths[0] == MIN_ARROW_LENGTH
    assert lengths[3] == MAX_ARROW_LENGTH
    assert np.diff(lengths[:3]) == pytest.approx(np.diff(lengths[:3])[0] * np.ones(2))
    assert (np.diff(lengths) > 0).all()


def test_materials_that_are_not_known_keep_their_colour() -> None:
    assert colour_of_material("rubber") == colour_of_material("rubber")
    assert len({colour_of_material(name) for name in ("wood", "human", "metal")}) == 3
