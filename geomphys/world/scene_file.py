"""The scene file: a strict model of its TOML, and errors that name file, key and value."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from geomphys.errors import SceneError
from geomphys.world.git_lfs import IS_POINTER, is_lfs_pointer
from geomphys.world.scene_fault import explain, fault, one_line
from geomphys.world.sources import note_contents

LARGEST_FILE = 4 * 2**20
"""bytes; a larger scene file is refused."""
MOST_PARTS = 32
"""parts of a dotted key; the parser needs memory by their square"""
UNIT_TOLERANCE = 1e-3
"""How far a quaternion's norm may be from 1."""

_PART = r"""(?:[A-Za-z0-9_-]+|"[^"\n]*"|'[^'\n]*')[ \t]*"""
_LONG_KEY = re.compile(rf"(?:^|[\[{{,])[ \t]*(?:{_PART}\.[ \t]*){{{MOST_PARTS},}}", re.MULTILINE)

_RESERVED = ("world", "recorded")
_SHAPES = ("mesh", "box", "sphere", "cylinder", "capsule", "urdf")


def _sequence(value: object) -> object:
    """TOML arrays come as lists, the model holds tuples."""
    return tuple(value) if isinstance(value, list) else value


def _printable(value: object) -> object:
    """Names and topics go to terminals and channels: no control characters, no blanks around."""
    if isinstance(value, str):
        if not value or value != value.strip():
            raise fault("must not be empty or have blanks around it")
        if len(value) > 512:
            raise fault("is longer than 512 characters")
        if any(not c.isprintable() for c in value):
            raise fault("holds a control character")
    return value


def _plain_name(value: object) -> object:
    """Names of objects, avatars and chains are parts of frame ids and topics."""
    if isinstance(_printable(value), str) and isinstance(value, str):
        if "/" in value or "#" in value:
            raise fault("must not hold '/' or '#'")
        if value in _RESERVED:
            raise fault("is reserved, it names a frame of the output: choose another")
    return value


def _unit(value: object) -> object:
    """Quaternions within `UNIT_TOLERANCE` of norm 1; exactly unit ones stay as they are, bit for bit."""
    if isinstance(value, tuple) and len(value) == 4 and all(isinstance(v, int | float) for v in value):
        norm = math.hypot(*value)
        if math.isfinite(norm):
            if abs(norm - 1.0) > UNIT_TOLERANCE:
                raise fault(f"is not a unit quaternion x y z w: its norm is {norm:.6g}, expected 1")
            if abs(norm - 1.0) > 1e-12:
                return tuple(v / norm for v in value)
    return value


Length: TypeAlias = Annotated[float, Field(ge=1e-6, le=1e5)]
Coordinate: TypeAlias = Annotated[float, Field(ge=-1e6, le=1e6)]
Rate: TypeAlias = Annotated[float, Field(ge=-1e6, le=1e6)]
Direction: TypeAlias = Annotated[tuple[Coordinate, Coordinate, Coordinate], BeforeValidator(_sequence)]
Position: TypeAlias = Annotated[tuple[Coordinate, Coordinate, Coordinate], BeforeValidator(_sequence)]
Velocity: TypeAlias = Annotated[tuple[Rate, Rate, Rate], BeforeValidator(_sequence)]
Quaternion: TypeAlias = Annotated[tuple[float, float, float, float], BeforeValidator(_unit), BeforeValidator(_sequence)]
Lengths2: TypeAlias = Annotated[tuple[Length, Length], BeforeValidator(_sequence)]
Lengths3: TypeAlias = Annotated[tuple[Length, Length, Length], BeforeValidator(_sequence)]
Name: TypeAlias = Annotated[str, BeforeValidator(_plain_name)]
Text: TypeAlias = Annotated[str, BeforeValidator(_printable)]
Pair: TypeAlias = Annotated[tuple[Text, Text], BeforeValidator(_sequence)]
Mass: TypeAlias = Annotated[float, Field(ge=1e-9, le=1e9)]
Density: TypeAlias = Annotated[float, Field(ge=1e-6, le=1e6)]
Decomposition: TypeAlias = Literal["auto", "hull", "coacd"]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, populate_by_name=False)


class SceneTable(_Table):
    """`[scene]`: what holds everywhere."""

    name: Text = "scene"
    gravity: Annotated[
        tuple[
            Annotated[float, Field(ge=-1e4, le=1e4)],
            Annotated[float, Field(ge=-1e4, le=1e4)],
            Annotated[float, Field(ge=-1e4, le=1e4)],
        ],
        BeforeValidator(_sequence),
    ] = Field(default=(0.0, 0.0, -9.81), description="m/s², world frame")


class MaterialPair(_Table):
    """`[[material_pair]]`: restitution and friction of two materials that meet; overrides a built-in pair."""

    materials: Pair
    restitution: Annotated[float, Field(ge=0.0, le=1.0)]
    friction: Annotated[float, Field(ge=0.0, le=100.0)]


class Coupling(_Table):
    """Virtual coupling m A = -K x - R v of the offset x from the recorded pose (equation 6)."""

    stiffness: Annotated[float, Field(ge=1e-3, le=1e9, description="K, N/m")] = 1000.0
    damping: Annotated[float, Field(ge=0.0, le=1e9, description="R, N s/m")] = 40.0


class RootTable(_Table):
    """Pose of an avatar's root link: with a topic the offset tracker_from_root, without one its pose in the world."""

    topic: Text | None = None
    position: Position = (0.0, 0.0, 0.0)
    orientation: Quaternion = (0.0, 0.0, 0.0, 1.0)


class JointsTable(_Table):
    """Where joint angles come from."""

    topic: Text
    unit: Literal["rad", "deg"] | None = Field(default=None, description="default: the message type's own, else rad")
    rename: dict[Text, Text] = Field(default_factory=dict, description="recorded name = joint name of the URDF")

    @model_validator(mode="after")
    def _check(self) -> JointsTable:
        _unique(self.rename.values(), "rename gives two recorded joints the name {!r}")
        return self


class ObjectTable(_Table):
    """`[[object]]`: a thing of the scene."""

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
    material: Text = "wood"
    density: Density | None = Field(default=None, description="kg/m³; 1000 where neither density nor mass is given")
    mass: Mass | None = Field(default=None, description="kg")
    decomposition: Decomposition = "auto"
    velocity: Velocity | None = Field(default=None, description="m/s, of the centre of mass, world frame")
    angular_velocity: Velocity | None = Field(default=None, description="rad/s, world frame")
    topic: Text | None = None
    joints: JointsTable | None = None
    coupling: Coupling | Literal["rigid"] | None = None

    @property
    def shape(self) -> str:
        """Which of mesh, box, sphere, cylinder, capsule, urdf it is."""
        return next(key for key in _SHAPES if getattr(self, key) is not None)

    @model_validator(mode="after")
    def _check(self) -> ObjectTable:
        given = [key for key in _SHAPES if getattr(self, key) is not None]
        if len(given) != 1:
            found = " and ".join(given) if given else "none of them"
            raise fault(f"needs exactly one of {', '.join(_SHAPES)}; it has {found}")
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


class ChainTable(_Table):
    """`[[avatar.chain]]`: the joints between two links, solved by inverse kinematics."""

    name: Name
    base: Text
    tip: Text


class ReachConeTable(_Table):
    """`[[avatar.reach_cone]]`: the polygon of directions a compound joint may point its limb in."""

    joints: Annotated[tuple[Text, ...], BeforeValidator(_sequence), Field(min_length=1, max_length=16)]
    limb: Direction
    directions: Annotated[tuple[Direction, ...], BeforeValidator(_sequence), Field(min_length=3, max_length=128)]

    @model_validator(mode="after")
    def _check(self) -> ReachConeTable:
        _unique(self.joints, "joints names {!r} twice")
        for key, values in (("limb", [self.limb]), ("directions", self.directions)):
            for value in values:
                if math.hypot(*value) < 1e-6:
                    raise fault(f"{key}: {list(value)} has no direction")
        return self


class AvatarTable(_Table):
    """`[[avatar]]`: an articulated body that follows the recorded human."""

    name: Name
    urdf: Text
    mode: Literal["rigid", "chains"] = "rigid"
    material: Text = "human"
    mass: Mass = Field(default=0.4, description="kg, of the coupling")
    density: Density = Field(default=1000.0, description="kg/m³, of its links")
    root: RootTable = RootTable()
    joints: JointsTable | None = None
    coupling: Coupling | Literal["rigid"] = Coupling()
    self_collision: bool = True
    decomposition: Decomposition = "auto"
    ignore_pairs: Annotated[tuple[Pair, ...], BeforeValidator(_sequence)] = ()
    chain: Annotated[tuple[ChainTable, ...], BeforeValidator(_sequence)] = ()
    reach_cone: Annotated[tuple[ReachConeTable, ...], BeforeValidator(_sequence)] = ()

    @model_validator(mode="after")
    def _check(self) -> AvatarTable:
        _unique((c.name for c in self.chain), "two chains are named {!r}")
        return self


class SceneFile(_Table):
    """A whole scene file."""

    scene: SceneTable = SceneTable()
    material_pair: Annotated[tuple[MaterialPair, ...], BeforeValidator(_sequence)] = ()
    object: Annotated[tuple[ObjectTable, ...], BeforeValidator(_sequence)] = ()
    avatar: Annotated[tuple[AvatarTable, ...], BeforeValidator(_sequence)] = ()

    @model_validator(mode="after")
    def _check(self) -> SceneFile:
        _unique([a.name for a in self.avatar] + [o.name for o in self.object], "two objects or avatars are named {!r}")
        _unique(
            (" / ".join(sorted(p.materials)) for p in self.material_pair), "material_pair: the pair {!r} is given twice"
        )
        if not self.object and not self.avatar:
            raise fault("names no object and no avatar")
        return self


_TABLES: dict[str, type[BaseModel]] = {
    "": SceneFile,
    "scene": SceneTable,
    "material_pair": MaterialPair,
    "object": ObjectTable,
    "avatar": AvatarTable,
    "chain": ChainTable,
    "reach_cone": ReachConeTable,
    "root": RootTable,
    "joints": JointsTable,
    "coupling": Coupling,
}


def _unique(values: Iterable[str], text: str) -> None:
    seen: set[str] = set()
    for value in values:
        if value in seen:
            raise fault(text.format(value))
        seen.add(value)


def load_scene_file(path: Path) -> SceneFile:
    """Read and check a scene file.

    Raises
    ------
    SceneError
        One line with the file, the key, its value and what is expected instead. Files it names are not opened here.
    """
    return parse_scene(_read(path), path)


def parse_scene(text: str, path: Path) -> SceneFile:
    """Check the text of a scene file; `path` is what errors call it."""
    if found := _LONG_KEY.search(text):
        line = text[: found.start() + 1].count("\n") + 1
        raise SceneError(f"{path}: line {line}: a key of more than {MOST_PARTS} parts, which no scene file has")
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{path}: not valid TOML: {one_line(str(error))}") from error
    except RecursionError:
        raise SceneError(f"{path}: not valid TOML: tables or arrays are nested too deep") from None
    except ValueError as error:  # a number of more digits than Python converts
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


def _read(path: Path) -> str:
    try:
        if path.is_dir():
            raise SceneError(f"{path}: is a folder, expected a scene file (TOML)")
        if not path.is_file():
            raise SceneError(f"{path}: no such scene file")
        with path.open("rb") as stream:
            data = note_contents(path, stream.read(LARGEST_FILE + 1))
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from error
    if len(data) > LARGEST_FILE:
        raise SceneError(f"{path}: is larger than {LARGEST_FILE // 2**20} MiB, too large for a scene file")
    if is_lfs_pointer(data):
        raise SceneError(f"{path}: {IS_POINTER}")
    if data.startswith(b"\x89MCAP"):
        raise SceneError(f"{path}: is an MCAP log, expected a scene file (TOML); were log and scene swapped?")
    try:
        return data.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise SceneError(f"{path}: line {line}: not UTF-8 text, expected TOML") from error
