"""Writes meshes (Wavefront OBJ) and robot descriptions (URDF) as text that is the same on every run."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np
from solids import Solid


def number(value: float, digits: int = 9) -> str:
    """Shortest text of a number rounded to ``digits`` decimals; never a negative zero."""
    text = f"{round(float(value), digits) + 0.0:.{digits}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def numbers(values: object, digits: int = 9) -> str:
    """Several numbers with single spaces between."""
    return " ".join(number(v, digits) for v in np.asarray(values, dtype=float).ravel())


def write_obj(path: Path, solid: Solid, title: str) -> int:
    """Write a mesh and return how many triangles it has. Coordinates are rounded to a nanometre."""
    lines = [f"# {title}", f"# {len(solid.triangles)} triangles, metres"]
    lines += [f"v {numbers(v)}" for v in solid.vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in solid.triangles]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="ascii", newline="\n")
    return len(solid.triangles)


class Part(NamedTuple):
    """One shape of a link: ``geometry`` is the inner URDF element, ``xyz`` and ``rpy`` its place in the link."""

    geometry: str
    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Link(NamedTuple):
    """A URDF link: its shapes, both collided with and shown; none for the links inside a compound joint."""

    name: str
    parts: tuple[Part, ...] = ()
    material: str = "skin"


class Joint(NamedTuple):
    """A revolute URDF joint; ``limits`` in degrees, None for a fixed joint."""

    name: str
    parent: str
    child: str
    xyz: tuple[float, float, float]
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axis: tuple[float, float, float] = (0.0, 1.0, 0.0)
    limits: tuple[float, float] | None = None


def mesh(name: str) -> str:
    """URDF geometry of a mesh file beside the URDF."""
    return f"<mesh filename={quoteattr(name)}/>"


def write_urdf(
    path: Path,
    robot: str,
    note: str,
    colours: dict[str, tuple[float, float, float]],
    links: list[Link],
    joints: list[Joint],
) -> None:
    """Write a robot description; every part of a link appears as collision and as visual geometry."""
    lines = ['<?xml version="1.0"?>', f"<!-- {note} -->", f"<robot name={quoteattr(robot)}>"]
    for name, colour in colours.items():
        lines.append(f'  <material name={quoteattr(name)}><color rgba="{numbers(colour)} 1"/></material>')
    for link in links:
        if not link.parts:
            lines.append(f"  <link name={quoteattr(link.name)}/>")
            continue
        lines.append(f"  <link name={quoteattr(link.name)}>")
        for part in link.parts:
            origin = f'<origin xyz="{numbers(part.xyz)}" rpy="{numbers(part.rpy)}"/>'
            geometry = f"<geometry>{part.geometry}</geometry>"
            colour = f"<material name={quoteattr(link.material)}/>"
            lines.append(f"    <visual>{origin}{geometry}{colour}</visual>")
            lines.append(f"    <collision>{origin}{geometry}</collision>")
        lines.append("  </link>")
    for joint in joints:
        lines += _joint(joint)
    lines.append("</robot>")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="ascii", newline="\n")


def _joint(joint: Joint) -> list[str]:
    kind = "fixed" if joint.limits is None else "revolute"
    lines = [
        f'  <joint name={quoteattr(joint.name)} type="{kind}">',
        f"    <parent link={quoteattr(joint.parent)}/><child link={quoteattr(joint.child)}/>",
        f'    <origin xyz="{numbers(joint.xyz)}" rpy="{numbers(joint.rpy)}"/>',
    ]
    if joint.limits is not None:
        low, high = np.radians(joint.limits)
        lines.append(f'    <axis xyz="{numbers(joint.axis)}"/>')
        lines.append(f'    <limit lower="{number(low)}" upper="{number(high)}" effort="10" velocity="20"/>')
    return [*lines, "  </joint>"]
