"""Allocates the simulated loop of a scene: constant fields filled in, workspaces for the rest."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from geomphys.collision.scratch import Scratch
from geomphys.collision.support import pose_pieces
from geomphys.collision.sweep import local_boxes
from geomphys.numerics.quantiles import median
from geomphys.scene.arrays import HULL, SIMULATED, SPHERE, Floats, Scene
from geomphys.simulated.state import (
    AABB,
    BALL,
    BODY,
    CONTACT,
    COUNTS,
    FRAME,
    ISLAND,
    LOCAL_BOX,
    MOTION,
    PAIR,
    SLOT,
    Records,
    Simulation,
)

WIDE = 4.0  # a body at rest wider along x than this many median widths is tested every time


def piece_arms(scene: Scene, motion: Records) -> Floats:
    """(P,) m: how far from its body's reference point a piece's surface reaches; of a ball, its centre only."""
    pieces = scene.pieces
    arms = np.zeros(len(pieces.kind))
    for i in range(len(arms)):
        local = pieces.local[i]
        centre = local[:9].reshape(3, 3) @ pieces.centre[i] + local[9:]
        arms[i] = np.linalg.norm(centre - motion["centre"][pieces.body[i]])
        if pieces.kind[i] != SPHERE:
            arms[i] += pieces.reach[i]
    return arms


def piece_local_boxes(scene: Scene) -> Records:
    """(P,) LOCAL_BOX of the pieces."""
    pieces = scene.pieces
    boxes = np.zeros(len(pieces.kind), LOCAL_BOX)
    boxes["centre"], boxes["half"] = local_boxes(pieces)
    starts, counts = pieces.vertex_start[:-1], np.diff(pieces.vertex_start)
    corners = pieces.vertices[: pieces.vertex_start[-1]]
    distances = np.linalg.norm(corners - np.repeat(boxes["centre"], counts, axis=0), axis=1)
    hulls = np.flatnonzero((pieces.kind == HULL) & (counts > 0))
    boxes["radius"] = pieces.reach
    for hull, start, end in zip(hulls, starts[hulls].tolist(), (starts + counts)[hulls].tolist(), strict=True):
        boxes["radius"][hull] = distances[start:end].max()
    return boxes


def piece_boxes(scene: Scene, poses: Floats, local: Records) -> Records:
    """(P,) AABB of the pieces with the bodies at `poses` (B, 7); `local` (P,) LOCAL_BOX."""
    frames = np.zeros((len(local), 12))
    pose_pieces(scene.pieces, poses, frames)
    rotation = frames[:, :9].reshape(-1, 3, 3)
    centre = frames[:, 9:] + np.einsum("pij,pj->pi", rotation, local["centre"])
    half = np.minimum(np.einsum("pij,pj->pi", np.abs(rotation), local["half"]), local["radius"][:, None])
    boxes = np.zeros(len(local), AABB)
    boxes["low"], boxes["high"] = centre - half, centre + half
    return boxes


def body_balls(scene: Scene, local: Records) -> Records:
    """(B,) BALL of the bodies; `local` (P,) LOCAL_BOX."""
    pieces, balls = scene.pieces, np.zeros(len(scene.bodies.role), BALL)
    for body, (first, last) in enumerate(itertools.pairwise(scene.bodies.piece_start)):
        if first < last:
            rotation = pieces.local[first:last, :9].reshape(-1, 3, 3)
            own = local[first:last]
            centres = pieces.local[first:last, 9:] + np.einsum("pij,pj->pi", rotation, own["centre"])
            middle = 0.5 * (centres.min(axis=0) + centres.max(axis=0))
            balls[body] = middle, (np.linalg.norm(centres - middle, axis=1) + own["radius"]).max()
    return balls


def body_boxes(scene: Scene, boxes: Records) -> Records:
    """(B,) AABB of the bodies from those of their pieces; (inf, -inf) where there are none."""
    out = np.zeros(len(scene.bodies.role), AABB)
    out["low"], out["high"] = np.inf, -np.inf
    np.minimum.at(out["low"], scene.pieces.body, boxes["low"])
    np.maximum.at(out["high"], scene.pieces.body, boxes["high"])
    return out


def body_records(scene: Scene) -> tuple[Records, Records]:
    """(B,) `MOTION` and (B,) `BODY` with the constant fields filled in."""
    source, count = scene.bodies, len(scene.bodies.role)
    motion, bodies = np.zeros(count, MOTION), np.zeros(count, BODY)
    free = source.role == SIMULATED
    motion["centre"][free] = source.com[free]
    motion["inverse_mass"][free] = 1.0 / source.mass[free]
    motion["mass"][free] = source.mass[free]
    motion["inertia"], motion["principal"] = source.inertia, source.principal
    motion["reported_angular_velocity"] = np.nan
    bodies["role"], bodies["tree"], bodies["material"] = source.role, source.tree, source.material
    bodies["first_piece"], bodies["end_piece"] = source.piece_start[:-1], source.piece_start[1:]
    bodies["moves"] = scene.trees.moving[source.tree]
    return motion, bodies


class Capacity(NamedTuple):
    """Capacities of the tables of a frame."""

    pairs: int = 4096  # pairs of pieces that may come into contact
    points: int = 4096  # pairs in contact


CAPACITY = Capacity()


def make_simulation(
    scene: Scene,
    poses: Floats,
    *,
    start: Floats,
    end: Floats,
    reported: Floats,
    frames: Floats,
    scratch: Scratch,
    capacity: Capacity = CAPACITY,
) -> Simulation:
    """The simulated loop of a scene.

    Parameters
    ----------
    scene
        The scene.
    poses
        (B, 7) world poses of all bodies at the start; those of fixed bodies stay.
    start, end, reported, frames, scratch
        Arrays of the caller, as in `Simulation`: read and written by each frame.
    capacity
        Where it is too small for a frame, simulated bodies stay where they are for that frame, and it is reported.
    """
    motion, kinds = body_records(scene)
    motion["position"], motion["orientation"] = poses[:, :3], poses[:, 3:]
    bodies = len(kinds)
    local = piece_local_boxes(scene)
    arms, boxes = piece_arms(scene, motion), piece_boxes(scene, poses, local)
    np.maximum.at(motion["reach"], scene.pieces.body, arms)
    hulls = body_boxes(scene, boxes)
    free = np.flatnonzero(scene.bodies.role == SIMULATED)
    moves = kinds["moves"] == 1
    still = np.flatnonzero(~moves & np.isfinite(hulls["low"][:, 0]))
    width = (hulls["high"] - hulls["low"])[still, 0]
    narrow = width <= WIDE * median(width) if len(still) else np.zeros(0, bool)
    ordered = still[narrow][np.argsort(hulls["low"][still[narrow], 0], kind="stable")]
    possible = len(boxes) * int(np.isin(scene.pieces.body, free).sum())
    pairs, points = max(1, min(capacity.pairs, possible)), max(4, min(capacity.points, 4 * possible))
    return Simulation(
        pieces=scene.pieces,
        gravity=scene.gravity,
        materials=scene.materials,
        free=free,
        paths=np.flatnonzero(moves & (scene.bodies.role != SIMULATED)),
        still=ordered,
        still_low=np.ascontiguousarray(hulls["low"][ordered, 0]),
        widest=float(width[narrow].max(initial=0.0)),
        others=np.concatenate([np.flatnonzero(moves), still[~narrow]]),
        arm=arms,
        local_boxes=local,
        balls=body_balls(scene, local),
        motion=motion,
        bodies=kinds,
        pairs=np.zeros(pairs, PAIR),
        slots=np.zeros((pairs, 4), SLOT),
        start=start,
        end=end,
        reported=reported,
        frames=frames,
        scratch=scratch,
        counts=np.zeros((), COUNTS),
        frame=np.zeros((), FRAME),
        boxes=boxes,
        body_boxes=hulls,
        old_pairs=np.zeros(pairs + 1, PAIR),
        old_pair_slots=np.zeros((pairs + 1, 4), SLOT),
        contacts=np.zeros(points, CONTACT),
        order=np.zeros(points, np.int64),
        velocity=np.zeros((bodies, 6)),
        displacement=np.zeros((bodies, 6)),
        islands=np.zeros(bodies, ISLAND),
        members=np.zeros(bodies, np.int64),
        island_pairs=np.zeros(pairs, np.int64),
        changed=np.zeros(bodies, np.int64),
        concerned=np.zeros(pairs, np.int64),
        energy=np.zeros(bodies),
        queue=np.zeros(pairs, np.int64),
        found=np.zeros(bodies, np.int64),
        old_slots=np.zeros(4, SLOT),
    )
