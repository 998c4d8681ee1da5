"""Collects the results of frames until there are enough of them to be encoded together."""

from __future__ import annotations

from collections.abc import Iterator

from geomphys.results import ResultColumns


class ResultBuffer:
    """Frames that are not encoded yet.

    Parameters
    ----------
    size : int
        Frames of a batch. It ends early where a frame has other stages than the one before.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._parts: list[ResultColumns] = []
        self._count = 0

    def add(self, columns: ResultColumns) -> Iterator[ResultColumns]:
        """Add frames; yields the batches that are complete."""
        if self._parts and self._parts[-1].stages != columns.stages:
            yield from self.rest()
        start = 0
        while start < len(columns):
            stop = min(len(columns), start + self._size - self._count)
            self._parts.append(columns.rows(start, stop))
            self._count += stop - start
            start = stop
            if self._count == self._size:
                yield from self.rest()

    def rest(self) -> Iterator[ResultColumns]:
        """Yield the frames that are there, if any, as the last batch."""
        parts, self._parts, self._count = self._parts, [], 0
        if parts:
            yield ResultColumns.joined(parts)
