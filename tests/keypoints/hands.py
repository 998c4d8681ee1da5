"""A small hand as URDF, its links in OpenXR's order, and logs of their positions in every kind of message."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mcap.writer import Writer

from geomphys.numerics.transforms import matrix_from_pose
from geomphys.recording.message_kinds import HAND_JOINTS
from geomphys.scene.skeleton import Skeleton, load_skeleton

S = 10**9
FINGERS = ("thumb", "index", "middle", "ring", "little")
LENGTHS = {"thumb": (0.045, 0.035, 0.03), "little": (0.035, 0.022, 0.02)}
_CAPSULE = (
    '<collision><origin xyz="{half} 0 0" rpy="0 1.5708 0"/>'
    '<geometry><capsule radius="0.007" length="{length}"/></geometry></collision>'
)
_PALM = '<collision><geometry><box size="0.05 0.06 0.014"/></geometry></collision>'


def hand_urdf(*, tips: bool = True, prefix: str = "") -> str:
    """A right hand: root link `wrist`, fingers along x with spread and three flexions, thumb to the side with a twist more."""
    parts = [f'<robot name="hand"><link name="{prefix}wrist">{_PALM}</link>']

    def link(name: str, length: float) -> None:
        parts.append(
            f'<link name="{prefix}{name}">{_CAPSULE.format(half=length / 2, length=length) if length else ""}</link>'
        )

    def joint(
        name: str, kind: str, parent: str, at: str, axis: str, limits: tuple[float, float] = (0, 0), rpy: str = "0 0 0"
    ) -> None:
        parts.append(
            f'<joint name="{prefix}{name}_j" type="{kind}"><origin xyz="{at}" rpy="{rpy}"/><parent link="{prefix}{parent}"/>'
            f'<child link="{prefix}{name}"/><axis xyz="{axis}"/>'
            f'<limit lower="{limits[0]}" upper="{limits[1]}" effort="1" velocity="1"/></joint>'
        )

    for k, finger in enumerate(FINGERS):
        a, b, c = LENGTHS.get(finger, (0.045, 0.026, 0.022))
        if finger == "thumb":
            link("thumb_twist", 0)
            link("thumb_spread", 0)
            joint("thumb_twist", "revolute", "wrist", "0.02 0.03 0", "1 0 0", (-1, 1), "0 0 0.8")
            joint("thumb_spread", "revolute", "thumb_twist", "0 0 0", "0 0 1", (-0.6, 0.6))
            names = ("thumb_metacarpal", "thumb_proximal", "thumb_distal")
            joint(names[0], "revolute", "thumb_spread", "0 0 0", "0 1 0", (-0.5, 0.8))
        else:
            link(f"{finger}_spread", 0)
            joint(f"{finger}_spread", "revolute", "wrist", f"0.09 {0.025 - 0.02 * (k - 1)} 0", "0 0 1", (-0.35, 0.35))
            names = (f"{finger}_proximal", f"{finger}_middle", f"{finger}_distal")
            joint(names[0], "revolute", f"{finger}_spread", "0 0 0", "0 1 0", (-0.4, 1.6))
        for name, length in zip(names, (a, b, c), strict=True):
            link(name, length)
        joint(names[1], "revolute", names[0], f"{a} 0 0", "0 1 0", (0, 1.8))
        joint(names[2], "revolute", names[1], f"{b} 0 0", "0 1 0", (0, 1.4))
        if tips:
            link(f"{finger}_tip", 0)
            joint(f"{finger}_tip", "fixed", names[2], f"{c} 0 0", "1 0 0")
    return "".join([*parts, "</robot>"])


def write_hand(folder: Path, **options: object) -> Skeleton:
    """Write the hand to ``hand.urdf``."""
    path = folder / "hand.urdf"
    path.write_text(hand_urdf(**options))  # type: ignore[arg-type]
    return load_skeleton(path)


def link_of(point: str) -> str:
    """Link of a joint of OpenXR, by the names of `hand_urdf`."""
    return point if point.startswith("thumb") else point.replace("intermediate", "middle")


def motion(skeleton: Skeleton, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Smooth angles (n, Q) within the limits, and root poses (n, 7)."""
    t = np.arange(frames)[:, None] / 60.0
    middle, half = (skeleton.upper + skeleton.lower) / 2, (skeleton.upper - skeleton.lower) / 2
    phase = np.arange(len(middle))
    angles = middle + 0.8 * half * np.sin(2.0 * t + phase)
    roots = np.zeros((frames, 7))
    roots[:, :3] = np.column_stack([0.2 * np.sin(t), 0.1 * np.cos(2 * t), 0.9 + 0.05 * np.sin(3 * t)])
    half_turn = 0.5 * np.sin(t[:, 0])
    roots[:, 4], roots[:, 6] = np.sin(half_turn), np.cos(half_turn)
    return angles, roots


def openxr_points(skeleton: Skeleton, angles: np.ndarray, roots: np.ndarray) -> np.ndarray:
    """(n, 26, 3) positions of OpenXR's joints; NaN for those without a link."""
    links = [link.name for link in skeleton.links]
    poses = skeleton.forward(angles, matrix_from_pose(roots))
    points = np.full((len(angles), 26, 3), np.nan)
    for k, point in enumerate(HAND_JOINTS):
        if link_of(point) in links:
            points[:, k] = poses[:, links.index(link_of(point)), :3, 3]
    return points


def _pose(point: Sequence[float]) -> dict[str, object]:
    values = [None if v != v else float(v) for v in point]
    orientation = values[3:] or (0.0, 0.0, 0.0, 1.0)
    return {
        "position": dict(zip("xyz", values, strict=False)),
        "orientation": dict(zip("xyzw", orientation, strict=True)),
    }


def write_points(
    path: Path, points: np.ndarray, kind: str = "PoseArray", *, rate: float = 60.0, side: str = "right"
) -> Path:
    """Write points (n, 26, 3), or poses (n, 26, 7), as JSON messages of a kind, on ``/hand`` (``/tf`` for TFMessage)."""
    schema = {
        "PoseArray": "geometry_msgs/msg/PoseArray",
        "PosesInFrame": "foxglove.PosesInFrame",
        "NamedPoseArray": "motion_capture_tracking_interfaces/msg/NamedPoseArray",
        "teleop": "teleop_ros2_interfaces/msg/NamedPoseArray",
        "RigidBodies": "mocap4r2_msgs/msg/RigidBodies",
        "TFMessage": "tf2_msgs/msg/TFMessage",
        "ManusGlove": "manus_ros2_msgs/msg/ManusGlove",
    }[kind]
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        topic = "/tf" if kind == "TFMessage" else "/hand"
        channel = writer.register_channel(topic, "json", writer.register_schema(schema, "jsonschema", b"{}"))
        for k, frame in enumerate(points):
            ns = S + round(k * S / rate)
            message = json.dumps(_message(kind, frame, ns, side)).encode()
            writer.add_message(channel, ns, message, ns)
        writer.finish()
    return path


def _message(kind: str, points: np.ndarray, ns: int, side: str) -> dict[str, object]:
    stamp = {"sec": ns // S, "nanosec": ns % S}
    header = {"stamp": stamp, "frame_id": "world"}
    named = list(zip(HAND_JOINTS, points, strict=False))
    known = [(n, p) for n, p in named if not np.isnan(p).any()]
    if kind == "PoseArray":
        return {"header": header, "poses": [_pose(p) for p in points]}
    if kind == "PosesInFrame":
        return {"timestamp": {"sec": ns // S, "nsec": ns % S}, "frame_id": "world", "poses": [_pose(p) for p in points]}
    if kind == "NamedPoseArray":
        return {"header": header, "poses": [{"name": f"{side}_{n}", "pose": _pose(p)} for n, p in known]}
    if kind == "RigidBodies":
        return {
            "header": header,
            "rigidbodies": [{"rigid_body_name": f"{side}_{n}", "pose": _pose(p)} for n, p in known],
        }
    if kind == "teleop":
        valid = [not np.isnan(p).any() for p in points]
        return {
            "header": header,
            "name": list(HAND_JOINTS),
            "pose": [_pose(np.nan_to_num(p)) for p in points],
            "is_valid": valid,
        }
    if kind == "TFMessage":
        moved = {"translation": "position", "rotation": "orientation"}
        return {
            "transforms": [
                {
                    "header": header,
                    "child_frame_id": f"{side}_{n}",
                    "transform": {to: _pose(p)[at] for to, at in moved.items()},
                }
                for n, p in known
            ]
        }
    manus = {"metacarpal": "MCP", "proximal": "PIP", "intermediate": "IP", "distal": "DIP", "tip": "TIP"}
    nodes = []
    for number, (name, point) in enumerate(n for n in named if n[0] != "palm"):
        finger, _, segment = name.partition("_")
        finger = {"little": "pinky", "wrist": "hand"}.get(finger, finger).capitalize()
        kind_of_joint = manus.get(segment, "Invalid")
        nodes.append(
            {
                "node_id": number,
                "parent_node_id": 0,
                "joint_type": kind_of_joint,
                "chain_type": finger,
                "pose": _pose(point),
            }
        )
    return {
        "glove_id": 1,
        "side": side.capitalize(),
        "raw_node_count": 25,
        "raw_nodes": nodes,
        "ergonomics_count": 0,
        "ergonomics": [],
    }


def write_scene(folder: Path, keypoints: str = 'topic = "/hand", layout = "openxr"', more: str = "") -> Path:
    """A scene with the hand of ``hand.urdf`` and a table well below it."""
    path = folder / "scene.toml"
    path.write_text(
        f'[[avatar]]\nname = "hand"\nurdf = "hand.urdf"\nkeypoints = {{ {keypoints} }}\n{more}\n'
        '[[object]]\nname = "table"\nclass = "fixed"\nbox = [1.0, 1.0, 0.1]\nposition = [0.0, 0.0, -1.0]\n'
    )
    return path
