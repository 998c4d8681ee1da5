"""Joint values of avatars from the world poses of their links: of recorded poses, whose values an output does not have."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from defusedxml import ElementTree
from numpy.typing import NDArray

from geomphys.numerics.transforms import quaternion_from_rpy, quaternion_product, rotation_from_quaternion
from geomphys.output.decoders import Poses
from geomphys.output.output_log import OutputLog
from geomphys.scene.frame_ids import RECORDED_PREFIX

Flags = NDArray[np.bool_]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_MOVING = ("revolute", "continuous", "prismatic")

_CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])


class LinkTrees(NamedTuple):
    """The trees that L links belong to, and the J joints between them."""

    trees: Ints  # (L,)
    joints: tuple[tuple[str, str], ...]  # (J) tree and name
    sliding: Flags  # (J,) whether the joint slides instead of rotating
    parents: Ints  # (J,) rows of the links
    children: Ints  # (J,)
    shifts: Floats  # (J, 3) origin of the joint in its parent's frame, m
    origins: Floats  # (J, 4) parent_from_joint rotation, x y z w
    axes: Floats  # (J, 3) unit, joint frame

    def angles(self, poses: Floats) -> Floats:
        """Angles (n, R) [rad, -pi to pi] of the R rotating joints at world poses (n, L, 7) of the links."""
        return self.values(poses)[:, ~self.sliding]

    def values(self, poses: Floats) -> Floats:
        """Values (n, J) of the joints at world poses (n, L, 7) of the links: angles [rad, -pi to pi], displacements [m]."""
        parent, child = poses[:, self.parents], poses[:, self.children]
        joint = quaternion_product(parent[..., 3:], self.origins)
        relative = quaternion_product(joint * _CONJUGATE, child[..., 3:])
        sine, cosine = np.einsum("njk,jk->nj", relative[..., :3], self.axes), relative[..., 3]
        sign = np.where(cosine < 0.0, -1.0, 1.0)
        values: Floats = 2.0 * np.arctan2(sign * sine, sign * cosine)
        if self.sliding.any():
            moved = (
                child[..., :3]
                - parent[..., :3]
                - np.einsum("njab,jb->nja", rotation_from_quaternion(parent[..., 3:]), self.shifts)
            )
            along = np.einsum("njab,jb,nja->nj", rotation_from_quaternion(joint), self.axes, moved)
            values = np.where(self.sliding, along, values)
        return values


def link_trees(output: OutputLog, names: Sequence[str]) -> LinkTrees:
    """Trees and joints, from the URDFs attached to an output, of links with the given frame ids.

    Links that no URDF has are trees of their own; joints whose links are not among the names, those that do not move and those
    that mimic another are left out.
    """
    rows = {name: row for row, name in enumerate(names)}
    trees = -np.ones(len(names), np.int64)
    parents: list[int] = []
    children: list[int] = []
    joints: list[tuple[str, str]] = []
    sliding: list[bool] = []
    shifts: list[Floats] = []
    origins: list[tuple[float, ...]] = []
    axes: list[Floats] = []
    models = [(name[:-5], data) for name, data in output.attachments().items() if name.endswith(".urdf")]
    for number, (tree, data) in enumerate(models):
        robot = ElementTree.fromstring(data)

        def row_of(link: str, tree: str = tree) -> int | None:
            return rows.get(f"{tree}/{link}", rows.get(link))

        for link in robot.iter("link"):
            if (row := row_of(link.get("name", ""))) is not None and trees[row] < 0:
                trees[row] = number
        for joint in robot.findall("joint"):
            parent, child = joint.find("parent"), joint.find("child")
            if joint.get("type") not in _MOVING or joint.find("mimic") is not None:
                continue
            if parent is None or child is None:
                continue
            ends = row_of(parent.get("link", "")), row_of(child.get("link", ""))
            if ends[0] is None or ends[1] is None:
                continue
            axis = _numbers(joint.find("axis"), "xyz", (1.0, 0.0, 0.0))
            joints.append((tree, joint.get("name", "")))
            sliding.append(joint.get("type") == "prismatic")
            shifts.append(_numbers(joint.find("origin"), "xyz", (0.0, 0.0, 0.0)))
            parents.append(ends[0])
            children.append(ends[1])
            origins.append(
                quaternion_from_rpy(np.degrees(_numbers(joint.find("origin"), "rpy", (0.0, 0.0, 0.0))).tolist())
            )
            axes.append(axis / (np.linalg.norm(axis) or 1.0))
    lone = np.flatnonzero(trees < 0)
    trees[lone] = len(models) + np.arange(len(lone))
    return LinkTrees(
        trees,
        tuple(joints),
        np.array(sliding, np.bool_),
        np.array(parents, np.int64),
        np.array(children, np.int64),
        np.array(shifts, np.float64).reshape(-1, 3),
        np.array(origins, np.float64).reshape(-1, 4),
        np.array(axes, np.float64).reshape(-1, 3),
    )


class RecordedJoints:
    """Joint values of the recorded poses of an output."""

    def __init__(self, output: OutputLog) -> None:
        self._output = output
        self._names: tuple[str, ...] | None = None
        self._links: LinkTrees
        self._columns: dict[tuple[str, str], int] = {}

    def values(self, recorded: Poses, avatar: str, joints: Sequence[str], near: Floats) -> Floats:
        """Recorded values (n,) of joints of an avatar, rad or m; NaN where a link has no recorded pose.

        An angle is known up to whole turns: of those the one nearest to `near` (n,) is taken.
        """
        if recorded.names != self._names:
            self._names = recorded.names
            self._links = link_trees(self._output, [name.removeprefix(RECORDED_PREFIX) for name in recorded.names])
            self._columns = {joint: column for column, joint in enumerate(self._links.joints)}
        columns = [self._columns.get((avatar, joint), -1) for joint in joints]
        found = np.append(self._links.values(recorded.values[None])[0], np.nan)[columns]
        nearest = found + 2.0 * np.pi * np.round((near - found) / (2.0 * np.pi))
        values: Floats = np.where(np.append(self._links.sliding, True)[columns], found, nearest)
        return values


class Unwrapper:
    """Makes angles continuous in time, over pieces of a sequence: adds multiples of 2 pi where they jump by more than pi."""

    def __init__(self) -> None:
        self._last: Floats | None = None

    def add(self, angles: Floats) -> Floats:
        """The next rows (n, J) [rad], continuous with those before."""
        before = angles[:1] if self._last is None else self._last
        joined: Floats = np.unwrap(np.concatenate([before, angles]), axis=0, period=2.0 * math.pi)[1:]
        self._last = joined[-1:]
        return joined


def _numbers(element: ElementTree.Element | None, name: str, default: tuple[float, float, float]) -> Floats:
    """Three numbers of an attribute."""
    text = None if element is None else element.get(name)
    return np.array(default if text is None else [float(part) for part in text.split()], np.float64)
