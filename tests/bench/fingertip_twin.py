"""A plain twin of the measures of fingertips in `geomphys.engine.motion_measures`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geomphys.bench.fingertip_meter import TipFigures
from geomphys.collision.penetration import make_scratch, separation
from geomphys.driven.links import make_links
from geomphys.engine.fingertips import make_fingertips
from geomphys.engine.motion_measures import IN_CONTACT, RETAINED, ROUNDING
from geomphys.jit.packed_records import pack
from geomphys.numerics.transforms import compose, frame_from_matrix, matrix_from_frame, matrix_from_pose
from geomphys.scene.world import World

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class PlainFingertipMeter:
    """Fingertips of a world, against everything of other trees."""

    def __init__(self, world: World) -> None:
        scene = world.scene
        tips = make_fingertips(scene, make_links(scene))
        pieces, tree_of_piece = scene.pieces, scene.bodies.tree[scene.pieces.body]
        self._pieces, self._packed, self._scratch = pieces, pack(pieces), pack(make_scratch())
        self._local = matrix_from_frame(pieces.local)
        bodies = [tips.bodies[a:b] for a, b in zip(tips.body_start, tips.body_start[1:], strict=False)]
        self._own = [np.flatnonzero(np.isin(pieces.body, found)) for found in bodies]
        self._others = [np.flatnonzero(tree_of_piece != scene.bodies.tree[link]) for link in tips.link]

    def figures(self, recorded: Floats, poses: Floats) -> TipFigures:
        """Figures of a frame with the bodies at `poses` (B, 7), which were recorded at `recorded` (B, 7)."""
        before, after = self._frames(recorded), self._frames(poses)
        gaps = [self._gap(tip, before) for tip in range(len(self._own))]
        touching = [tip for tip, gap in enumerate(gaps) if gap <= IN_CONTACT]
        retained = sum(self._gap(tip, after) <= max(RETAINED, gaps[tip] + ROUNDING) for tip in touching)
        offsets = np.linalg.norm(self._centres(after) - self._centres(before), axis=1)
        errors = offsets[touching] if touching else offsets
        return TipFigures(len(touching), retained, float(errors.mean()) if len(errors) else 0.0)

    def _frames(self, poses: Floats) -> Floats:
        """World frames (P, 12) of the pieces."""
        return np.ascontiguousarray(frame_from_matrix(compose(matrix_from_pose(poses[self._pieces.body]), self._local)))

    def _piece_centres(self, frames: Floats) -> Floats:
        """World centres (P, 3) of the pieces' bounding spheres."""
        rotated: Floats = np.einsum("pij,pj->pi", frames[:, :9].reshape(-1, 3, 3), self._pieces.centre)
        return rotated + frames[:, 9:]

    def _centres(self, frames: Floats) -> Floats:
        """Middles (F, 3) of the fingertips."""
        centres = self._piece_centres(frames)
        return np.array([centres[own].mean(axis=0) for own in self._own]).reshape(-1, 3)

    def _gap(self, tip: int, frames: Floats) -> float:
        """Smallest separation [m] of a fingertip from anything of other trees; inf beyond `IN_CONTACT`."""
        centres, reach, others, smallest = self._piece_centres(frames), self._pieces.reach, self._others[tip], np.inf
        for i in self._own[tip]:
            apart = np.linalg.norm(centres[others] - centres[i], axis=1) - reach[others] - reach[i]
            for j in others[apart <= IN_CONTACT]:
                found = separation(self._packed, frames, int(i), int(j), IN_CONTACT, (0.0, 0.0, 0.0), self._scratch)[0]
                smallest = min(smallest, found if found <= IN_CONTACT else np.inf)
        return float(smallest)
