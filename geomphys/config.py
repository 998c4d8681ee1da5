"""Parameters of a replay: frozen, validated on construction, each with its unit, default and effect."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Literal

from geomphys.errors import ConfigError

TimeSource = Literal["header", "log", "publish"]


@dataclass(frozen=True, kw_only=True)
class Config:
    """All parameters of a replay; written into the output's provenance record."""

    mode: Literal["auto", "rigid", "chains"] | None = None
    """How avatars are corrected, as one rigid body or joint by joint; auto: joint by joint where joints move links that
    collide; None: as the scene file says."""
    method: Literal["exact", "paper"] = "exact"
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
    """Limit on the impacts of the simulated loop in a frame; reaching it is reported."""

    def __post_init__(self) -> None:
        """Check ranges; raises ConfigError that names parameter and value."""
        for name in ("rate", "max_gap", "max_delay", "gap", "start", "end"):
            value = getattr(self, name)
            if value is not None and (not math.isfinite(value) or value < 0):
                raise ConfigError(f"{name} = {value}: must be a finite number that is not negative")
        if self.rate == 0:
            raise ConfigError("rate = 0: must be above zero")
        for name in ("max_iterations", "max_impacts"):
            if getattr(self, name) < 1:
                raise ConfigError(f"{name} = {getattr(self, name)}: must be at least 1")
        if not 1e-9 <= self.gap <= 5e-6:
            raise ConfigError(f"gap = {self.gap}: must lie between 1e-9 and 5e-6 m")
        if self.start is not None and self.end is not None and self.end < self.start:
            raise ConfigError(f"end = {self.end}: lies before start = {self.start}")

    def as_dict(self) -> dict[str, Any]:
        """Every parameter by name."""
        return dataclasses.asdict(self)
