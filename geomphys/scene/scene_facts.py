"""What a replay and its outputs take from a scene file: plain values, kept with a cached world, which needs no parser then."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from geomphys.scene.primitives import PrimitiveShape
    from geomphys.scene.recording_tables import RecordingTable
    from geomphys.scene.scene_file import SceneFile


@dataclass(frozen=True)
class RecordingFacts:
    """The coordinate system of the log, as `geomphys.scene.recording_tables.RecordingTable`."""

    up: str = "z"
    unit: str = "m"
    frame: tuple[str, ...] = ()
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)  # `up` included
    stated: tuple[str, ...] = ()  # keys that the file has, sorted


@dataclass(frozen=True)
class ObjectFacts:
    """What of an object is shown and attached."""

    name: str
    material: str
    simulated: bool
    mesh: str | None = None  # as the file names it
    primitive: PrimitiveShape | None = None


@dataclass(frozen=True)
class SceneFacts:
    """Of a whole scene file."""

    name: str = "scene"
    recording: RecordingFacts = RecordingFacts()
    avatars: tuple[tuple[str, str], ...] = ()  # name, material
    objects: tuple[ObjectFacts, ...] = ()


def facts_of(file: SceneFile) -> SceneFacts:
    """The facts of a scene file."""
    return SceneFacts(
        name=file.scene.name,
        recording=facts_of_recording(file.recording),
        avatars=tuple((table.name, table.material) for table in file.avatar),
        objects=tuple(
            ObjectFacts(table.name, table.material, table.class_ == "simulated", table.mesh, table.primitive)
            for table in file.object
        ),
    )


def facts_of_recording(table: RecordingTable) -> RecordingFacts:
    """The facts of a `[recording]` table."""
    stated = tuple(sorted(table.model_fields_set))
    return RecordingFacts(table.up, table.unit, table.frame, table.position, table.rotation, stated)
