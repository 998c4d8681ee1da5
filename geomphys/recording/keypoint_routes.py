"""Samples the points of a tree at the frames and fits its joint values to them.

The nodes of a Manus glove are given in the hand: with a tracker for the root they are fitted by themselves, and only the joint
values count.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from geomphys.keypoints.fitter import KeypointFitter
from geomphys.keypoints.setup import make_model
from geomphys.numerics.transforms import quaternion_product
from geomphys.recording.channels import kind_of
from geomphys.recording.input_plan import KeypointInput
from geomphys.recording.routes import RootRoute
from geomphys.scene.world import World

Floats = NDArray[np.float64]


class KeypointRoute:
    """The points of one tree: a stream each, and the fit of the frame."""

    def __init__(self, source: KeypointInput, poses: Sequence[RootRoute], world: World, *, fits: bool) -> None:
        """`poses` are all routes of the pass, among them those of the points; without `fits` only `points` are filled."""
        self.input = source
        self.tree = source.source.tree
        by_child = {(p.input.topic, p.input.child, p.input.source.tree): p for p in poses if p.input.is_point}
        self.routes = [by_child[p.topic, p.child, p.source.tree] for p in source.points]
        rows = slice(*world.scene.trees.body_start[self.tree : self.tree + 2])
        self.links = [name.split("/", 1)[1] for name in world.body_names[rows]]
        bodies = np.array([self.links.index(link) for link in source.links], dtype=np.int64)
        weights = np.array(source.weights)
        kind = kind_of(source.channels[0])
        self.in_hand = kind is not None and kind.content == "glove"  # a glove does not know where the hand is
        self.keeps_root = not source.source.fits_root
        fits_root = source.source.fits_root or self.in_hand
        self.model = make_model(world.scene, self.tree, bodies, weights, fits_root=fits_root)
        self.fitter = KeypointFitter(self.model) if fits else None
        self.columns = slice(*world.scene.trees.dof_start[self.tree : self.tree + 2])
        self.oriented = [k for k, is_oriented in enumerate(source.oriented) if is_oriented]
        self.orientation = world.palm_orientations.get(world.tree_names[self.tree])
        # of the last frame, m, world frame; orientations count for `oriented` only
        self.poses = np.zeros((len(self.routes), 7))
        self.points = self.poses[:, :3]
        self.seen = np.zeros(len(self.routes), dtype=np.int64)
        self.held_frames = 0

    def _root_orientation(self) -> tuple[Floats | None, float]:
        """Orientation of the root by that of the palm or wrist, and its lever [m]; None where it has none."""
        palm = self.orientation
        if palm is None or not self.seen[palm.point]:
            return None, 0.0
        return quaternion_product(self.poses[palm.point, 3:], palm.point_from_root), palm.lever

    def add_posture(self, time: int, roots: Floats, angles: Floats) -> bool:
        """Put the posture at a frame time [ns] into `roots` (T, 7) and `angles` (Q,); whether it is held."""
        waiting = self.fitter is not None and not self.fitter.started
        for k, route in enumerate(self.routes):
            sample = route.stream.at(time)
            self.seen[k] = not sample.held or (waiting and sample.before_first)
            self.poses[k] = route.world_from_root(sample.value)
        if self.fitter is None:
            return False
        is_early = waiting and any(r.stream.last is None for r in self.routes)
        fitted = self.fitter.fit(self.points.copy(), self.seen, roots[self.tree], *self._root_orientation())
        if not self.keeps_root:
            roots[self.tree] = fitted.root
        angles[self.columns] = fitted.angles
        held = fitted.held or (is_early and not any(r.stream.last is not None for r in self.routes))
        self.held_frames += held
        return held
