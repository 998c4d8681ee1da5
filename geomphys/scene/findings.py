"""Findings about a valid scene: skipped visuals, links without collision geometry, renamed frames, default materials."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

MAX_REASONS = 3
"""Skipped visuals of one model that its warning lists."""


@dataclass(frozen=True)
class NotShown:
    """A visual of a URDF that cannot be read and is skipped."""

    urdf: str
    reason: str  # link name and problem


@dataclass(frozen=True)
class RenamedFrame:
    """A link whose name is already the id of another frame of the output."""

    body: str  # avatar/link
    link: str
    frame: str  # its frame id in the output


@dataclass(frozen=True)
class DefaultPair:
    """Two materials that can come into contact and have no pair, and the values derived for it."""

    materials: tuple[str, str]
    owners: tuple[str, str]  # names of an object or avatar of each material
    restitution: float
    friction: float


@dataclass(frozen=True, kw_only=True)
class Findings:
    """Warnings and notes from reading a scene."""

    not_shown: tuple[NotShown, ...] = ()
    sizes: tuple[str, ...] = ()  # warnings of lengths that are probably not in metres
    without_collision: tuple[str, ...] = ()  # names of bodies with visuals but no collision geometry
    renamed_frames: tuple[RenamedFrame, ...] = ()
    default_pairs: tuple[DefaultPair, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Probable mistakes in the scene, one line each."""
        return (*self._not_shown(), *self.sizes)

    @property
    def notes(self) -> tuple[str, ...]:
        """Facts that may surprise but are no mistakes, one line each."""
        return tuple(
            f"link {renamed.link!r} of {renamed.body.partition('/')[0]!r} has the frame id {renamed.frame!r} in the "
            f"output: {renamed.link!r} is another frame there"
            for renamed in self.renamed_frames
        )

    def _not_shown(self) -> Iterator[str]:
        by_urdf: dict[str, list[str]] = {}
        for entry in self.not_shown:
            by_urdf.setdefault(entry.urdf, []).append(entry.reason)
        for urdf, reasons in by_urdf.items():
            what = "a visual is" if len(reasons) == 1 else f"{len(reasons)} visuals are"
            rest = f"; and {len(reasons) - MAX_REASONS} more" if len(reasons) > MAX_REASONS else ""
            yield f"{urdf}: {what} not shown: {'; '.join(reasons[:MAX_REASONS])}{rest}"
