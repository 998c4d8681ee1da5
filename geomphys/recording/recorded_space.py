"""The recorded space: transforms recorded poses (unit, up axis, `[recording]` pose) to the world of the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from geomphys.recording.pose_tuples import IDENTITY, PoseTuple, compose
from geomphys.scene.scene_facts import RecordingFacts


@dataclass(frozen=True)
class RecordedSpace:
    """The frame of reference of recorded poses, and its pose in the world.

    A recorded position p [units of the log] is at  t + R p / n  in the world, n the units in a metre; a recorded rotation
    r becomes  R r. R is the rotation of `[recording]`: with ``up = "y"`` first the right-handed rotation by +90 degrees
    about x, under which (x, y, z) becomes (x, -z, y), then `orientation` or `rpy`; t is its `position` [m]. Only the space is
    rotated: a body's own axes, and so the offset from a tracker to a root, stay as they are.
    """

    world_from_space: PoseTuple = IDENTITY
    units_per_metre: float = 1.0

    @classmethod
    def from_table(cls, table: RecordingFacts) -> RecordedSpace:
        """The space that a scene file's `[recording]` describes."""
        return cls((*table.position, *table.rotation), {"m": 1.0, "cm": 100.0, "mm": 1000.0}[table.unit])

    def to_metres(self, pose: Sequence[float]) -> PoseTuple:
        """Convert the position of a recorded pose to metres; unchanged to the bit where that is the log's unit."""
        if self.units_per_metre == 1.0:
            return tuple(pose)
        x, y, z, *rotation = pose
        n = self.units_per_metre
        return (x / n, y / n, z / n, *rotation)

    def to_world(self, pose: PoseTuple) -> PoseTuple:
        """Pose in the world of a pose in this space [m]; unchanged to the bit where the space is the world."""
        return pose if self.world_from_space == IDENTITY else compose(self.world_from_space, pose)

    def world_position(self, position: Sequence[float]) -> tuple[float, float, float]:
        """Position in the world [m] of a recorded one [units of the log]."""
        x, y, z = self.to_world((*self.to_metres((*position, *IDENTITY[3:]))[:3], *IDENTITY[3:]))[:3]
        return (x, y, z)
