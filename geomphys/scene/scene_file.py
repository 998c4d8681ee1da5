"""Reads and validates scene files (TOML, pydantic models); errors name file, key and value."""

from __future__ import annotations

import math
import re
import tomllib
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BaseModel, BeforeValidator, Field, ValidationError, model_validator

from geomphys.errors import SceneError
from geomphys.scene.git_lfs import IS_POINTER, is_lfs_pointer
from geomphys.scene.primitives import PRIMITIVES, PrimitiveShape
from geomphys.scene.recording_tables import (
    NO_DELAY,
    JointsTable,
    KeypointsTable,
    RecordingTable,
    RootTable,
    Table,
    check_delay,
    check_one_rotation,
    check_unique,
    rotation_of,
)
from geomphys.scene.scene_file_errors import explain, fault, one_line
from geomphys.scene.scene_values import (
    Angles,
    Axis,
    Decomposition,
    Density,
    Direction,
    Length,
    Lengths2,
    Lengths3,
    Mass,
    Name,
    Pair,
    Position,
    Quaternion,
    Seconds,
    Text,
    Velocity,
    sequence,
)
from geomphys.scene.source_files import track_contents
from geomphys.storage.remote_files import AnyPath

MAX_FILE_BYTES = 4 * 2**20
"""bytes; a larger scene file is refused."""
MAX_KEY_PARTS = 32
"""parts of a dotted key; tomllib needs memory quadratic in them"""
_KEY_PART = r"""(?:[A-Za-z0-9_-]+|"[^"\n]*"|'[^'\n]*')[ \t]*"""
_LONG_KEY = re.compile(rf"(?:^|[\[{{,])[ \t]*(?:{_KEY_PART}\.[ \t]*){{{MAX_KEY_PARTS},}}", re.MULTILINE)

_SHAPES = ("mesh", *PRIMITIVES, "urdf")


class SceneTable(Table):
    """`[scene]`: global settings."""

    name: Text = "scene"
    gravity: Annotated[
        tuple[
            Annotated[float, Field(ge=-1e4, le=1e4)],
            Annotated[float, Field(ge=-1e4, le=1e4)],
            Annotated[float, Field(ge=-1e4, le=1e4)],
        ],
        BeforeValidator(sequence),
    ] = Field(default=(0.0, 0.0, -9.81), description="m/s², world frame")


class MaterialPair(Table):
    """`[[material_pair]]`: restitution and friction of two materials in contact; overrides a built-in pair."""

    materials: Pair
    restitution: Annotated[float, Field(ge=0.0, le=1.0)]
    friction: Annotated[float, Field(ge=0.0, le=100.0)]


class Coupling(Table):
    """Virtual coupling m A = -K x - R v of the offset x from the recorded pose (equation 6)."""

    stiffness: Annotated[
        float, Field(ge=1e-3, le=1e9, description="K, N/m: what is recorded 1 mm inside presses with K / 1000 N")
    ] = 1000.0
    damping: Annotated[float, Field(ge=0.0, le=1e9, description="R, N s/m")] = 40.0


Effort: TypeAlias = Annotated[float, Field(gt=0.0, le=1e9)] | None
EFFORT = Field(
    default=None,
    description="N: its coupling presses with no more; of joints without an effort limit of their own, N at the fingertip",
)
Squeeze: TypeAlias = Annotated[float, Field(ge=0.0, le=0.1)]
SQUEEZE = Field(default=0.0, description="m: how much deeper than recorded it presses what is simulated")


class ObjectTable(Table):
    """`[[object]]`: a fixed, simulated or driven body."""

    name: Name
    class_: Literal["fixed", "simulated", "driven"] = Field(alias="class")
    mesh: Text | None = None
    box: Lengths3 | None = Field(default=None, description="full edge lengths x, y, z, m")
    sphere: Length | None = Field(default=None, description="radius, m")
    cylinder: Lengths2 | None = Field(default=None, description="radius and full height along z, m")
    capsule: Lengths2 | None = Field(default=None, description="radius and height along z without the caps, m")
    urdf: Text | None = None
    scale: Annotated[float, Field(ge=1e-6, le=1e6)] = Field(default=1.0, description="of the mesh")
    position: Position = (0.0, 0.0, 0.0)
    orientation: Quaternion = (0.0, 0.0, 0.0, 1.0)
    rpy: Angles | None = Field(default=None, description="roll, pitch, yaw about fixed axes, degrees")
    up: Axis | None = Field(default=None, description="its own axis that points up")
    material: Text = "wood"
    density: Density | None = Field(default=None, description="kg/m³; 1000 where neither density nor mass is given")
    mass: Mass | None = Field(default=None, description="kg")
    decomposition: Decomposition = "auto"
    velocity: Velocity | None = Field(default=None, description="m/s, of the centre of mass, world frame")
    angular_velocity: Velocity | None = Field(default=None, description="rad/s, world frame")
    topic: Text | None = None
    delay: Seconds = NO_DELAY
    joints: JointsTable | None = None
    coupling: Coupling | Literal["rigid"] | None = None
    effort_n: Effort = EFFORT
    squeeze: Squeeze = SQUEEZE

    @property
    def rotation(self) -> Quaternion:
        """Rotation x y z w from `orientation`, `rpy` or `up`."""
        return rotation_of(self.orientation, self.rpy, self.up)

    @property
    def shape(self) -> str:
        """The shape key that is set: mesh, urdf or the name of a primitive."""
        return next(key for key in _SHAPES if getattr(self, key) is not None)

    @property
    def primitive(self) -> PrimitiveShape | None:
        """The primitive that it is; None for a mesh or a URDF."""
        if self.shape not in PRIMITIVES:
            return None
        lengths = getattr(self, self.shape)
        return PrimitiveShape(self.shape, lengths if isinstance(lengths, tuple) else (lengths,))

    @model_validator(mode="after")
    def _check(self) -> ObjectTable:
        given = [key for key in _SHAPES if getattr(self, key) is not None]
        if len(given) != 1:
            found = " and ".join(given) if given else "none of them"
            raise fault(f"needs exactly one of {', '.join(_SHAPES)}; it has {found}")
        check_one_rotation(self, "orientation", "rpy", "up")
        check_delay(self, self.topic)
        kind, only = self.class_, "only an object with class = "
        if self.density is not None and self.mass is not None:
            raise fault("has both density and mass: keep one of them")
        if kind == "simulated" and self.topic is not None:
            raise fault("topic: a simulated object follows no topic; use class driven or fixed, or leave topic out")
        if kind == "driven" and self.topic is None:
            raise fault("topic: a driven object needs the topic it follows")
        for key in ("velocity", "angular_velocity"):
            if kind != "simulated" and getattr(self, key) is not None:
                raise fault(f"{key}: {only}simulated has one, this is {kind}")
        if kind != "driven" and self.coupling is not None:
            raise fault(f"coupling: {only}driven has one, this is {kind}")
        for key, unset in (("effort_n", None), ("squeeze", 0.0)):
            if kind != "driven" and getattr(self, key) != unset:
                raise fault(f"{key}: {only}driven has one, this is {kind}")
        if self.urdf is not None:
            if kind != "fixed":
                raise fault(f"urdf: an articulated object must have class = fixed, this is {kind}")
            if self.mass is not None:
                raise fault("mass: an articulated object has a density, not a mass")
        elif self.joints is not None:
            raise fault("joints: only an object with a urdf has joints")
        if self.mesh is None and self.scale != 1.0:
            raise fault(f"scale = {self.scale}: only a mesh is scaled; state the lengths of a {self.shape} themselves")
        if self.mesh is None and self.urdf is None and self.decomposition != "auto":
            raise fault(f"decomposition = {self.decomposition!r}: a {self.shape} is exact, only meshes are decomposed")
        return self


class ChainTable(Table):
    """`[[avatar.chain]]`: the joints between two links, solved by inverse kinematics."""

    name: Name
    base: Text
    tip: Text


class ReachConeTable(Table):
    """`[[avatar.reach_cone]]`: polygon of allowed limb directions of a compound joint."""

    joints: Annotated[tuple[Text, ...], BeforeValidator(sequence), Field(min_length=1, max_length=16)]
    limb: Direction
    directions: Annotated[tuple[Direction, ...], BeforeValidator(sequence), Field(min_length=3, max_length=128)]

    @model_validator(mode="after")
    def _check(self) -> ReachConeTable:
        check_unique(self.joints, "joints names {!r} twice")
        for key, values in (("limb", [self.limb]), ("directions", self.directions)):
            for value in values:
                if math.hypot(*value) < 1e-6:
                    raise fault(f"{key}: {list(value)} has no direction")
        return self


class AvatarTable(Table):
    """`[[avatar]]`: an articulated body that follows the recorded human."""

    name: Name
    urdf: Text
    mode: Literal["auto", "rigid", "chains"] = "auto"
    material: Text = "human"
    mass: Mass = Field(default=0.4, description="kg, of the coupling")
    density: Density = Field(default=1000.0, description="kg/m³, of its links")
    root: RootTable = RootTable()
    joints: JointsTable | None = None
    keypoints: KeypointsTable | None = None
    coupling: Coupling | Literal["rigid"] = Coupling()
    effort_n: Effort = EFFORT
    squeeze: Squeeze = SQUEEZE
    self_collision: bool = True
    decomposition: Decomposition = "auto"
    ignore_pairs: Annotated[tuple[Pair, ...], BeforeValidator(sequence)] = ()
    chain: Annotated[tuple[ChainTable, ...], BeforeValidator(sequence)] = ()
    reach_cone: Annotated[tuple[ReachConeTable, ...], BeforeValidator(sequence)] = ()

    @model_validator(mode="after")
    def _check(self) -> AvatarTable:
        check_unique((c.name for c in self.chain), "two chains are named {!r}")
        if self.joints is not None and self.keypoints is not None:
            raise fault("has both joints and keypoints, each of which gives its joint values: keep one of them")
        return self


class SceneFile(Table):
    """A scene file."""

    scene: SceneTable = SceneTable()
    recording: RecordingTable = RecordingTable()
    material_pair: Annotated[tuple[MaterialPair, ...], BeforeValidator(sequence)] = ()
    object: Annotated[tuple[ObjectTable, ...], BeforeValidator(sequence)] = ()
    avatar: Annotated[tuple[AvatarTable, ...], BeforeValidator(sequence)] = ()

    @model_validator(mode="after")
    def _check(self) -> SceneFile:
        check_unique(
            [a.name for a in self.avatar] + [o.name for o in self.object], "two objects or avatars are named {!r}"
        )
        check_unique(
            (" / ".join(sorted(p.materials)) for p in self.material_pair), "material_pair: the pair {!r} is given twice"
        )
        if not self.object and not self.avatar:
            raise fault("names no object and no avatar")
        return self


_TABLES: dict[str, type[BaseModel]] = {
    "": SceneFile,
    "scene": SceneTable,
    "recording": RecordingTable,
    "material_pair": MaterialPair,
    "object": ObjectTable,
    "avatar": AvatarTable,
    "chain": ChainTable,
    "reach_cone": ReachConeTable,
    "root": RootTable,
    "joints": JointsTable,
    "keypoints": KeypointsTable,
    "coupling": Coupling,
}


def load_scene_file(path: AnyPath) -> SceneFile:
    """Read and check a scene file.

    Raises
    ------
    SceneError
        One line with the file, the key, its value and what is expected instead. Files it names are not opened.
    """
    return parse_scene(_read(path), path)


def parse_scene(text: str, path: AnyPath) -> SceneFile:
    """Validate the text of a scene file; `path` names it in errors."""
    if found := _LONG_KEY.search(text):
        line = text[: found.start() + 1].count("\n") + 1
        raise SceneError(f"{path}: line {line}: a key of more than {MAX_KEY_PARTS} parts, which no scene file has")
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{path}: not valid TOML: {one_line(str(error))}") from error
    except RecursionError:
        raise SceneError(f"{path}: not valid TOML: tables or arrays are nested too deep") from None
    except ValueError as error:  # an integer with more digits than Python converts
        raise SceneError(f"{path}: not valid TOML: {one_line(str(error))}") from error
    try:
        return SceneFile.model_validate(table)
    except RecursionError:
        raise SceneError(f"{path}: tables or arrays are nested too deep") from None
    except ValidationError as error:
        raise SceneError(f"{path}: {explain(error, table, _TABLES)}") from None


def scene_json_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of the scene file."""
    schema = SceneFile.model_json_schema(by_alias=True)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": "geomphys scene file"}


def _read(path: AnyPath) -> str:
    try:
        if path.is_dir():
            raise SceneError(f"{path}: is a folder, expected a scene file (TOML)")
        if not path.is_file():
            raise SceneError(f"{path}: no such scene file")
        with path.open("rb") as stream:
            data = track_contents(path, stream.read(MAX_FILE_BYTES + 1))
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from error
    if len(data) > MAX_FILE_BYTES:
        raise SceneError(f"{path}: is larger than {MAX_FILE_BYTES // 2**20} MiB, too large for a scene file")
    if is_lfs_pointer(data):
        raise SceneError(f"{path}: {IS_POINTER}")
    if data.startswith(b"\x89MCAP"):
        raise SceneError(f"{path}: is an MCAP log, expected a scene file (TOML); were log and scene swapped?")
    try:
        return data.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise SceneError(f"{path}: line {line}: not UTF-8 text, expected TOML") from error
