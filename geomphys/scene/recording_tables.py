"""Scene file tables about the recording: recorded space, root pose topic, joint value topic."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from geomphys.numerics.transforms import quaternion_from_rpy, quaternion_product
from geomphys.scene.scene_file_errors import fault
from geomphys.scene.scene_values import (
    Angles,
    Axis,
    Coordinate,
    Factor,
    FrameIds,
    Position,
    Quaternion,
    Seconds,
    Sign,
    Text,
    rotation_to_z_up,
    sequence,
)

NO_DELAY: Any = Field(default=0.0, description="s, added to the times of the topic: positive makes it later")


class Table(BaseModel):
    """Base of the tables of a scene file: unknown keys, other types and non-finite numbers are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, populate_by_name=False)


class RecordingTable(Table):
    """`[recording]`: coordinate system of the log and its pose in the world.

    A recorded position p is at  position + R(rotation) R(up) (unit p)  in the world, and a recorded rotation q becomes
    rotation up q, where `up` = "y" is the rotation by +90 degrees about x, which takes y to z and z to -y.
    """

    up: Axis = Field(default="z", description="axis of the recorded space that points up")
    unit: Literal["m", "mm", "cm"] = Field(default="m", description="of recorded positions")
    frame: FrameIds = Field(
        default=(), description="frame id of that space in the log, or several that all are; default: found in the log"
    )
    position: Position = Field(default=(0.0, 0.0, 0.0), description="m, of its origin in the world")
    orientation: Quaternion = Field(default=(0.0, 0.0, 0.0, 1.0), description="x y z w, in the world")
    rpy: Angles | None = Field(default=None, description="degrees, instead of orientation")

    @property
    def rotation(self) -> Quaternion:
        """Rotation x y z w from recorded axes to those of the world, `up` included."""
        world_from_z_up = self.orientation if self.rpy is None else quaternion_from_rpy(self.rpy)
        if self.up == "z":
            return world_from_z_up
        x, y, z, w = (float(v) for v in quaternion_product(world_from_z_up, rotation_to_z_up(self.up)))
        return (x, y, z, w)

    @model_validator(mode="after")
    def _check(self) -> RecordingTable:
        check_one_rotation(self, "orientation", "rpy")
        return self


class RootTable(Table):
    """Pose of an avatar's root link: with a topic the offset tracker_from_root, without one its pose in the world."""

    topic: Text | None = None
    delay: Seconds = NO_DELAY
    position: Position = (0.0, 0.0, 0.0)
    orientation: Quaternion = (0.0, 0.0, 0.0, 1.0)
    rpy: Angles | None = Field(default=None, description="roll, pitch, yaw about fixed axes, degrees")
    up: Axis | None = Field(default=None, description="its own axis that points up")

    @property
    def rotation(self) -> Quaternion:
        """Rotation x y z w from `orientation`, `rpy` or `up`."""
        return rotation_of(self.orientation, self.rpy, self.up)

    @model_validator(mode="after")
    def _check(self) -> RootTable:
        check_one_rotation(self, "orientation", "rpy", "up")
        check_delay(self, self.topic)
        return self


class JointsTable(Table):
    """Topic of joint values: q = sign · scale · (recorded value in rad or m) + offset."""

    topic: Text
    delay: Seconds = NO_DELAY
    unit: Literal["rad", "deg"] | None = Field(default=None, description="default: the message type's own, else rad")
    rename: dict[Text, Text] = Field(default_factory=dict, description="recorded name = joint name of the URDF")
    ignore: Annotated[
        tuple[Text, ...],
        BeforeValidator(sequence),
        Field(max_length=1000, description="patterns (*, ?, [...]) of recorded joints that are left out"),
    ] = ()
    sign: dict[Text, Sign] = Field(default_factory=dict, description="joint name of the URDF = 1 or -1")
    offset: dict[Text, Coordinate] = Field(default_factory=dict, description="joint name of the URDF = rad or m")
    scale: dict[Text, Factor] = Field(default_factory=dict, description="joint name of the URDF = factor")

    @model_validator(mode="after")
    def _check(self) -> JointsTable:
        check_unique(self.rename.values(), "rename gives two recorded joints the name {!r}")
        return self


class KeypointsTable(Table):
    """Topic of tracked points of a hand or body, to which joint values are fitted; without `root` its pose too."""

    topic: Text
    delay: Seconds = NO_DELAY
    layout: Literal["openxr", "manus", "mediapipe"] | None = Field(
        default=None, description="order or names of the points of a hand"
    )
    links: dict[Text, Text] = Field(
        default_factory=dict, description="index or name of a point = link whose origin it is; goes before layout"
    )
    scale: Literal["fingers", "hand", "none"] = Field(
        default="fingers", description="bone lengths from the recording: a factor for each finger, one for all, or none"
    )

    @model_validator(mode="after")
    def _check(self) -> KeypointsTable:
        if self.layout is None and not self.links:
            raise fault('keypoints: needs layout = "openxr", "manus" or "mediapipe", or links = { point = "link" }')
        return self


def rotation_of(orientation: Quaternion, rpy: Angles | None, up: Axis | None) -> Quaternion:
    """Rotation x y z w given in one of three forms."""
    if rpy is not None:
        return quaternion_from_rpy(rpy)
    return orientation if up is None else rotation_to_z_up(up)


def check_delay(table: Table, topic: str | None) -> None:
    """Raise an error if a table has a delay and no topic."""
    if topic is None and "delay" in table.model_fields_set:
        raise fault("delay: shifts the times of a topic, and there is none: leave delay out")


def check_unique(values: Iterable[str], text: str) -> None:
    """Raise an error with the first duplicate value."""
    seen: set[str] = set()
    for value in values:
        if value in seen:
            raise fault(text.format(value))
        seen.add(value)


def check_one_rotation(table: Table, *keys: str) -> None:
    """Raise an error if a table gives its rotation by more than one of these keys."""
    given = [key for key in keys if key in table.model_fields_set]
    if len(given) > 1:
        raise fault(f"has both {' and '.join(given)}, each of which is its rotation: keep one of them")
