"""What the whole-body recordings share: a body that stands, sways a little, and moves from posture to posture."""

from __future__ import annotations

import numpy as np
from body import Body
from hand_motion import ASSETS
from motion import Restless, mixed
from turns import small_turns

PELVIS_TOPIC = "/tracker/pelvis"
JOINTS_TOPIC = "/body/joint_states"
HIP_HEIGHT = 0.530 * 1.75


def load_body() -> Body:
    """The whole-body avatar of the assets."""
    return Body(ASSETS / "body" / "body.urdf")


def moved(
    body: Body, restless: Restless, postures: dict[str, dict[str, float]], keys: list[tuple[float, str]]
) -> dict[str, np.ndarray]:
    """Angles of all joints (rad): postures in degrees, plus the sway of a standing person, inside the limits."""
    angles = mixed(restless.t, postures, keys)
    swaying = {}
    for name in body.moving:
        legs = any(part in name for part in ("hip", "knee", "ankle"))
        size = 0.15 if legs else 0.5 if "waist" in name else 1.2
        base = angles.get(name, np.zeros(len(restless.t)))
        trembling = np.radians(restless.wander(0.02, 8.0, 12.0))
        swaying[name] = base + np.radians(restless.wander(size, 0.1, 0.6)) + (0 if legs else trembling)
    return body.inside_limits(swaying)


def pelvis(restless: Restless, x: np.ndarray | float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) and quaternions (n, 4) of a pelvis that stands over the origin, ``x`` ahead of it, and sways."""
    positions = restless.drift(0.003)
    positions[:, 2] = HIP_HEIGHT + 0.3 * positions[:, 2]
    positions[:, 0] += x
    turns = small_turns(np.radians(restless.drift(0.4)))
    return positions, turns / np.linalg.norm(turns, axis=1, keepdims=True)
