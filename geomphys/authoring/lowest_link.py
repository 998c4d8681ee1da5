"""Computes the lowest height of the links of a drafted avatar over a log, to place a table below them."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from geomphys.numerics.transforms import matrix_from_pose
from geomphys.recording.channels import JointSample, kind_of, make_message_reader
from geomphys.recording.decoders import BadMessageError
from geomphys.recording.input_plan import split_topic
from geomphys.recording.pose_tuples import PoseTuple
from geomphys.recording.reader import open_log
from geomphys.recording.recorded_space import RecordedSpace
from geomphys.recording.streams import VALUE_LIMIT, validated_pose
from geomphys.scene.skeleton import Skeleton
from geomphys.storage.remote_files import AnyPath

MAX_POSES = 400
"""Approximate number of poses evaluated (at most twice as many)."""


def lowest_link(
    log: AnyPath,
    skeleton: Skeleton,
    root: str,
    joints: str,
    names: Mapping[str, str],
    degrees: bool,
    space: RecordedSpace,
    *,
    recover: bool,
) -> float | None:
    """Lowest height [m] of a link's origin in evenly chosen frames of a log; None without a good pose.

    Parameters
    ----------
    log, recover
        As for `inspect_log`.
    skeleton : Skeleton
    root, joints : str
        Topics (``topic#part``) of the root's pose and of the joints; "" without.
    names
        Recorded joint -> joint of the URDF.
    degrees : bool
        Whether the recorded angles are in degrees.
    space : RecordedSpace
        The space of the recorded poses.
    """
    columns = {name: i for i, name in enumerate(skeleton.dof_names)}
    column_of = {recorded: columns[joint] for recorded, joint in names.items()}
    revolute = {j.name for j in skeleton.joints if j is not None and j.type != "prismatic"}
    scale = np.array([math.pi / 180.0 if degrees and n in revolute else 1.0 for n in skeleton.dof_names])
    angles = np.zeros(len(columns))
    first: NDArray[np.float64] | None = None  # angles of the first joint message; used for earlier poses
    poses: list[PoseTuple] = []
    sampled_angles: list[NDArray[np.float64] | None] = []
    with open_log(log, recover=recover) as reader:
        root_topic, child = split_topic(root, reader.topics)
        joints_topic, side = split_topic(joints, reader.topics)
        readers = {}
        for key, channel in reader.channels.items():
            kind = kind_of(channel)
            if kind is not None and channel.topic in (root_topic, joints_topic):
                readers[key] = make_message_reader(channel, kind)
        stride = max(
            1, sum(reader.channels[k].messages for k in readers if reader.channels[k].topic == root_topic) // MAX_POSES
        )
        messages_seen = 0
        for raw in reader.read(set(readers)):
            try:
                content = readers[raw.key](raw.data)
            except BadMessageError:
                continue
            if isinstance(content, JointSample):
                if side and content.side != side:
                    continue
                for name, value in zip(content.names, content.usable_values, strict=False):
                    if name in column_of and abs(value) < VALUE_LIMIT:
                        angles[column_of[name]] = value
                first = angles * scale if first is None else first
                continue
            valid_poses = [
                pose
                for p in content
                if (not child or p.child == child) and (pose := validated_pose(p.value)) is not None
            ]
            messages_seen += 1
            if valid_poses and (messages_seen - 1) % stride == 0:
                poses.append(valid_poses[0])
                sampled_angles.append(None if first is None else angles * scale)
    if not poses:
        return None
    initial_angles = np.zeros(len(columns)) if first is None else first
    world_from_root = matrix_from_pose(np.array([space.to_world(space.to_metres(pose)) for pose in poses]))
    links = skeleton.forward(np.array([initial_angles if a is None else a for a in sampled_angles]), world_from_root)
    return float(links[..., 2, 3].min())
