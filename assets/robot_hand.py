"""A robot hand of boxes and capsules: three fingers and a thumb, joints named as on many robot hands (FFJ4 to THJ1).

x along the stretched fingers, z out of the back of the hand, y towards the thumb; the root is the palm, its origin the
middle of the wrist.
"""

from __future__ import annotations

from pathlib import Path

from files import Joint, Link, Part, write_urdf

FINGERS = {"FF": (0.095, 0.028), "MF": (0.1, 0.0), "RF": (0.095, -0.028)}
SEGMENTS = (0.045, 0.028, 0.022)
THUMB = (0.035, 0.03, 0.025)
RADIUS = 0.008


def bone(length: float) -> tuple[Part, ...]:
    """A capsule along x from the joint on, as a cylinder and its cap."""
    cylinder = Part(f'<cylinder radius="{RADIUS}" length="{length}"/>', (length / 2, 0.0, 0.0), (0.0, 1.570796327, 0.0))
    return (cylinder, Part(f'<sphere radius="{RADIUS}"/>', (length, 0.0, 0.0)))


def make(folder: Path) -> int:
    """Write the URDF; returns how many joints move."""
    links = [Link("palm", (Part('<box size="0.09 0.075 0.024"/>', (0.045, 0.0, 0.0)),))]
    joints = []
    for finger, (x, y) in FINGERS.items():
        links.append(Link(f"{finger.lower()}_knuckle"))
        joints.append(Joint(f"{finger}J4", "palm", links[-1].name, (x, y, 0.0), axis=(0.0, 0.0, 1.0), limits=(-20, 20)))
        reach = 0.0
        for number, length, limits in zip((3, 2, 1), SEGMENTS, ((-10, 90), (0, 100), (0, 90)), strict=True):
            above, name = links[-1].name, f"{finger.lower()}_{number}"
            links.append(Link(name, bone(length)))
            joints.append(Joint(f"{finger}J{number}", above, name, (reach, 0.0, 0.0), limits=limits))
            reach = length
    links.append(Link("th_base"))
    joints.append(
        Joint("THJ4", "palm", "th_base", (0.02, 0.04, -0.005), (0.9, 0.0, 0.9), (0.0, 0.0, 1.0), limits=(-30, 60))
    )
    reach = 0.0
    for number, length in zip((3, 2, 1), THUMB, strict=True):
        above, name = links[-1].name, f"th_{number}"
        links.append(Link(name, bone(length)))
        joints.append(Joint(f"THJ{number}", above, name, (reach, 0.0, 0.0), limits=(-10, 80)))
        reach = length
    note = "Robot hand of three fingers and a thumb, written by robot_hand.py"
    links = [link._replace(material="metal") for link in links]
    write_urdf(folder / "robot_hand_right.urdf", "robot_hand_right", note, {"metal": (0.6, 0.62, 0.66)}, links, joints)
    return len(joints)
