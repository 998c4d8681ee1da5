"""The whole-body avatar: 15 links with geometry, 32 joints, an adult of 1.75 m in upright stance.

Frames: x ahead, y to the left, z up; at zero all joint frames stand like the pelvis, the root, but for those of the
arms, which hang a little away from the trunk. Every limb is a capsule (a cylinder and two balls) along its z axis.

Segment lengths: fractions of stature after Drillis and Contini, "Body segment parameters", New York University 1966, as
Winter prints them in "Biomechanics and motor control of human movement". Ranges of motion: American Academy of
Orthopaedic Surgeons, 1965. Thicknesses are typical of an adult man.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from files import Joint, Link, Part, number, numbers, write_urdf

STATURE = 1.75
COLOURS = {"skin": (0.85, 0.66, 0.55), "shirt": (0.30, 0.47, 0.62), "trousers": (0.25, 0.26, 0.32)}
LINKS, JOINTS = 15, 32

UPPER_ARM, FOREARM, HAND = 0.186 * STATURE, 0.146 * STATURE, 0.108 * STATURE
THIGH, SHANK = 0.245 * STATURE, 0.246 * STATURE
FOOT_LENGTH, ANKLE_HEIGHT = 0.152 * STATURE, 0.039 * STATURE
SHOULDER_HEIGHT, HIP_HEIGHT = 0.818 * STATURE, 0.530 * STATURE
SHOULDER_HALF, HIP_HALF = 0.129 * STATURE, 0.0955 * STATURE  # half the breadths over the outside

ARM_RADII, FOREARM_RADIUS = 0.044, 0.037
THIGH_RADIUS, SHANK_RADIUS = 0.075, 0.050
TRUNK_RADIUS = 0.090
HANG = 0.20  # rad, how far the arms hang away from the trunk at zero

Limits = tuple[float, float]


class Turn(NamedTuple):
    """One planar joint of a compound joint: name ending, axis, limits in degrees."""

    ending: str
    axis: tuple[float, float, float]
    limits: Limits


BACK, LEFT, UP = (0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def make(folder: Path) -> int:
    """Write ``body.urdf`` into ``folder``; returns the number of its links with geometry."""
    links, joints = _trunk()
    for side, sign in (("right", -1.0), ("left", 1.0)):
        for more_links, more_joints in (_arm(side, sign), _leg(side, sign)):
            links += more_links
            joints += more_joints
    shaped = sum(bool(link.parts) for link in links)
    turning = sum(joint.limits is not None for joint in joints)
    if (shaped, turning) != (LINKS, JOINTS):
        raise ValueError(f"the body has {shaped} links and {turning} joints, wanted {LINKS} and {JOINTS}")
    note = "Whole body, 1.75 m, 32 joints; written by make_assets.py. MIT."
    write_urdf(folder / "body.urdf", "body", note, COLOURS, links, joints)
    return shaped


def capsule(radius: float, length: float, top: tuple[float, float, float] = (0, 0, 0)) -> tuple[Part, ...]:
    """A capsule hanging down from ``top``: its axis runs ``length`` along -z between the centres of its two balls."""
    x, y, z = top
    ball = f'<sphere radius="{number(radius)}"/>'
    tube = f'<cylinder radius="{number(radius)}" length="{number(length)}"/>'
    return Part(tube, (x, y, z - length / 2)), Part(ball, (x, y, z)), Part(ball, (x, y, z - length))


def slab(size: tuple[float, float, float], centre: tuple[float, float, float]) -> Part:
    """A box of full lengths ``size``."""
    return Part(f'<box size="{numbers(size)}"/>', centre)


def compound(
    name: str, parent: str, child: str, place: tuple[float, float, float], turns: tuple[Turn, ...], tilt: float = 0.0
) -> tuple[list[Link], list[Joint]]:
    """Planar joints with one centre at ``place`` in the parent, tilted about x, and the bare links between them."""
    links, joints, above = [], [], parent
    for k, turn in enumerate(turns):
        below = child if k == len(turns) - 1 else f"{name}_{turn.ending}_link"
        if below != child:
            links.append(Link(below))
        first = k == 0
        xyz, rpy = (place, (tilt, 0.0, 0.0)) if first else ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        joints.append(Joint(f"{name}_{turn.ending}", above, below, xyz, rpy, turn.axis, turn.limits))
        above = below
    return links, joints


def _trunk() -> tuple[list[Link], list[Joint]]:
    """Pelvis (the root, its origin between the hip joints), torso and head."""
    waist = 0.12
    torso = SHOULDER_HEIGHT - HIP_HEIGHT - waist
    r = TRUNK_RADIUS
    pelvis = capsule(0.095, 0.02, (0, 0.075, 0.055)) + capsule(0.095, 0.02, (0, -0.075, 0.055))
    pelvis += (slab((0.19, 0.15, 0.02), (0, 0, 0.045)),)
    ribs = [part for y in (-0.085, 0.0, 0.085) for part in capsule(r, torso - 0.13, (0, y, torso - 0.03))]
    chest = slab((1.84 * r, 0.17, torso - 0.13), (0, 0, (torso - 0.03) - (torso - 0.13) / 2))
    head = (
        *capsule(0.052, 0.09, (0.0, 0.0, 0.10)),
        *capsule(0.078, 0.075, (0.018, 0.0, 0.182 * STATURE - 0.078)),
    )
    links = [Link("pelvis", pelvis, "trousers"), Link("torso", (*ribs, chest), "shirt"), Link("head", head)]
    bend = (Turn("y", (0, 1, 0), (-25, 80)), Turn("x", (1, 0, 0), (-35, 35)), Turn("z", UP, (-45, 45)))
    between, joints = compound("waist", "pelvis", "torso", (0, 0, waist), bend)
    nod = (Turn("z", UP, (-60, 60)), Turn("y", (0, 1, 0), (-45, 45)), Turn("x", (1, 0, 0), (-45, 45)))
    inside, more = compound("neck", "torso", "head", (0, 0, torso), nod)
    return links + between + inside, joints + more


def _arm(side: str, sign: float) -> tuple[list[Link], list[Joint]]:
    """Shoulder (three joints, raising ahead first), elbow, and a wrist that also carries the forearm's rotation."""
    torso = SHOULDER_HEIGHT - HIP_HEIGHT - 0.12
    arm, forearm, hand = f"{side}_upper_arm", f"{side}_forearm", f"{side}_hand"
    palm, fingers = 0.47 * HAND, 0.53 * HAND
    links = [
        Link(arm, capsule(ARM_RADII, UPPER_ARM), "shirt"),
        Link(forearm, capsule(FOREARM_RADIUS, FOREARM)),
        Link(
            hand,
            (
                slab((0.084, 0.030, palm), (0.0, 0.0, -palm / 2)),
                slab((0.076, 0.022, fingers), (0.0, 0.0, -palm - fingers / 2)),
            ),
        ),
    ]
    out = (sign, 0.0, 0.0)
    shoulder = (Turn("y", BACK, (-60, 180)), Turn("x", out, (-45, 170)), Turn("z", (0, 0, -sign), (-90, 70)))
    place = (0.0, sign * (SHOULDER_HALF - ARM_RADII), torso - 0.02)
    a, joints = compound(f"{side}_shoulder", "torso", arm, place, shoulder, sign * HANG)
    joints.append(Joint(f"{side}_elbow", arm, forearm, (0, 0, -UPPER_ARM), axis=BACK, limits=(0, 150)))
    wrist = (
        Turn("z", (0, 0, -sign), (-80, 80)),
        Turn("x", (-sign, 0, 0), (-70, 80)),
        Turn("y", BACK, (-30, 20)),
    )
    b, more = compound(f"{side}_wrist", forearm, hand, (0, 0, -FOREARM), wrist)
    return links + a + b, joints + more


def _leg(side: str, sign: float) -> tuple[list[Link], list[Joint]]:
    """Hip (three joints), knee and ankle; the sole is the ground at zero."""
    thigh, shank, foot = f"{side}_thigh", f"{side}_shank", f"{side}_foot"
    sole = slab((FOOT_LENGTH, 0.09, 0.05), (FOOT_LENGTH / 2 - 0.07, 0, 0.025 - ANKLE_HEIGHT))
    links = [
        Link(thigh, capsule(THIGH_RADIUS, THIGH), "trousers"),
        Link(shank, capsule(SHANK_RADIUS, SHANK), "trousers"),
        Link(foot, (sole,), "skin"),
    ]
    hip = (Turn("y", BACK, (-30, 120)), Turn("x", (sign, 0, 0), (-30, 45)), Turn("z", (0, 0, -sign), (-45, 45)))
    a, joints = compound(f"{side}_hip", "pelvis", thigh, (0, sign * (HIP_HALF - THIGH_RADIUS), 0), hip)
    joints.append(Joint(f"{side}_knee", thigh, shank, (0, 0, -THIGH), axis=(0, 1, 0), limits=(0, 135)))
    ankle = (Turn("y", BACK, (-50, 20)), Turn("x", (sign, 0, 0), (-20, 35)))
    b, more = compound(f"{side}_ankle", shank, foot, (0, 0, -SHANK), ankle)
    return links + a + b, joints + more
