"""Checks an output for overlaps with python-fcl on the original triangles, independently of the collision kernels.

None of the collision pipeline is used: no convex pieces, no GJK, no penetration depths. The poses are those of the
file's ``/tf``, the shapes the triangles of the URDFs and meshes as they were read (spheres, capsules and cylinders
tessellated). Two surfaces overlap if a triangle of one intersects a triangle of the other, or if one encloses the other.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import LogError
from geomphys.numerics.transforms import rotation_from_quaternion
from geomphys.output.output_log import OutputFrame, open_output
from geomphys.output.output_world import world_of_output
from geomphys.output.provenance import sha256_of_world
from geomphys.scene.arrays import FIXED, SIMULATED
from geomphys.scene.world import World
from geomphys.storage.remote_files import AnyPath, as_path

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

DRIVEN_LIMIT_M = 1e-5
"""m; a driven body counts as free if moving it this far ends the overlap."""
SIMULATED_LIMIT_M = 1e-4
"""m; allowed penetration of a resting simulated body."""

BISECTIONS = 12
MAX_CONTACT_NORMALS = 4
"""Intersecting triangles whose normals are tried as separation directions."""
LARGEST_DEPTH_M = 10.0
MAX_OVERLAPS = 10_000
"""Maximum number of listed overlaps; further ones are only counted."""


@dataclass(frozen=True, kw_only=True)
class Overlap:
    """Two bodies whose surfaces overlap in a frame."""

    frame: int
    time_ns: int
    body_a: str
    body_b: str
    depth_at_most_m: float
    """Upper bound of the penetration depth: moving `body_a` this far along one of the tested directions ends the overlap."""
    broken: bool
    """Whether the depth exceeds the limit of the two bodies."""


@dataclass(frozen=True, kw_only=True)
class AuditReport:
    """Overlaps that python-fcl found in an output."""

    output: str
    motion: str  # "corrected" or "recorded"
    frames: int
    pairs: int  # pairs of bodies that must not overlap
    tests: int  # pairs with overlapping boxes, whose triangles were tested
    triangles: int
    frames_overlapping: int
    frames_broken: int  # frames with an overlap above its limit
    deepest: Overlap | None
    overlaps: tuple[Overlap, ...]
    overlaps_dropped: int
    same_world: bool  # whether the scene is bit for bit that of the replay

    def as_dict(self) -> dict[str, Any]:
        """Everything by name, of plain Python types: fit for JSON."""
        return dataclasses.asdict(self)


def audit_output(
    output: AnyPath | str,
    *,
    scene: AnyPath | str | None = None,
    recorded: bool = False,
    progress: Callable[[int, int | None], None] | None = None,
) -> AuditReport:
    """Test every frame of an output for overlaps of bodies that must not overlap.

    These are pairs with at least one body that physics or the recording moves: driven against fixed, simulated and other
    driven bodies, and the links of an avatar in chains mode among themselves, but for neighbours, pairs that overlap in
    the zero pose, and those the scene file lets.

    Parameters
    ----------
    output : Path or str
        The output log.
    scene : Path or str, optional
        The scene file; None: the one attached to the output.
    recorded : bool
        Whether the driven bodies are tested where they were recorded, which shows what was there to correct.
    progress : callable, optional
        Called with the frames tested and their number.

    Raises
    ------
    LogError
        The file is no output, or a body of the scene has no pose in it.
    SceneError, ModelError, MeshError
        The scene's files are gone or have changed; `scene` names others.
    """
    log = open_output(output)
    world = world_of_output(log, None if scene is None else as_path(scene))
    auditor = _Auditor(world, log.path, recorded)
    frames = overlapping = broken = dropped = 0
    listed_overlaps: list[Overlap] = []
    deepest: Overlap | None = None
    for frame in log.frames(["/tf", "/recorded/tf"] if recorded else ["/tf"]):
        found = list(auditor.overlaps(frame))
        frames += 1
        overlapping += bool(found)
        broken += any(overlap.broken for overlap in found)
        for overlap in found:
            if deepest is None or overlap.depth_at_most_m > deepest.depth_at_most_m:
                deepest = overlap
        capacity = MAX_OVERLAPS - len(listed_overlaps)
        listed_overlaps += found[:capacity]
        dropped += max(0, len(found) - capacity)
        if progress is not None:
            progress(frames, log.frame_count)
    if frames == 0:
        raise LogError(f"{log.path}: holds no frame")
    return AuditReport(
        output=str(log.path),
        motion="recorded" if recorded else "corrected",
        frames=frames,
        pairs=len(auditor.pairs),
        tests=auditor.tests,
        triangles=sum(len(faces) for _, faces in world.collision_triangles),
        frames_overlapping=overlapping,
        frames_broken=broken,
        deepest=deepest,
        overlaps=tuple(listed_overlaps),
        overlaps_dropped=dropped,
        same_world=scene is None or sha256_of_world(world) == log.metadata.get("world_sha256"),
    )


def pairs_to_test(world: World) -> list[tuple[int, int]]:
    """Pairs a < b of bodies with a shape that must not overlap."""
    bodies, trees = world.scene.bodies, world.scene.trees
    solid = [body for body, (_, faces) in enumerate(world.collision_triangles) if len(faces)]
    found = []
    for k, a in enumerate(solid):
        for b in solid[k + 1 :]:
            if bodies.role[a] == FIXED and bodies.role[b] == FIXED:
                continue
            tree = int(bodies.tree[a])
            if tree == bodies.tree[b]:
                among_links = tree < world.avatar_count and trees.chains[tree] and trees.self_collision[tree]
                if not among_links or world.scene.excluded[a, b]:
                    continue
            found.append((a, b))
    return found


class _Shape(NamedTuple):
    """Geometry of a body for python-fcl and the containment test; body frame, m."""

    collider: Any
    low: Floats  # (3,)
    high: Floats  # (3,)
    corners: Floats  # (8, 3)
    inner: Floats  # (k, 3) a vertex of each connected part of the surface
    triangles: Floats  # (n, 3, 3)


class _Auditor:
    """Poses the bodies of a world as in a frame, and tests them for overlaps."""

    def __init__(self, world: World, path: AnyPath, recorded: bool) -> None:
        self.pairs = pairs_to_test(world)
        self.tests = 0
        self._world, self._path, self._recorded = world, path, recorded
        self._tested_bodies = sorted({body for pair in self.pairs for body in pair})
        self._shapes = {body: _shape(*world.collision_triangles[body]) for body in self._tested_bodies}
        self._pair_bodies = np.array(self.pairs, np.int64).reshape(-1, 2)
        self._poses = np.full((len(world.body_names), 7), np.nan)
        self._index = {name: body for body, name in enumerate(world.frame_names)}

    def overlaps(self, frame: OutputFrame) -> Iterator[Overlap]:
        """Pairs that overlap in a frame, sorted by their bodies."""
        if not self._tested_bodies:
            return
        self._update_poses(frame)
        used, poses = self._tested_bodies, self._poses
        rotations = rotation_from_quaternion(poses[used, 3:])
        corners = np.stack([self._shapes[body].corners for body in used])
        world_corners = np.einsum("bij,bcj->bci", rotations, corners) + poses[used, None, :3]
        low, high = np.empty((len(poses), 3)), np.empty((len(poses), 3))
        low[used], high[used] = world_corners.min(axis=1), world_corners.max(axis=1)
        rotations_by_body = dict(zip(used, rotations, strict=True))
        a, b = self._pair_bodies.T
        candidates = np.flatnonzero(((low[a] <= high[b]) & (low[b] <= high[a])).all(axis=1))
        for one, other in self._pair_bodies[candidates].tolist():
            self.tests += 1
            pair = _PosedPair(
                self._shapes[one],
                self._shapes[other],
                rotations_by_body[one],
                rotations_by_body[other],
                poses[one, :3],
                poses[other, :3],
            )
            if pair.overlaps(np.zeros(3)):
                depth = pair.depth()
                yield Overlap(
                    frame=frame.index,
                    time_ns=frame.time_ns,
                    body_a=self._world.body_names[one],
                    body_b=self._world.body_names[other],
                    depth_at_most_m=depth,
                    broken=depth > self._limit(one, other),
                )

    def _update_poses(self, frame: OutputFrame) -> None:
        """Set the poses of a frame; bodies that it does not name keep theirs."""
        for name, pose in zip(frame.tf.names, frame.tf.values, strict=True):
            if name in self._index:
                self._poses[self._index[name]] = pose
        if self._recorded:
            for name, pose in zip(frame.recorded.names, frame.recorded.values, strict=True):
                self._poses[self._index[name.removeprefix("recorded/")]] = pose
        missing = [body for body in self._tested_bodies if np.isnan(self._poses[body]).any()]
        if missing:
            raise LogError(
                f"{self._path}: frame {frame.index}: /tf has no pose of {self._world.frame_names[missing[0]]!r}, which "
                f"is in the scene {self._world.path.name}; is it that scene's output?"
            )

    def _limit(self, a: int, b: int) -> float:
        roles = self._world.scene.bodies.role
        return SIMULATED_LIMIT_M if SIMULATED in (roles[a], roles[b]) else DRIVEN_LIMIT_M


@dataclass(frozen=True)
class _PosedPair:
    """Two shapes and their poses."""

    a: _Shape
    b: _Shape
    rotation_a: Floats
    rotation_b: Floats
    position_a: Floats
    position_b: Floats

    def overlaps(self, shift: Floats) -> bool:
        """Whether they overlap once a is moved by `shift` (3,) m."""
        import fcl

        position_a = self.position_a + shift
        one = fcl.CollisionObject(self.a.collider, fcl.Transform(self.rotation_a, position_a))
        other = fcl.CollisionObject(self.b.collider, fcl.Transform(self.rotation_b, self.position_b))
        if fcl.collide(one, other, fcl.CollisionRequest(), fcl.CollisionResult()):
            return True
        inside_b = (self.a.inner @ self.rotation_a.T + position_a - self.position_b) @ self.rotation_b
        inside_a = (self.b.inner @ self.rotation_b.T + self.position_b - position_a) @ self.rotation_a
        return _any_inside(inside_b, self.b) or _any_inside(inside_a, self.a)

    def depth(self) -> float:
        """Smallest distance along the tested directions that separates a from b, m: an upper bound of the depth."""
        best = LARGEST_DEPTH_M
        for direction in [*self._candidate_directions(), *_DIRECTIONS]:
            best = min(best, self._separation_along(direction, best))
        return best

    def _candidate_directions(self) -> list[Floats]:
        """Likely directions of least separation: between the box centres, and normals of intersecting triangles."""
        import fcl

        one = fcl.CollisionObject(self.a.collider, fcl.Transform(self.rotation_a, self.position_a))
        other = fcl.CollisionObject(self.b.collider, fcl.Transform(self.rotation_b, self.position_b))
        result = fcl.CollisionResult()
        fcl.collide(one, other, fcl.CollisionRequest(num_max_contacts=MAX_CONTACT_NORMALS, enable_contact=True), result)
        middle_a = self.rotation_a @ (0.5 * (self.a.low + self.a.high)) + self.position_a
        middle_b = self.rotation_b @ (0.5 * (self.b.low + self.b.high)) + self.position_b
        found = [middle_a - middle_b]
        for contact in result.contacts:
            for shape, rotation, triangle in (
                (self.a, self.rotation_a, contact.b1),
                (self.b, self.rotation_b, contact.b2),
            ):
                corners = shape.triangles[triangle]
                normal = rotation @ np.cross(corners[1] - corners[0], corners[2] - corners[0])
                found.append(-normal if shape is self.a else normal)
        lengths = [float(np.linalg.norm(direction)) for direction in found]
        return [direction / length for direction, length in zip(found, lengths, strict=True) if length > 0.0]

    def _separation_along(self, direction: Floats, bound: float) -> float:
        """Smallest distance found along a direction that separates the shapes, at most `bound` [m]."""
        if self.overlaps(bound * direction):
            return bound
        inside, free = 0.0, bound
        step = DRIVEN_LIMIT_M
        while step < bound:  # exponential search: the distance is mostly small
            if not self.overlaps(step * direction):
                free = step
                break
            inside, step = step, 4.0 * step
        for _ in range(BISECTIONS):
            if free <= DRIVEN_LIMIT_M:
                break
            middle = 0.5 * (inside + free)
            inside, free = (middle, free) if self.overlaps(middle * direction) else (inside, middle)
        return free


def _directions() -> Floats:
    """Six axes and eight diagonals, unit."""
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    signs = np.array([(x, y, z) for x in (1, -1) for y in (1, -1) for z in (1, -1)])
    directions: Floats = np.concatenate([axes, signs / np.sqrt(3.0)])
    return directions


_DIRECTIONS = _directions()


def _shape(vertices: Floats, faces: Ints) -> _Shape:
    import fcl
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    model = fcl.BVHModel()
    model.beginModel(len(vertices), len(faces))
    model.addSubModel(vertices, faces)
    model.endModel()
    used = np.unique(faces)
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    graph = coo_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(vertices), len(vertices)))
    _, component = connected_components(graph, directed=False)
    _, first_vertices = np.unique(component[used], return_index=True)
    low, high = vertices[used].min(axis=0), vertices[used].max(axis=0)
    ends_of_box = np.stack([low, high])
    corners = np.array(
        [[ends_of_box[i, 0], ends_of_box[j, 1], ends_of_box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    )
    return _Shape(model, low, high, corners, vertices[used[first_vertices]], vertices[faces])


def _any_inside(points: Floats, shape: _Shape) -> bool:
    """Whether one of the points (k, 3), body frame, lies in a closed surface: its winding number is not 0.

    The solid angles of the triangles as seen from the point add up to 4 pi times that number (van Oosterom and Strackee
    1983).
    """
    points_in_box = points[((points > shape.low) & (points < shape.high)).all(axis=1)]
    for point in points_in_box:
        a, b, c = (shape.triangles[:, k] - point for k in range(3))
        la, lb, lc = (np.linalg.norm(edge, axis=1) for edge in (a, b, c))
        numerator = np.einsum("ij,ij->i", a, np.cross(b, c))
        denominator = la * lb * lc
        denominator += (
            np.einsum("ij,ij->i", a, b) * lc + np.einsum("ij,ij->i", b, c) * la + np.einsum("ij,ij->i", c, a) * lb
        )
        if abs(float(np.arctan2(numerator, denominator).sum()) / (2.0 * np.pi)) > 0.5:
            return True
    return False
