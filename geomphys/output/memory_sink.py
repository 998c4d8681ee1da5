"""A sink that collects all results in memory, for short recordings and for tests."""

from __future__ import annotations

from geomphys.config import Config
from geomphys.output.provenance import Provenance
from geomphys.output.sink import ContextManaged
from geomphys.results import FrameResult
from geomphys.scene.world import World


class MemorySink(ContextManaged):
    """Collects the results of a replay.

    Attributes
    ----------
    results : list of FrameResult
        In the order written.
    world, config, provenance
        As given to `open`; None before.
    complete : bool or None
        As given to `close`; None before.
    """

    def __init__(self) -> None:
        self.results: list[FrameResult] = []
        self.world: World | None = None
        self.config: Config | None = None
        self.provenance: Provenance | None = None
        self.complete: bool | None = None

    def open(self, world: World, config: Config, provenance: Provenance) -> None:
        """Begin and clear the results of an earlier run."""
        self.results = []
        self.world, self.config, self.provenance = world, config, provenance
        self.complete = None

    def write(self, result: FrameResult) -> None:
        """Append a frame."""
        self.results.append(result)

    def close(self, complete: bool) -> None:
        """Store whether the run was complete."""
        if self.complete is None:
            self.complete = complete
