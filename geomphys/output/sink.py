"""The protocol of sinks, which receive the frames of a replay."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Protocol, runtime_checkable

from geomphys.config import Config
from geomphys.output.provenance import Provenance
from geomphys.results import FrameResult, ResultColumns
from geomphys.scene.world import World


class Sink(Protocol):
    """Receives frames in order: `open` once, `write` once a frame, `close` once."""

    def open(self, world: World, config: Config, provenance: Provenance) -> None:
        """Begin. Raises OutputError if the output cannot be made."""

    def write(self, result: FrameResult) -> None:
        """Take a frame. Raises OutputError if it cannot be written."""

    def close(self, complete: bool) -> None:
        """End; `complete` is false if frames are missing. Does nothing if the sink is not open."""


@runtime_checkable
class ColumnSink(Sink, Protocol):
    """A sink that takes many frames at once."""

    def write_columns(self, columns: ResultColumns) -> None:
        """Take frames. Raises OutputError if one cannot be written; those before it are taken."""


def write_columns(sinks: Sequence[Sink], columns: ResultColumns) -> None:
    """Hand frames to sinks: one after another, and at once to those that take columns."""
    others = [sink for sink in sinks if not isinstance(sink, ColumnSink)]
    for row in range(len(columns) if others else 0):
        for sink in others:
            sink.write(columns.result(row))
    for sink in sinks:
        if isinstance(sink, ColumnSink):
            sink.write_columns(columns)


class ContextManaged:
    """Base of sinks usable in a ``with`` block, which closes them: complete, unless an exception ends the block."""

    def close(self, complete: bool) -> None:
        """See `Sink.close`."""
        raise NotImplementedError

    def __enter__(self) -> ContextManaged:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close(complete=error is None)
