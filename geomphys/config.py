"""Parameters and options of a replay: frozen, validated on construction, each with its unit, default and effect."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any, Literal, get_args

from geomphys.errors import ConfigError

TimeSource = Literal["header", "log", "publish"]
Method = Literal["exact", "paper"]
Mode = Literal["auto", "rigid", "chains"]

MAX_SEED = 2**31 - 1
RATES_HZ = (1e-3, 1e5)
"""Lowest and highest rate of frames."""
MAX_SECONDS = 1e9
"""s; the longest time of any parameter, 31 years."""
MAX_COUNT = 10**9
"""The largest number of passes and of impacts."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """All parameters of a replay; written into the output's provenance record."""

    mode: Mode | None = None
    """How avatars are corrected, as one rigid body or joint by joint; auto: joint by joint where joints move links that
    collide; None: as the scene file says."""
    method: Method = "exact"
    """How driven bodies are corrected. `exact`: nothing overlaps and nothing is passed through. `paper`: as published, by
    discrete checks, global penetration depth and cyclic coordinate descent; overlaps may be left, and are reported."""
    time: TimeSource = "header"
    """Which time of a message is used. `header` falls back to `log` for messages without a stamp."""
    clock: str | None = None
    """Topic whose messages are the frames; None: the first avatar's root, else its joints, else the first object's topic."""
    rate: float | None = None
    """Hz; frames at a fixed rate instead of at a topic's messages."""
    start: float | None = None
    """s since the log's first frame; earlier frames are not replayed."""
    end: float | None = None
    """s since the log's first frame; later frames are not replayed."""
    seed: int = 0
    """Seed of everything random: the order of the chains, the convex decomposition."""
    max_gap: float = 0.1
    """s; longer gaps of a stream are held instead of interpolated. More: fewer held frames, more invented motion."""
    max_delay: float = 1.0
    """s; how late a message may arrive and still be sorted by time. More: more memory."""
    clamp_limits: bool = False
    """Clamp recorded angles to the joints' limits."""
    recover: bool = False
    """Replay the readable part of a damaged log."""
    gap: float = 2e-6
    """m; clearance kept between surfaces in contact. More: less sensitive to rounding, corrections larger by as much."""
    max_iterations: int = 30
    """Passes of a search for a posture. Fewer: faster, but worse corrections where many bodies are in contact."""
    max_impacts: int = 500
    """Limit on the impacts in a frame of simulated bodies that may touch each other; reaching it is reported."""

    def __post_init__(self) -> None:
        """Check ranges; raises ConfigError that names parameter and value."""
        for name, known in (("mode", Mode), ("method", Method), ("time", TimeSource)):
            value = getattr(self, name)
            if value not in get_args(known) and not (name == "mode" and value is None):
                raise ConfigError(f"{name} = {_shown(value)}: must be one of {', '.join(get_args(known))}")
        for name in ("max_gap", "max_delay", "start", "end"):
            self._require(name, 0.0, MAX_SECONDS)
        self._require("rate", *RATES_HZ)
        self._require("gap", 1e-9, 5e-6)
        self._require("seed", 0, MAX_SEED, whole=True)
        self._require("max_iterations", 1, MAX_COUNT, whole=True)
        self._require("max_impacts", 1, MAX_COUNT, whole=True)
        if self.start is not None and self.end is not None and self.end < self.start:
            raise ConfigError(f"end = {self.end}: lies before start = {self.start}")

    def _require(self, name: str, low: float, high: float, *, whole: bool = False) -> None:
        """Raise ConfigError unless a parameter is a number within bounds, or None where that is its default."""
        value = getattr(self, name)
        if value is None and name in ("rate", "start", "end"):
            return
        is_number = isinstance(value, Integral if whole else Real) and not isinstance(value, bool)
        if not is_number or not low <= value <= high:
            kind = "a whole number" if whole else "a number"
            raise ConfigError(f"{name} = {_shown(value)}: must be {kind} from {low:.10g} to {high:.10g}")

    def as_dict(self) -> dict[str, Any]:
        """Every parameter by name."""
        return dataclasses.asdict(self)


@dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """What the file of a replay holds besides its results."""

    timing: bool = True
    """The channel ``/timing`` (in rerun recordings its plots), the only content that differs between two runs."""
    copy_input: bool = False
    """The channels of the log too."""
    ros2: bool = False
    """A ROS 2 bag is written; not together with `copy_input`, as a log's channels may be of other kinds."""

    def __post_init__(self) -> None:
        """Raise ConfigError for options that exclude each other."""
        if self.ros2 and self.copy_input:
            raise ConfigError(
                "ros2 and copy_input exclude each other: a log's channels may be of kinds that ROS 2 does not read"
            )


@dataclass(frozen=True, kw_only=True)
class Callbacks:
    """Functions that are called while a replay is at work. What one raises ends the replay."""

    loading: Callable[[str, float], None] | None = None
    """During the first convex decomposition of meshes, with a description and the fraction done; finished decompositions
    stay in the cache."""
    compiling: Callable[[int, int], None] | None = None
    """While kernels are compiled, with the numbers of finished and of known jobs."""
    hashed: Callable[[str, str], None] | None = None
    """Once, before outputs are opened, with the SHA-256 of the log and of the scene file that they name."""
    progress: Callable[[int, int | None], None] | None = None
    """After each frame, with the frames done and their number if it is known; outputs are closed as partial if it raises."""


def _shown(value: object) -> str:
    """A wrong value on one line of some length."""
    if isinstance(value, int) and value.bit_length() > 64:
        return f"a number of {value.bit_length()} bits"
    text = ascii(value)
    return text if len(text) <= 60 else f"{text[:60]}…"
