"""One motion of a hand as four devices record it: points instead of joint angles, 150 frames at 60 Hz, as JSON.

The hand comes down on a table (0.9 s), rests on it (1.0 to 1.6 s), presses 8 mm into it, and is lifted with a half closed fist.
Each device has its own points, names, axes and faults: noise of 0.7 mm, points that are lost.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from body import Body
from hand_motion import ASSETS, POSTURES
from mcap.writer import CompressionType, Writer
from motion import through
from turns import euler, quaternions, transforms

FRAMES = 150
RATE = 60.0
TABLE_TOP = 0.74
START = 1_760_601_600 * 10**9  # 2025-10-16 08:00 UTC, ns
NOISE = 0.0007  # m
HEIGHT_KEYS = [(0.0, 0.12), (0.2, 0.12), (0.95, 0.0), (1.6, 0.0), (1.8, -0.008), (2.0, -0.008), (2.45, 0.12)]
POSTURE_KEYS = [(0.0, "relaxed"), (0.9, "flat"), (2.0, "flat"), (2.45, "half_fist")]
TRACKER = (-0.02, 0.0, 0.045)  # m, of the root link seen from a tracker on the back of the hand
FINGERS = ("thumb", "index", "middle", "ring", "little")
SEGMENTS = ("metacarpal", "proximal", "intermediate", "distal", "tip")
POINTS = ("palm", "wrist", *(f"{f}_{s}" for f in FINGERS for s in SEGMENTS if (f, s) != ("thumb", "intermediate")))
"""OpenXR's joints, in their order."""


def motion() -> tuple[np.ndarray, np.ndarray]:
    """Positions (frames, 26, 3) of OpenXR's joints and poses (frames, 4, 4) of the root link, world frame."""
    t = np.arange(FRAMES) / RATE
    hand = Body(ASSETS / "hand" / "hand_tips.urdf")
    names = sorted({n for _, posture in POSTURE_KEYS for n in POSTURES[posture] if n in hand.joints})
    angles = {}
    for name in names:
        limits = hand.joints[name].limits
        assert limits is not None
        values = through(t, [(time, np.radians(POSTURES[posture].get(name, 0.0))) for time, posture in POSTURE_KEYS])
        angles[name] = np.clip(values, *limits)
    place = np.column_stack([0.05 * np.sin(1.5 * t), 0.04 * np.sin(2.0 * t), np.zeros(FRAMES)])
    root = transforms(place, np.stack([euler(1.0 * np.sin(v), 4.0, 20.0 + 12.0 * np.sin(1.2 * v)) for v in t]))
    poses = hand.forward(angles, FRAMES)
    root[:, 2, 3] = TABLE_TOP + through(t, HEIGHT_KEYS) - hand.lowest({n: root @ p for n, p in poses.items()})
    points = np.empty((FRAMES, len(POINTS), 3))
    for k, point in enumerate(POINTS):
        points[:, k] = (root @ _link_frames(poses, point))[:, :3, 3]
    return points, root


def _link_frames(poses: dict[str, np.ndarray], point: str) -> np.ndarray:
    """Frames of a point in the root link: of a finger's metacarpal, which no link is, near the wrist."""
    link = point if point.startswith("thumb") else point.replace("intermediate", "middle")
    if link in poses:
        return poses[link]
    finger = point.split("_")[0]
    frames = poses["wrist"].copy()
    frames[:, :3, 3] += 0.35 * (poses[f"{finger}_proximal"][:, :3, 3] - poses["wrist"][:, :3, 3])
    return frames


def _pose(point: np.ndarray) -> dict[str, object]:
    position = {k: None if np.isnan(v) else round(float(v), 5) for k, v in zip("xyz", point, strict=True)}
    return {"position": position, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}


def _header(ns: int, frame: str = "world") -> dict[str, object]:
    return {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}, "frame_id": frame}


def webxr(points: np.ndarray, root: np.ndarray, ns: int) -> list[tuple[str, str, dict[str, object]]]:
    """A headset's browser: 25 joints without the palm, y up."""
    turned = np.column_stack([points[:, 0], points[:, 2], -points[:, 1]])
    stamp = {"sec": ns // 10**9, "nsec": ns % 10**9}
    message = {"timestamp": stamp, "frame_id": "local-floor", "poses": [_pose(p) for p in turned[1:]]}
    return [("/webxr/right_hand", "foxglove.PosesInFrame", message)]


def manus(points: np.ndarray, root: np.ndarray, ns: int) -> list[tuple[str, str, dict[str, object]]]:
    """A glove: nodes of the hand seen from its wrist; a tracker says where that is."""
    inside = (points - points[1]) @ root[:3, :3]
    joints = {"metacarpal": "MCP", "proximal": "PIP", "intermediate": "IP", "distal": "DIP", "tip": "TIP"}
    nodes = []
    for number, (name, point) in enumerate(zip(POINTS[1:], inside[1:], strict=True)):
        finger, _, segment = name.partition("_")
        chain = {"wrist": "Hand", "little": "Pinky"}.get(finger, finger.capitalize())
        joint = joints.get(segment, "Invalid")
        nodes.append(
            {"node_id": number, "parent_node_id": 0, "joint_type": joint, "chain_type": chain, "pose": _pose(point)}
        )
    glove = {
        "glove_id": 0,
        "side": "Right",
        "raw_node_count": len(nodes),
        "raw_nodes": nodes,
        "ergonomics_count": 0,
        "ergonomics": [],
    }
    tracker = root @ np.linalg.inv(transforms(np.array([TRACKER]), euler(0, 0, 0)[None])[0])
    x, y, z, w = (round(float(v), 8) for v in quaternions(tracker[None])[0])
    pose = {**_pose(tracker[:3, 3]), "orientation": {"x": x, "y": y, "z": z, "w": w}}
    return [
        ("/manus_glove_0", "manus_ros2_msgs/msg/ManusGlove", glove),
        ("/tracker/hand", "geometry_msgs/msg/PoseStamped", {"header": _header(ns), "pose": pose}),
    ]


def leap(points: np.ndarray, root: np.ndarray, ns: int) -> list[tuple[str, str, dict[str, object]]]:
    """A camera below the hand: a frame of tf a joint; what it does not see is left out."""
    transforms_of = [
        {
            "header": _header(ns, "leap"),
            "child_frame_id": f"right_{name}",
            "transform": {
                "translation": {k: round(float(v), 5) for k, v in zip("xyz", point, strict=True)},
                "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
            },
        }
        for name, point in zip(POINTS, points, strict=True)
        if not np.isnan(point).any()
    ]
    return [("/tf", "tf2_msgs/msg/TFMessage", {"transforms": transforms_of})]


def isaac(points: np.ndarray, root: np.ndarray, ns: int) -> list[tuple[str, str, dict[str, object]]]:
    """Isaac Teleop's ROS 2 node: names, poses and flags side by side."""
    valid = [not bool(np.isnan(p).any()) for p in points]
    poses = [_pose(np.nan_to_num(p)) for p in points]
    message = {"header": _header(ns), "name": list(POINTS), "pose": poses, "is_valid": valid}
    return [("/xr_teleop/hand", "teleop_ros2_interfaces/msg/NamedPoseArray", message)]


Device = Callable[[np.ndarray, np.ndarray, int], list[tuple[str, str, dict[str, object]]]]
SOURCES: dict[str, tuple[Device, float]] = {
    "webxr_hand": (webxr, 0.0),
    "manus_hand": (manus, 0.0),
    "leap_hand": (leap, 0.08),
    "isaac_hand": (isaac, 0.05),
}
"""Name -> device, and the share of its points that are lost."""


def write(name: str, path: Path) -> Path:
    """Write one recording."""
    device, lost = SOURCES[name]
    points, root = motion()
    rng = np.random.default_rng(19)
    points = points + rng.normal(0.0, NOISE, points.shape)
    points[rng.random(points.shape[:2]) < lost] = np.nan
    channels: dict[str, int] = {}
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start(library="")
        for k in range(FRAMES):
            ns = START + round(k * 1e9 / RATE)
            for topic, schema, message in device(points[k], root[k], ns):
                if topic not in channels:
                    channels[topic] = writer.register_channel(
                        topic, "json", writer.register_schema(schema, "jsonschema", b"{}")
                    )
                writer.add_message(channels[topic], ns, json.dumps(message, separators=(",", ":")).encode(), ns)
        writer.finish()
    return path
