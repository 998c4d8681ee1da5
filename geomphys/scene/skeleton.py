"""The kinematic tree of a URDF: links, joints, limits, mimic joints, and forward kinematics in numpy.

The file is parsed by defusedxml (entities and DTDs refused) and validated, so that errors name the element; yourdfpy
then builds the objects. yourdfpy loads no meshes and nothing is fetched: `geomphys.scene.urdf_file` resolves mesh names
to local paths.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from geomphys.errors import ModelError
from geomphys.numerics.transforms import rotation_about
from geomphys.scene.free_joints import FREE_TYPES, JointEnds, links_above_free_joint
from geomphys.scene.urdf_file import Shape, Urdf, read_urdf
from geomphys.storage.remote_files import AnyPath

Floats = NDArray[np.float64]

MOVING_TYPES = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True, eq=False)
class Geometry:
    """One visual or collision element."""

    shape: Shape
    link_from_shape: Floats  # (4, 4)


@dataclass(frozen=True, eq=False)
class Link:
    """A link with its geometry."""

    name: str
    visuals: tuple[Geometry, ...]
    collisions: tuple[Geometry, ...]


@dataclass(frozen=True, eq=False)
class Joint:
    """The joint between a link and its parent."""

    name: str
    type: str  # fixed, revolute, continuous or prismatic
    parent: int  # link
    child: int  # link
    parent_from_joint: Floats  # (4, 4)
    axis: Floats  # (3,) unit, joint frame
    lower: float  # rad or m, -inf without a limit
    upper: float
    effort: float  # N or N m, inf without a limit
    dof: int  # column of the angles, -1 for a fixed joint; a mimic joint has its master's
    multiplier: float  # angle = multiplier * dof + offset
    offset: float
    mimics: str | None  # name of the joint it follows in the file


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A tree of links, parents first (breadth-first, children as the file lists their joints)."""

    path: AnyPath
    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint | None, ...]  # of each link; None for the root, which is link 0
    dof_names: tuple[str, ...]  # independent moving joints, in the order of the links
    lower: Floats  # (Q,) limits of the dofs, including those of their mimic joints
    upper: Floats  # (Q,)
    not_shown: tuple[str, ...] = ()  # problems of visuals that are skipped

    def moves_collisions(self) -> bool:
        """Whether a joint moves a link with collision geometry against the root."""
        moved = [False] * len(self.links)
        for i, joint in enumerate(self.joints):  # parents first
            if joint is not None:
                moved[i] = moved[joint.parent] or joint.type in MOVING_TYPES
        return any(is_moved and link.collisions for is_moved, link in zip(moved, self.links, strict=True))

    def index(self, link: str) -> int | None:
        """Index of a link by name."""
        return next((i for i, entry in enumerate(self.links) if entry.name == link), None)

    @property
    def parents(self) -> list[int]:
        """Parent link of each link, -1 for the root."""
        return [-1 if j is None else j.parent for j in self.joints]

    def children(self) -> list[list[int]]:
        """Child links of each link."""
        found: list[list[int]] = [[] for _ in self.links]
        for link, joint in enumerate(self.joints):
            if joint is not None:
                found[joint.parent].append(link)
        return found

    def neighbours(self) -> set[tuple[int, int]]:
        """Pairs (a, b), a < b, of links with collision geometry and no other such link on the path between them."""
        adjacent: list[list[int]] = self.children()
        for child, joint in enumerate(self.joints):
            if joint is not None:
                adjacent[child].append(joint.parent)
        pairs = set()
        for start, link in enumerate(self.links):
            if not link.collisions:
                continue
            todo, seen = [start], {start}
            while todo:
                for other in adjacent[todo.pop()]:
                    if other in seen:
                        continue
                    seen.add(other)
                    if self.links[other].collisions:
                        pairs.add((min(start, other), max(start, other)))
                    else:
                        todo.append(other)
        return pairs

    def forward(
        self, angles: ArrayLike | Mapping[str, ArrayLike] = (), world_from_root: ArrayLike | None = None
    ) -> Floats:
        """Forward kinematics of many frames.

        Parameters
        ----------
        angles
            (..., Q) rad or m in the order of `dof_names`, or values by name (absent ones are 0).
        world_from_root
            (..., 4, 4); default: the identity.

        Returns
        -------
        ndarray
            (..., L, 4, 4) world_from_link.
        """
        if isinstance(angles, Mapping):
            columns = [np.asarray(angles.get(name, 0.0), dtype=np.float64) for name in self.dof_names]
            angles = np.stack(np.broadcast_arrays(*columns), axis=-1) if columns else np.zeros(0)
        table = np.asarray(angles, dtype=np.float64)
        if table.size == 0:
            table = np.zeros((*table.shape[:-1], len(self.dof_names)))
        root = np.eye(4) if world_from_root is None else np.asarray(world_from_root, dtype=np.float64)
        frames = np.broadcast_shapes(table.shape[:-1], root.shape[:-2])
        poses = np.zeros((*frames, len(self.links), 4, 4))
        for link, joint in enumerate(self.joints):
            if joint is None:
                poses[..., link, :, :] = root
                continue
            pose = poses[..., joint.parent, :, :] @ joint.parent_from_joint
            if joint.dof >= 0:
                value = joint.multiplier * table[..., joint.dof] + joint.offset
                joint_motion = np.zeros((*value.shape, 4, 4))
                joint_motion[..., :, :] = np.eye(4)
                if joint.type == "prismatic":
                    joint_motion[..., :3, 3] = value[..., None] * joint.axis
                else:
                    joint_motion[..., :3, :3] = rotation_about(joint.axis, value)
                pose = pose @ joint_motion
            poses[..., link, :, :] = pose
        return poses


def load_skeleton(path: AnyPath) -> Skeleton:
    """Read a URDF. If the whole model is below a floating or planar joint, that joint's child is the root.

    Raises
    ------
    ModelError
        A missing or unreadable file, entities, absent attributes, unknown joint types, values that are no finite
        numbers, several roots, cycles, joints whose links are missing, mimic joints without a moving joint to follow.
    MeshError
        A mesh name that is no path to a local mesh file. The meshes themselves are not read here.
    """
    robot = read_urdf(path)
    order, robot = _below_free_joint(path, _ordered(path, robot), robot)
    link_index = {name: i for i, name in enumerate(order)}
    joint_above = {joint.child: joint for joint in robot.joints}
    moving = [joint_above[name] for name in order[1:] if joint_above[name].type in MOVING_TYPES]
    names = {joint.name for joint in moving}
    independent = [joint.name for joint in moving if joint.mimic is None]
    columns = {name: i for i, name in enumerate(independent)}
    mimic_sources = {j.name: _mimic_source(path, j, {m.name: m for m in moving}) for j in moving}

    joints: list[Joint | None] = [None]
    for name in order[1:]:
        source = joint_above[name]
        if source.mimic is not None and source.mimic.joint not in names:
            raise ModelError(
                f"{path}: joint {source.name!r} mimics {source.mimic.joint!r}, which is no moving joint of it"
            )
        dof, multiplier, offset = -1, 1.0, 0.0
        if source.name in names:
            master, multiplier, offset = mimic_sources[source.name]
            dof = columns[master]
        lower, upper = _limits(path, source)
        joints.append(
            Joint(
                name=source.name,
                type=source.type,
                parent=link_index[source.parent],
                child=link_index[name],
                parent_from_joint=np.eye(4) if source.origin is None else source.origin + 0.0,
                axis=_axis(path, source),
                lower=lower,
                upper=upper,
                effort=_effort(source),
                dof=dof,
                multiplier=multiplier,
                offset=offset,
                mimics=None if source.mimic is None else source.mimic.joint,
            )
        )
    entries = {link.name: link for link in robot.links}
    links = tuple(
        Link(
            name,
            tuple(Geometry(shape, matrix) for shape, matrix in entries[name].visuals),
            tuple(Geometry(shape, matrix) for shape, matrix in entries[name].collisions),
        )
        for name in order
    )
    lower_limits, upper_limits = _dof_limits(joints, len(independent))
    return Skeleton(
        path, robot.name, links, tuple(joints), tuple(independent), lower_limits, upper_limits, robot.not_shown
    )


def require_solid(skeleton: Skeleton) -> None:
    """Raise ModelError for a model without collision geometry."""
    if not any(link.collisions for link in skeleton.links):
        has_visuals = any(link.visuals for link in skeleton.links) or skeleton.not_shown
        advice = "copy the <geometry> of its visuals into" if has_visuals else "give its links"
        raise ModelError(
            f"{skeleton.path}: has no collision geometry, so nothing of it can touch anything: {advice} <collision> elements"
        )


def _below_free_joint(path: AnyPath, order: list[str], robot: Urdf) -> tuple[list[str], Urdf]:
    """Link names (parents first) and the model without what is above a floating or planar joint of the whole model."""
    joint_above = set(links_above_free_joint(JointEnds(j.type, j.parent, j.child) for j in robot.joints))
    joints = [joint for joint in robot.joints if joint.parent not in joint_above]
    for joint in joints:
        if joint.type in FREE_TYPES:
            advice = "two prismatic joints and a revolute one" if joint.type == "planar" else "objects of their own"
            raise ModelError(
                f"{path}: joint {joint.name!r} is {joint.type}, which is read only where the whole model hangs on it: "
                f"use {advice} instead"
            )
    dropped_visuals = []
    for link in robot.links:
        if link.name in joint_above and link.collisions:
            raise ModelError(
                f"{path}: link {link.name!r} has collision geometry and stands above the free joint that the model "
                "hangs on, so it has no pose: make it an object of its own"
            )
        if link.name in joint_above and link.visuals:
            dropped_visuals.append(f"{path}: link {link.name!r} stands above the free joint that the model hangs on")
    links = [link for link in robot.links if link.name not in joint_above]
    remaining = robot._replace(links=links, joints=joints, not_shown=(*robot.not_shown, *dropped_visuals))
    return [name for name in order if name not in joint_above], remaining


def _ordered(path: AnyPath, robot: Any) -> list[str]:
    """Link names, parents first; ModelError unless the joints form one tree."""
    names = [link.name for link in robot.links]
    children: dict[str, list[str]] = {}
    parent: dict[str, Any] = {}
    for joint in robot.joints:
        for end in (joint.parent, joint.child):
            if end not in names:
                raise ModelError(f"{path}: joint {joint.name!r} joins link {end!r}, which is not in the file")
        if joint.child in parent:
            first = parent[joint.child].name
            raise ModelError(f"{path}: link {joint.child!r} hangs on two joints, {first!r} and {joint.name!r}")
        parent[joint.child] = joint
        children.setdefault(joint.parent, []).append(joint.child)
    roots = [name for name in names if name not in parent]
    if not roots:
        raise ModelError(f"{path}: the joints form a ring, no link is the root")
    if len(roots) > 1:
        raise ModelError(f"{path}: {len(roots)} links hang on no joint ({', '.join(roots[:4])}); expected one root")
    order = [roots[0]]
    for name in order:
        order += children.get(name, [])
    if len(order) < len(names):
        dropped_visuals = sorted(set(names) - set(order))
        raise ModelError(
            f"{path}: the joints of link {dropped_visuals[0]!r} form a ring that does not reach the root {roots[0]!r}"
        )
    return order


def _mimic_source(path: AnyPath, joint: Any, moving: dict[str, Any]) -> tuple[str, float, float]:
    """The independent joint at the end of a series of mimic joints, and angle = multiplier * its angle + offset."""
    multiplier, offset, seen = 1.0, 0.0, {joint.name}
    while joint.mimic is not None:
        offset += multiplier * joint.mimic.offset
        multiplier *= joint.mimic.multiplier
        target = joint.mimic.joint
        if target in seen:
            raise ModelError(
                f"{path}: joint {target!r} mimics itself, by way of others: one of them must move on its own"
            )
        if target not in moving:
            raise ModelError(f"{path}: joint {joint.name!r} mimics {target!r}, which is no moving joint of this file")
        seen.add(target)
        joint = moving[target]
    return joint.name, multiplier, offset


def _axis(path: AnyPath, joint: Any) -> Floats:
    axis = np.asarray(joint.axis, dtype=np.float64)
    length = float(np.linalg.norm(axis))
    if joint.type not in MOVING_TYPES:
        return np.array([1.0, 0.0, 0.0])
    if not length > 1e-9:
        raise ModelError(f"{path}: joint {joint.name!r} has the axis 0 0 0, expected a direction")
    unit: Floats = axis / length if length != 1.0 else axis + 0.0
    return unit


def _limits(path: AnyPath, joint: Any) -> tuple[float, float]:
    if joint.type not in ("revolute", "prismatic") or joint.limit is None:
        return -np.inf, np.inf
    lower = -np.inf if joint.limit.lower is None else joint.limit.lower
    upper = np.inf if joint.limit.upper is None else joint.limit.upper
    if lower > upper:
        raise ModelError(f"{path}: joint {joint.name!r} has lower limit {lower} above upper limit {upper}")
    return lower, upper


def _effort(joint: Any) -> float:
    """Largest force [N] or torque [N m] of a joint; inf where the file has none, or none above zero."""
    given = None if joint.limit is None else joint.limit.effort
    return float(given) if given is not None and 0.0 < given < np.inf else float(np.inf)


def _dof_limits(joints: list[Joint | None], count: int) -> tuple[Floats, Floats]:
    """Limits of the dofs: those of their joint, intersected with those of its mimic joints.

    If the intersection is empty (limits of mimic joints are often careless), only the joint's own limits are used.
    """
    lower, upper = np.full(count, -np.inf), np.full(count, np.inf)
    own_limits = [(j.lower, j.upper) for j in joints if j is not None and j.dof >= 0 and j.mimics is None]
    for joint in joints:
        if joint is None or joint.dof < 0 or joint.multiplier == 0.0:
            continue
        low, high = joint.lower, joint.upper
        if joint.mimics is not None:
            low, high = sorted(((low - joint.offset) / joint.multiplier, (high - joint.offset) / joint.multiplier))
        lower[joint.dof], upper[joint.dof] = max(lower[joint.dof], low), min(upper[joint.dof], high)
    for dof in np.flatnonzero(lower > upper):
        lower[dof], upper[dof] = own_limits[dof]
    return lower, upper
