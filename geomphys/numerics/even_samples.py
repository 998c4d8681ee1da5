"""Samples a sequence of unknown length evenly, in bounded memory: every item, then every second, every fourth …"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Generic, TypeVar

Item = TypeVar("Item")


class EvenSamples(Generic[Item]):
    """Evenly spread items of a sequence: fewer than `capacity`, and at least half as many of a long one."""

    def __init__(self, capacity: int) -> None:
        self.items: list[Item] = []
        self._capacity = capacity
        self._stride, self._position = 1, 0

    def takes_next(self) -> bool:
        """Go on to the next item of the sequence; whether it is a sample, for `append`."""
        taken = self._position % self._stride == 0
        self._position += 1
        return taken

    def append(self, item: Item) -> None:
        """Add the item for which `takes_next` was true; as soon as there are `capacity`, every second one is dropped."""
        self.items.append(item)
        if len(self.items) >= self._capacity:
            del self.items[1::2]
            self._stride *= 2

    def extend(self, items: Sequence[Item]) -> None:
        """Go on to these items, and add those that are samples."""
        samples = items[-self._position % self._stride :: self._stride]
        if len(self.items) + len(samples) < self._capacity:
            self.items += samples
            self._position += len(items)
            return
        for item in items:
            self.offer(item)

    def offer(self, item: Item) -> None:
        """Go on to the next item, and add it if it is a sample."""
        if self.takes_next():
            self.append(item)
