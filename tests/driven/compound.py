"""A shoulder of three joints with a reach cone, as a small scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geomphys.driven.links import Links, make_links
from geomphys.load import load_world
from geomphys.scene.world import World
from tests.scene.models import joint, link, urdf

CONE = [[0.9, 0.1, -0.3], [0.5, 0.8, -0.3], [-0.6, 0.7, -0.4], [-0.7, -0.3, -0.6], [0.3, -0.8, -0.5]]
NOTCHED = [[0.9, 0.1, 0.3], [0.1, 0.15, -1.0], [-0.6, 0.9, 0.2], [-0.7, -0.3, -0.6], [0.3, -0.8, -0.5]]

CAPSULE = '<origin xyz="0 0 {}"/><geometry><cylinder radius="0.02" length="0.2"/></geometry>'


def limit(low: float, high: float, axis: str, extra: str = "") -> str:
    return f'<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" effort="1" velocity="1"/>{extra}'


def shoulder(folder: Path, directions: list[list[float]], limits: float = 2.6) -> World:
    """An arm hanging down from a turned joint frame; limits are ± `limits` rad."""
    turning = {axis: limit(-limits, limits, axis) for axis in ("0 1 0", "1 0 0", "0 0.1 1")}
    urdf(
        folder / "arm.urdf",
        *(link(name) for name in ("torso", "y", "pad", "x")),
        *(link(name, CAPSULE.format(-0.15)) for name in ("upper", "lower")),
        joint("sy", "torso", "y", xyz='0 0.2 0.4" rpy="0.2 -0.1 0.4', inside=turning["0 1 0"]),
        joint("pad", "y", "pad", "fixed", xyz='0 0 0" rpy="0.1 0.2 -0.3'),
        joint("sx", "pad", "x", xyz="0 0 0", inside=turning["1 0 0"]),
        joint("sz", "x", "upper", xyz="0 0 0", inside=turning["0 0.1 1"]),
        joint("elbow", "upper", "lower", xyz="0 0 -0.3", inside=limit(-2.5, 0.1, "0 1 0")),
    )
    (folder / "scene.toml").write_text(f"""
[[avatar]]
name = "arm"
urdf = "arm.urdf"
mode = "chains"
material = "human"
[[avatar.chain]]
name = "arm"
base = "torso"
tip = "lower"
[[avatar.reach_cone]]
joints = ["sy", "sx", "sz"]
limb = [0.1, 0.0, -1.0]
directions = {directions}
""")
    return load_world(folder / "scene.toml")


def joints_of(world: World) -> Links:
    """Which joints yield, with levers of 0.3 m."""
    made = make_links(world.scene)
    return made._replace(lever=np.full(len(made.lever), 0.3))
