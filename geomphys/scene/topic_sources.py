"""Input topics of a world: where root poses and joint values come from, and how recorded values are converted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import NamedTuple


@dataclass(frozen=True, kw_only=True)
class RootSource:
    """Topic of the pose of a tree's root."""

    tree: int
    topic: str  # `topic` or `topic#child_frame`
    position: tuple[float, float, float]  # tracker_from_root
    orientation: tuple[float, float, float, float]
    delay: float = 0.0  # s, added to the times of its samples


@dataclass(frozen=True, kw_only=True)
class JointSource:
    """Topic of the values of a tree's joints: q = factor · (recorded value in rad or m) + offset."""

    tree: int
    topic: str
    unit: str | None  # "rad", "deg" or None: what the message type says (ManusGlove: deg, else rad)
    rename: dict[str, str]  # recorded name -> joint name
    dofs: dict[str, int]  # joint name -> column of the angles (mimic joints left out)
    mimics: tuple[str, ...] = ()  # names of mimic joints: recorded values of theirs are not used
    ignore: tuple[str, ...] = ()  # patterns of names that are left out
    factors: Mapping[str, float] = field(default_factory=dict)  # joint name -> sign times scale, where that is not 1
    offsets: Mapping[str, float] = field(default_factory=dict)  # joint name -> rad or m, where there is one
    delay: float = 0.0  # s, added to the times of its samples
    continuous: tuple[str, ...] = ()  # joints in `dofs` without limits: q and q + 2 pi are equivalent

    def ignores(self, name: str) -> bool:
        """Whether a recorded name is ignored: a pattern matches it and `rename` does not contain it."""
        return name not in self.rename and self.covers(name)

    def covers(self, name: str) -> bool:
        """Whether an `ignore` pattern matches a name: a joint of this name is then expected to be missing."""
        return any(fnmatchcase(name, pattern) for pattern in self.ignore)


@dataclass(frozen=True, kw_only=True)
class KeypointSource:
    """Topic of the points that a tree's joint values are fitted to."""

    tree: int
    topic: str  # `topic`, or `topic#side` of a glove
    layout: str | None  # "openxr", "manus", "mediapipe"
    links: Mapping[str, str]  # index or name of a point -> link
    scale: str  # "fingers", "hand" or "none"
    fits_root: bool  # whether the root's pose is fitted too
    delay: float = 0.0  # s, added to the times of its samples


class PalmOrientation(NamedTuple):
    """Relation of a recorded wrist or palm orientation to the root link that is fitted to points: measured once a recording."""

    point: int  # index among the points of the fit
    point_from_root: tuple[float, ...]  # x y z w
    lever: float  # m; an error of 1 rad weighs as much as one point that is this far off
