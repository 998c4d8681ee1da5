"""What the hand recordings share: postures, glove angles that never keep still, and the tracker on the wrist."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
from body import Body
from motion import Restless, mixed
from turns import inverse, product, quaternions, small_turns, transforms

ASSETS = Path(__file__).resolve().parent.parent / "assets"
FINGERS = ("index", "middle", "ring", "little")
WRIST_TOPIC = "/tracker/wrist"
GLOVE_TOPIC = "/glove/joint_states"


def fingers(mcp: float, pip: float, dip: float, spread: float = 0.0, **others: float) -> dict[str, float]:
    """A posture in degrees with all four fingers bent alike; other joints by name."""
    posture = {"index_mcp_abd": spread, "ring_mcp_abd": 0.7 * spread, "little_mcp_abd": 1.3 * spread}
    for k, finger in enumerate(FINGERS):
        posture |= {f"{finger}_mcp_flex": mcp + k, f"{finger}_pip_flex": pip + 1.5 * k, f"{finger}_dip_flex": dip + k}
    return posture | others


POSTURES: dict[str, dict[str, float]] = {
    "relaxed": fingers(
        24, 30, 16, 1, thumb_cmc_abd=4, thumb_mcp_flex=12, thumb_ip_flex=14, wrist_flex=-12, wrist_dev=-3
    ),
    "open": fingers(
        3, 9, 6, 6, thumb_cmc_abd=-6, thumb_cmc_flex=-12, thumb_mcp_flex=4, thumb_ip_flex=2, wrist_flex=-18
    ),
    "half_fist": fingers(
        48, 58, 30, 0, thumb_cmc_abd=14, thumb_cmc_flex=6, thumb_mcp_flex=24, thumb_ip_flex=26, wrist_flex=-8
    ),
    "pointing": fingers(50, 66, 34, 0, thumb_cmc_abd=12, thumb_mcp_flex=26, thumb_ip_flex=22, wrist_flex=-14)
    | {"index_mcp_flex": 8, "index_pip_flex": 12, "index_dip_flex": 7},
    "flat": fingers(
        6, 10, 7, 3, thumb_cmc_abd=-14, thumb_cmc_flex=-10, thumb_mcp_flex=6, thumb_ip_flex=5, wrist_flex=-24
    ),
    "sweep": fingers(16, 20, 10, 0, thumb_cmc_abd=-4, thumb_mcp_flex=10, thumb_ip_flex=8, wrist_flex=-6, wrist_dev=-10),
    "cocked": fingers(66, 92, 52, 0, thumb_cmc_abd=10, thumb_mcp_flex=20, thumb_ip_flex=25, wrist_flex=-14)
    | {"index_mcp_flex": 60, "index_pip_flex": 95, "index_dip_flex": 45, "index_mcp_abd": 9},
    "flicked": fingers(66, 92, 52, 0, thumb_cmc_abd=10, thumb_mcp_flex=20, thumb_ip_flex=25, wrist_flex=-14)
    | {"index_mcp_flex": 44, "index_pip_flex": 12, "index_dip_flex": 6, "index_mcp_abd": 9},
}


def load_hand() -> Body:
    """The articulated right hand of the assets."""
    return Body(ASSETS / "hand" / "hand.urdf")


def glove(
    hand: Body,
    restless: Restless,
    keys: list[tuple[float, str]],
    liveliness: np.ndarray | float = 1.0,
    postures: dict[str, dict[str, float]] = POSTURES,
) -> dict[str, np.ndarray]:
    """Angles of all joints over time: postures, plus drift of some degrees and a trace of tremor, inside the limits.

    ``liveliness`` (n,) scales the drift: a hand pressed on a table keeps its fingers stiller.
    """
    angles = mixed(restless.t, postures, keys)
    lively = {}
    for name in hand.moving:
        size = 1.6 if "abd" in name or "dev" in name else 3.0 if "wrist" in name else 3.6
        drift = liveliness * np.radians(restless.wander(size, 0.1, 0.7))
        base = angles.get(name, np.zeros(len(restless.t)))
        lively[name] = base + drift + np.radians(restless.wander(0.03, 8.0, 12.0))
    return hand.inside_limits(lively)


def unsteady(restless: Restless, turns: np.ndarray, degrees: float) -> np.ndarray:
    """Quaternions (n, 4) with a slow drift of some degrees and a small tremor added."""
    wobble = np.radians(restless.drift(degrees)) + np.radians(restless.tremor(0.05))
    return product(turns, small_turns(wobble))


def root_from_offset(scene: Path) -> np.ndarray:
    """(1, 4, 4) tracker_from_root of the first avatar of a scene file."""
    root = tomllib.loads(scene.read_text(encoding="utf-8"))["avatar"][0]["root"]
    return transforms(np.array([root["position"]], dtype=float), np.array([root["orientation"]], dtype=float))


def tracker(world_from_palm: np.ndarray, links: dict[str, np.ndarray], scene: Path) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) and quaternions (n, 4) of the tracker on the forearm that put the palm where it is wanted."""
    world_from_tracker = world_from_palm @ inverse(links["palm"]) @ inverse(root_from_offset(scene))
    return world_from_tracker[:, :3, 3], quaternions(world_from_tracker)


def palm_links(links: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The same poses in the palm's frame."""
    palm_from_root = inverse(links["palm"])
    return {name: palm_from_root @ pose for name, pose in links.items()}


def turned(links: dict[str, np.ndarray], turns: np.ndarray) -> dict[str, np.ndarray]:
    """Poses in the palm's frame, turned by the palm's quaternions (n, 4)."""
    turn = transforms(np.zeros((len(turns), 3)), turns)
    return {name: turn @ pose for name, pose in links.items()}
