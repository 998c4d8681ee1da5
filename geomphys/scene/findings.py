"""What a user should know of a world that can be replayed: what is not shown, cannot touch, is named otherwise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

TOLD = 3
"""faults of a model's visuals that its warning tells in full"""


@dataclass(frozen=True)
class NotShown:
    """A visual of a URDF that is left out."""

    urdf: str
    reason: str  # link, what is wrong


@dataclass(frozen=True)
class RenamedFrame:
    """A link whose own name is another frame id of the output."""

    body: str  # avatar/link
    link: str
    frame: str  # its frame id in the output


@dataclass(frozen=True)
class DefaultPair:
    """Two materials that can meet and have no pair, and what is taken for it."""

    materials: tuple[str, str]
    owners: tuple[str, str]  # trees that can meet
    restitution: float
    friction: float


@dataclass(frozen=True, kw_only=True)
class Findings:
    """All of it."""

    not_shown: tuple[NotShown, ...] = ()
    sizes: tuple[str, ...] = ()  # lengths that look as if they were in another unit
    without_collision: tuple[str, ...] = ()  # bodies with a visual that have no collision geometry
    renamed_frames: tuple[RenamedFrame, ...] = ()
    default_pairs: tuple[DefaultPair, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is probably not as meant, a line each."""
        return (*self._not_shown(), *self.sizes)

    @property
    def notes(self) -> tuple[str, ...]:
        """What is as it should be, and differs from what one might expect."""
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
            more = f"; and {len(reasons) - TOLD} more" if len(reasons) > TOLD else ""
            yield f"{urdf}: {what} not shown: {'; '.join(reasons[:TOLD])}{more}"
