"""How low the links of a drafted avatar come in a log: where a table is first put."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from geomphys.numerics.transforms import matrix_from_pose
from geomphys.recording.channels import Joints, kind_of, make_reader
from geomphys.recording.decoders import BadMessageError
from geomphys.recording.plan import split_topic
from geomphys.recording.reader import open_log
from geomphys.recording.space import RecordedSpace
from geomphys.recording.streams import VALUE_LIMIT, Seven, good_pose
from geomphys.scene.skeleton import Skeleton
from geomphys.storage.remote_files import AnyPath

SAMPLES = 400
"""Poses that are looked at, at most twice as many."""


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
    used = {recorded: columns[joint] for recorded, joint in names.items()}
    turning = {j.name for j in skeleton.joints if j is not None and j.type != "prismatic"}
    scale = np.array([math.pi / 180.0 if degrees and n in turning else 1.0 for n in skeleton.dof_names])
    angles = np.zeros(len(columns))
    first: NDArray[np.float64] | None = (
        None  # angles of the first message with joints: what comes before it has them too
    )
    poses: list[Seven] = []
    taken: list[NDArray[np.float64] | None] = []
    with open_log(log, recover=recover) as reader:
        root_topic, child = split_topic(root, reader.topics)
        joints_topic, side = split_topic(joints, reader.topics)
        reading = {}
        for key, channel in reader.channels.items():
            kind = kind_of(channel)
            if kind is not None and channel.topic in (root_topic, joints_topic):
                reading[key] = make_reader(channel, kind)
        stride = max(
            1, sum(reader.channels[k].messages for k in reading if reader.channels[k].topic == root_topic) // SAMPLES
        )
        samples_seen = 0
        for raw in reader.read(set(reading)):
            try:
                content = reading[raw.key](raw.data)
            except BadMessageError:
                continue
            if isinstance(content, Joints):
                if side and content.side != side:
                    continue
                for name, value in zip(content.names, content.sample, strict=False):
                    if name in used and abs(value) < VALUE_LIMIT:
                        angles[used[name]] = value
                first = angles * scale if first is None else first
                continue
            good = [
                pose for p in content if (not child or p.child == child) and (pose := good_pose(p.value)) is not None
            ]
            samples_seen += 1
            if good and (samples_seen - 1) % stride == 0:
                poses.append(good[0])
                taken.append(None if first is None else angles * scale)
    if not poses:
        return None
    begin = np.zeros(len(columns)) if first is None else first
    world_from_root = matrix_from_pose(np.array([space.to_world(space.metres(pose)) for pose in poses]))
    links = skeleton.forward(np.array([begin if a is None else a for a in taken]), world_from_root)
    return float(links[..., 2, 3].min())
