"""Reads a robot description and poses it over many frames, so that a motion can be planned against a table top."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import NamedTuple

import numpy as np
from turns import axis_turn


class Joint(NamedTuple):
    """One joint: fixed part of its transform, unit axis, and limits (rad), None if it does not move."""

    name: str
    parent: str
    child: str
    parent_from_joint: np.ndarray
    axis: tuple[float, float, float]
    limits: tuple[float, float] | None


class Body:
    """The tree of a URDF whose links are meshes, boxes, spheres and cylinders.

    Parameters
    ----------
    path
        The URDF; its mesh files are relative to it.
    """

    def __init__(self, path: Path) -> None:
        robot = ElementTree.parse(path).getroot()
        self.joints = {j.name: j for j in (_joint(e) for e in robot.iter("joint"))}
        self.moving = [name for name, j in self.joints.items() if j.limits is not None]
        children = {j.child for j in self.joints.values()}
        links = [e.attrib["name"] for e in robot.iter("link")]
        (self.root,) = [name for name in links if name not in children]
        self.points = {e.attrib["name"]: _points(e, path.parent) for e in robot.iter("link")}

    def forward(self, angles: dict[str, np.ndarray], frames: int) -> dict[str, np.ndarray]:
        """Link -> (frames, 4, 4) root_from_link; joints that are not named stay at zero."""
        poses = {self.root: np.tile(np.eye(4), (frames, 1, 1))}
        rest = dict(self.joints)
        while rest:
            for joint in [j for j in rest.values() if j.parent in poses]:
                pose = poses[joint.parent] @ joint.parent_from_joint
                if joint.limits is not None and joint.name in angles:
                    pose = pose @ axis_turn(joint.axis, np.broadcast_to(angles[joint.name], (frames,)))
                poses[joint.child] = pose
                del rest[joint.name]
        return poses

    def lowest(
        self, poses: dict[str, np.ndarray], direction: tuple[float, float, float] = (0.0, 0.0, 1.0)
    ) -> np.ndarray:
        """Smallest coordinate along ``direction`` of all points of all links in each frame, (frames,) in m."""
        d = np.asarray(direction, dtype=float)
        found = [
            (np.einsum("nij,i->nj", pose[:, :3, :3], d) @ self.points[link].T).min(axis=1) + pose[:, :3, 3] @ d
            for link, pose in poses.items()
            if len(self.points[link])
        ]
        return np.min(found, axis=0)

    def inside_limits(self, angles: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The angles, clipped to the joints' limits; a name that is no joint of the body is an error."""
        out = {}
        for name, values in angles.items():
            limits = self.joints[name].limits
            if limits is None:
                raise ValueError(f"{name} does not move")
            out[name] = np.clip(values, *limits)
        return out


def _joint(element: ElementTree.Element) -> Joint:
    origin = element.find("origin")
    place = np.eye(4)
    if origin is not None:
        roll, pitch, yaw = (np.array([float(v)]) for v in origin.get("rpy", "0 0 0").split())
        place = (axis_turn((0, 0, 1), yaw) @ axis_turn((0, 1, 0), pitch) @ axis_turn((1, 0, 0), roll))[0]
        place[:3, 3] = [float(v) for v in origin.get("xyz", "0 0 0").split()]
    axis, limit = element.find("axis"), element.find("limit")
    x, y, z = (1.0, 0.0, 0.0) if axis is None else (float(v) for v in axis.attrib["xyz"].split())
    limits = None if limit is None else (float(limit.attrib["lower"]), float(limit.attrib["upper"]))
    parent, child = element.find("parent"), element.find("child")
    if parent is None or child is None:
        raise ValueError(f"joint {element.attrib['name']} joins nothing")
    return Joint(element.attrib["name"], parent.attrib["link"], child.attrib["link"], place, (x, y, z), limits)


def _points(link: ElementTree.Element, folder: Path) -> np.ndarray:
    """Vertices of a link's collision meshes in its frame (meshes carry no origin in these files), (n, 3)."""
    found = [np.zeros((0, 3))]
    for element in link.findall("collision/geometry/mesh"):
        lines = (folder / element.attrib["filename"]).read_text(encoding="ascii").splitlines()
        found.append(np.array([[float(v) for v in line.split()[1:]] for line in lines if line.startswith("v ")]))
    return np.vstack(found)
