"""Reads messages for the points they hold: poses of which only the position needs to be good."""

from __future__ import annotations

from collections.abc import Callable, Collection

from geomphys.errors import LogError
from geomphys.recording.channels import JointSample, Pose, kind_of, make_message_reader, unsupported_reason
from geomphys.recording.reader import LogChannel
from geomphys.recording.samples import POINTS
from geomphys.recording.streams import VALUE_LIMIT, validated_pose


def make_point_reader(channel: LogChannel, *, whole: Collection[str] = ()) -> Callable[[bytes], list[Pose]]:
    """Make the function from a message's bytes to its points.

    Where the orientation is no unit quaternion it becomes 0 0 0 1; not of poses named in `whole`, which something follows as
    poses. The function raises BadMessageError. Raises LogError for a channel without points.
    """
    kind = kind_of(channel)
    if kind is None:
        raise LogError(f"topic {channel.topic!r} {unsupported_reason(channel, POINTS, 'points')}")
    read = make_message_reader(channel, kind, points=True)

    def points(data: bytes) -> list[Pose]:
        content = read(data)
        assert not isinstance(content, JointSample)
        return [pose if pose.child in whole else _as_point(pose) for pose in content]

    return points


def _as_point(pose: Pose) -> Pose:
    x, y, z = pose.value[:3]
    if validated_pose(pose.value) is None and abs(x) + abs(y) + abs(z) < VALUE_LIMIT:
        return pose._replace(value=(x, y, z, 0.0, 0.0, 0.0, 1.0))
    return pose
