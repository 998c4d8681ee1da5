"""Floating and planar joints above a model's root link, in place of which the root's pose is recorded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

FREE_TYPES = ("floating", "planar")


class JointEnds(NamedTuple):
    """A joint's type and the links it joins."""

    type: str
    parent: str
    child: str


def joint_ends(robot: Any) -> Iterator[JointEnds]:
    """Ends of the joints in a ``<robot>`` element; joints without both ends are skipped."""
    for joint in robot.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is not None and child is not None:
            yield JointEnds(joint.get("type", ""), parent.get("link", ""), child.get("link", ""))


def links_above_free_joint(joints: Iterable[JointEnds]) -> list[str]:
    """Links from the root down to the parent of the free joint; empty if there is no such joint.

    The free joint must support the whole model: only fixed joints lie between it and the root, and the links above it
    have no other children.
    """
    joints_below: dict[str, list[JointEnds]] = {}
    for joint in joints:
        joints_below.setdefault(joint.parent, []).append(joint)
    children = {joint.child for row in joints_below.values() for joint in row}
    roots = [link for link in joints_below if link not in children]
    ancestors: list[str] = []
    link = roots[0] if len(roots) == 1 else None
    while link is not None and link not in ancestors and len(joints_below.get(link, ())) == 1:
        ancestors.append(link)
        joint = joints_below[link][0]
        if joint.type in FREE_TYPES:
            return ancestors
        link = joint.child if joint.type == "fixed" else None
    return []
