"""Outlined kernels as machine code sees them: an address each, in a word of memory that LLVM knows by name."""

from __future__ import annotations

import ctypes
from typing import Any, Protocol

import llvmlite.binding

from geomphys.jit.products import CacheEntry, Key, symbol_of


class Unit(Protocol):
    """An outlined kernel, for whoever has it compiled."""

    loaded: dict[Key, tuple[Any, list[Key]]]
    """numba's functions, and what they jump to."""

    def make(self, key: Key, stored: CacheEntry) -> Any:
        """Have numba compile it, or load what it has cached."""

    def needs(self) -> list[Key]:
        """Keys of the outlined kernels it jumps to, once it is compiled in this process."""


units: dict[tuple[str, str], Unit] = {}
"""By module and name."""

requested: dict[Key, None] = {}
"""What compiled code of this process jumps to, in order."""

_slots: dict[str, ctypes.c_void_p] = {}


def make_slots(keys: list[Key]) -> None:
    """Let LLVM know where the addresses of outlined kernels will stand."""
    for key in keys:
        symbol = symbol_of(key)
        if symbol not in _slots:
            _slots[symbol] = ctypes.c_void_p()
            llvmlite.binding.add_symbol(f"{symbol}.slot", ctypes.addressof(_slots[symbol]))


def is_loaded(key: Key) -> bool:
    """Whether an outlined kernel can be jumped to in this process."""
    return bool(_slots[symbol_of(key)].value)


def fill_slot(key: Key, address: int) -> None:
    """Let callers of an outlined kernel jump to its address."""
    _slots[symbol_of(key)].value = address
