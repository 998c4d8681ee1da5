"""The content of a message: joint values, or poses with their frame ids."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

NAN = math.nan
MISSING = (NAN,) * 7
"""The value of a pose that the message marks as invalid."""

ContentType = Literal["joints", "glove", "pose", "transform", "transforms", "poses", "named_poses"]

CONTENT_NAMES: dict[ContentType, str] = {
    "joints": "joint values",
    "glove": "joint angles in degrees",
    "pose": "a pose",
    "transform": "a pose of a named frame",
    "transforms": "poses by child frame",
    "poses": "poses by index",
    "named_poses": "poses by name",
}
"""What the messages of a topic can be used for, as people read it."""
JOINTS: tuple[ContentType, ...] = ("joints", "glove")
POSES: tuple[ContentType, ...] = ("pose", "transform", "transforms", "poses", "named_poses")
POINTS: tuple[ContentType, ...] = ("transform", "transforms", "poses", "named_poses", "glove")
"""Contents that can hold several points."""
PART_PLACEHOLDERS: dict[ContentType, str] = {"transforms": "CHILD_FRAME", "poses": "INDEX", "named_poses": "NAME"}
"""Content with several poses -> placeholder of the part to name, as ``topic#part``."""


class JointSample(NamedTuple):
    """A message with joint values, in the units of the log."""

    stamp: int | None  # ns, as stamped; None if the message carries no stamp
    names: Sequence[str]
    values: Sequence[float]  # NaN where the log has one; a joint without a value is left out
    side: str  # of a glove: "left", "right" or ""

    @property
    def usable_values(self) -> Sequence[float]:
        """The values that can be assigned to names: none where there are fewer values than names.

        Such messages are valid in ROS (velocities only) and are passed over by its own tools. Of more values than names
        the first ones are those of the names.
        """
        return self.values if len(self.values) >= len(self.names) else ()


class Pose(NamedTuple):
    """A pose.

    `child` tells it from the other poses of its topic: the child frame of a transform, the name of a body, the index in a
    list; "" where a message holds one pose and does not say of what.
    """

    stamp: int | None
    child: str
    value: tuple[
        float, ...
    ]  # (7,) position and quaternion x y z w, as recorded, but in m where the type has another unit
    frame: str = ""  # frame id that it is given in; "" where the message has none


Content = JointSample | list[Pose]
