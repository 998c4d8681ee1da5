"""Logs of a tracked hand that rests on a table in several ways, with the tracker's offset and the table known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from mcap.writer import Writer
from scipy.spatial.transform import Rotation

from geomphys.authoring.surface_gaps import GapMeter
from geomphys.load import load_world
from geomphys.numerics.transforms import compose, invert, matrix_from_pose, pose_from_matrix, quaternion_from_rpy
from geomphys.scene.scaled_urdf import scaled_urdf
from geomphys.scene.world import World
from tests.keypoints.hands import hand_urdf

S = 10**9
OFFSET = ((0.02, -0.01, 0.035), (5.0, -10.0, 20.0))
"""Position [m] and rpy [degrees] of the root link seen from the tracker."""
HEIGHT = 0.75
"""m, of the table's top."""
HELD = 0.5
"""s that the hand rests in each way."""
MOVED = 0.5
"""s between two."""
FLAT = ((0, 0, 0), (0, 0, 50), (0, 0, -40))
"""Ways to rest, rpy [degrees] of the root link: palm down, turned about the vertical."""
ALL_WAYS = (*FLAT, (85, 0, 0), (0, 75, 20), (-80, 10, 0), (0, 60, 120), (95, 10, 60), (10, 80, -70))
"""Palm down, on either side, on the fingertips."""
CHANGES = (
    *(f"offset along {a}" for a in "xyz"),
    *(f"rotation of the offset about {a}" for a in "xyz"),
    "height of 'table'",
    *(f"tilt of 'table' about {a}" for a in "xy"),
)
"""What `calibrate` seeks in these logs."""
SCENE = """# my desk
[[avatar]]
name = "hand"
urdf = "hand.urdf"
root = {{ topic = "/tracker", position = {position}, rpy = {rpy} }}   # measured with a ruler
joints = {{ topic = "/glove" }}

[[object]]
name = "table"
class = "fixed"
box = [2.0, 2.0, 0.1]      # oak
position = [0.1, 0.0, {z}]
rpy = {tilt}
"""


def write_scene(folder: Path, *, position=OFFSET[0], rpy=OFFSET[1], height=HEIGHT, tilt=(0.0, 0.0, 0.0)) -> Path:
    (folder / "hand.urdf").write_text(hand_urdf())
    path = folder / "scene.toml"
    path.write_text(SCENE.format(position=list(position), rpy=list(rpy), z=height - 0.05, tilt=list(tilt)))
    return path


def write_log(
    folder: Path,
    ways=ALL_WAYS,
    *,
    rate=60.0,
    noise=0.0,
    lag=0.0,
    height=HEIGHT,
    tilt=(0.0, 0.0, 0.0),
    outliers=0,
    factors=None,
    moves=False,
) -> Path:
    """A log ``/tracker`` and ``/glove`` of a hand that rests on the table of `write_scene` in each of `ways`, from 0.5 s on.

    `factors` of the lengths of its links; whether its fingers move while it moves.
    """
    scene = write_scene(folder, height=height, tilt=tilt)
    if factors is not None:
        (folder / "long.urdf").write_bytes(scaled_urdf(folder / "hand.urdf", factors))
        scene.write_text(scene.read_text().replace("hand.urdf", "long.urdf"))
    world, rng = load_world(scene), np.random.default_rng(5)
    tracker_from_root = matrix_from_pose([*OFFSET[0], *quaternion_from_rpy(OFFSET[1])])
    bends = [0.15 * (k % 3) if moves else 0.0 for k in range(len(ways))]
    resting = resting_poses(world, ways, bends, height)
    path = folder / "log.mcap"
    total = len(ways) * (HELD + MOVED) + MOVED
    frames = int(total * rate)
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        tracker = writer.register_channel(
            "/tracker", "json", writer.register_schema("geometry_msgs/msg/PoseStamped", "jsonschema", b"{}")
        )
        glove = writer.register_channel(
            "/glove", "json", writer.register_schema("sensor_msgs/msg/JointState", "jsonschema", b"{}")
        )
        for k in range(frames):
            t = k / rate
            number = min(int(t / (HELD + MOVED)), len(ways) - 1)
            since = t - number * (HELD + MOVED)
            share = 0.5 - 0.5 * np.cos(np.pi * min(since / MOVED, 1.0))
            root = between(resting[max(number - 1, 0)], resting[number], share)
            bend = (1 - share) * bends[max(number - 1, 0)] + share * bends[number]
            root[2] += 0.15 * np.sin(np.pi * since / MOVED) ** 2 if since < MOVED else 0.0
            if outliers and k % outliers == 0:
                root[2] += 0.02
            root[:3] += rng.normal(0, noise, 3)
            pose = pose_from_matrix(compose(matrix_from_pose(root), invert(tracker_from_root)))
            _write(writer, tracker, S + round(t * S), {"pose": _pose(pose)})
            joints = list(world.dof_names)
            _write(writer, glove, S + round((t + lag) * S), {"name": joints, "position": [bend] * len(joints)})
        writer.finish()
    return path


def resting_poses(world: World, ways, bends, height: float) -> list[np.ndarray]:
    """Poses (7,) of the root link in which the hand of `write_scene` rests on the table, its fingers bent by `bends`."""
    meter, roots = GapMeter(world), world.scene.trees.rest.copy()
    resting = []
    for k, rotation in enumerate(ways):
        roots[0] = [0.1 * np.cos(2.4 * k), 0.1 * np.sin(2.4 * k), height + 0.2, *quaternion_from_rpy(rotation)]
        for _ in range(30):
            roots[0, 2] -= meter.lowest_gap(0, 1, roots, np.full(len(world.dof_names), bends[k]))
        resting.append(roots[0].copy())
    return resting


def deviations_of_touches(folder: Path, ways, noise: float) -> dict[str, float]:
    """Standard deviations that touches in each of `ways` allow, in 2 mm and degrees, by differences of their gaps.

    `noise` [m] of a touch. With it, 50 mm and 10 degrees are expected of the offset, 50 mm and 5 degrees of the table.
    """
    world = load_world(write_scene(folder))
    meter, roots = GapMeter(world), world.scene.trees.rest.copy()
    table, still = roots[1].copy(), np.zeros(len(world.dof_names))
    tracker_from_root = matrix_from_pose([*OFFSET[0], *quaternion_from_rpy(OFFSET[1])])

    def gap(root: np.ndarray, change: np.ndarray) -> float:
        offset, turned = tracker_from_root.copy(), matrix_from_pose(table)
        offset[:3, 3] += 0.002 * change[:3]
        offset[:3, :3] = Rotation.from_rotvec(change[3:6], degrees=True).as_matrix() @ offset[:3, :3]
        tilt = Rotation.from_rotvec([change[7], change[8], 0.0], degrees=True).as_matrix()
        turned[:3, :3] = tilt @ turned[:3, :3]
        turned[:3, 3] = tilt @ (table[:3] - [0, 0, HEIGHT]) + [0, 0, HEIGHT + 0.002 * change[6]]
        world_from_tracker = compose(matrix_from_pose(root), invert(tracker_from_root))
        roots[0], roots[1] = pose_from_matrix(compose(world_from_tracker, offset)), pose_from_matrix(turned)
        return meter.lowest_gap(0, 1, roots, still)

    small = 0.02 * np.eye(9)
    jacobian = np.array([
        [(gap(root, change) - gap(root, -change)) / 0.04 for change in small]
        for root in resting_poses(world, ways, [0.0] * len(ways), HEIGHT)
    ])  # fmt: skip
    prior = np.array([25.0, 25, 25, 10, 10, 10, 25, 5, 5]) ** -2.0
    covariance = np.linalg.inv(jacobian.T @ jacobian / noise**2 + np.diag(prior))
    return dict(zip(CHANGES, np.sqrt(np.diag(covariance)), strict=True))


def between(first: np.ndarray, second: np.ndarray, share: float) -> np.ndarray:
    """Pose (7,) between two."""
    other = second.copy()
    other[3:] *= 1.0 if first[3:] @ second[3:] >= 0.0 else -1.0
    pose: np.ndarray = (1 - share) * first + share * other
    pose[3:] /= np.linalg.norm(pose[3:])
    return pose


def stretches(ways=ALL_WAYS) -> list[tuple[float, float]]:
    """The stretches of `write_log` in which the hand rests."""
    return [(k * (HELD + MOVED) + MOVED + 0.05, (k + 1) * (HELD + MOVED) - 0.05) for k in range(len(ways))]


def _pose(pose: np.ndarray) -> dict[str, object]:
    return {
        "position": dict(zip("xyz", map(float, pose[:3]), strict=True)),
        "orientation": dict(zip("xyzw", map(float, pose[3:]), strict=True)),
    }


def _write(writer: Writer, channel: int, ns: int, message: dict[str, object]) -> None:
    header = {"stamp": {"sec": ns // S, "nanosec": ns % S}, "frame_id": "world"}
    writer.add_message(channel, ns, json.dumps({"header": header, **message}).encode(), ns)
