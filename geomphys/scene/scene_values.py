"""Annotated types of the values in a scene file: names, lengths, rotations, with their bounds."""

from __future__ import annotations

import math
from typing import Annotated, Literal, TypeAlias

from pydantic import BeforeValidator, Field, WithJsonSchema

from geomphys.numerics.transforms import quaternion_from_rpy
from geomphys.scene.scene_file_errors import fault

UNIT_TOLERANCE = 1e-2
"""Allowed deviation of a quaternion's norm from 1; within it, it is normalised."""
MAX_DELAY_S = 600.0
"""s; largest shift of the times of a topic"""

_RESERVED = ("world", "recorded")
_RPY_TO_Z_UP = {"z": (0.0, 0.0, 0.0), "y": (90.0, 0.0, 0.0)}  # rpy that takes this axis to z


def sequence(value: object) -> object:
    """Convert a TOML array (list) to the tuple of the model."""
    return tuple(value) if isinstance(value, list) else value


def _printable_text(value: object) -> object:
    """Require printable text of at most 512 characters without surrounding blanks."""
    if isinstance(value, str):
        if not value or value != value.strip():
            raise fault("must not be empty or have blanks around it")
        if len(value) > 512:
            raise fault("is longer than 512 characters")
        if any(not c.isprintable() for c in value):
            raise fault("holds a control character")
    return value


def _name_without_separators(value: object) -> object:
    """Require a name usable in frame ids and topics: no '/', no '#', not reserved."""
    if isinstance(_printable_text(value), str) and isinstance(value, str):
        if "/" in value or "#" in value:
            raise fault("must not hold '/' or '#'")
        if value in _RESERVED:
            raise fault("is reserved, it names a frame of the output: choose another")
    return value


def _unit_quaternion(value: object) -> object:
    """Normalise a quaternion within `UNIT_TOLERANCE` of norm 1; exact ones stay bit for bit."""
    if isinstance(value, tuple) and len(value) == 4 and all(isinstance(v, int | float) for v in value):
        norm = math.hypot(*value)
        if math.isfinite(norm):
            if abs(norm - 1.0) > UNIT_TOLERANCE:
                raise fault(f"is not a unit quaternion x y z w: its norm is {norm:.6g}, expected 1")
            if abs(norm - 1.0) > 1e-12:
                return tuple(v / norm for v in value)
    return value


def _as_tuple(value: object) -> object:
    """Convert a single string to a tuple of one."""
    return (value,) if isinstance(value, str) else sequence(value)


def _as_integer(value: object) -> object:
    """Convert 1.0 to 1; booleans are errors."""
    if isinstance(value, bool):
        raise fault("expected 1 or -1")
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _factor(value: object) -> object:
    """Refuse zero, which would fix a joint silently."""
    if isinstance(value, int | float) and value == 0:
        raise fault("would make the joint stand still: leave the joint out by `ignore` instead")
    return value


Length: TypeAlias = Annotated[float, Field(ge=1e-6, le=1e5)]
Coordinate: TypeAlias = Annotated[float, Field(ge=-1e6, le=1e6)]
Rate: TypeAlias = Annotated[float, Field(ge=-1e6, le=1e6)]
Direction: TypeAlias = Annotated[tuple[Coordinate, Coordinate, Coordinate], BeforeValidator(sequence)]
Position: TypeAlias = Annotated[tuple[Coordinate, Coordinate, Coordinate], BeforeValidator(sequence)]
Velocity: TypeAlias = Annotated[tuple[Rate, Rate, Rate], BeforeValidator(sequence)]
Quaternion: TypeAlias = Annotated[
    tuple[float, float, float, float], BeforeValidator(_unit_quaternion), BeforeValidator(sequence)
]
Degrees: TypeAlias = Annotated[float, Field(ge=-3600.0, le=3600.0)]
Angles: TypeAlias = Annotated[tuple[Degrees, Degrees, Degrees], BeforeValidator(sequence)]
Axis: TypeAlias = Literal["y", "z"]
Seconds: TypeAlias = Annotated[float, Field(ge=-MAX_DELAY_S, le=MAX_DELAY_S)]
Sign: TypeAlias = Annotated[Literal[1, -1], BeforeValidator(_as_integer)]
Factor: TypeAlias = Annotated[float, Field(ge=-1e6, le=1e6), BeforeValidator(_factor)]
Lengths2: TypeAlias = Annotated[tuple[Length, Length], BeforeValidator(sequence)]
Lengths3: TypeAlias = Annotated[tuple[Length, Length, Length], BeforeValidator(sequence)]
Name: TypeAlias = Annotated[str, BeforeValidator(_name_without_separators)]
Text: TypeAlias = Annotated[str, BeforeValidator(_printable_text)]
FrameIds: TypeAlias = Annotated[
    tuple[Text, ...],
    Field(min_length=1),
    BeforeValidator(_as_tuple),
    WithJsonSchema(
        {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}], "default": []}
    ),
]
Pair: TypeAlias = Annotated[tuple[Text, Text], BeforeValidator(sequence)]
Mass: TypeAlias = Annotated[float, Field(ge=1e-9, le=1e9)]
Density: TypeAlias = Annotated[float, Field(ge=1e-6, le=1e6)]
Decomposition: TypeAlias = Literal["auto", "hull", "coacd"]


def rotation_to_z_up(axis: Axis) -> tuple[float, float, float, float]:
    """Rotation x y z w that takes `axis` to z: identity for z, +90 degrees about x for y (z goes to -y)."""
    return quaternion_from_rpy(_RPY_TO_Z_UP[axis])
