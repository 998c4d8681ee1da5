"""Calls of compiled kernels from Python: arguments and results as words of memory."""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np

from geomphys.jit.kinds import Kind, named_tuple

_FUNCTION = ctypes.PYFUNCTYPE(None, ctypes.c_char_p, ctypes.c_void_p)  # the lock of the interpreter is held
_UNLOCKED = ctypes.CFUNCTYPE(None, ctypes.c_char_p, ctypes.c_void_p)  # other threads run meanwhile
_BYTES = ctypes.c_char * 0
_LETTERS: dict[str, str] = {"none": "", "float32": "d", "float64": "d", "uint64": "Q"}


class Entry:
    """A compiled kernel as Python calls it.

    Parameters
    ----------
    address
        Of a function of two pointers: to the words of the arguments, and to those for the result.
    kinds, returns
        Kinds of the arguments and of the result.
    """

    def __init__(self, address: int, kinds: tuple[Kind, ...], returns: Kind) -> None:
        self._function, self._unlocked = _FUNCTION(address), _UNLOCKED(address)
        self._arguments = struct.Struct("=" + "".join(map(_format, kinds)))
        self._result = struct.Struct("=" + _format(returns))
        self._returns = returns

    def __call__(self, arguments: tuple[Any, ...], *, unlocked: bool = False) -> Any:
        """Call it with arguments of its kinds, which the caller has seen to; `unlocked`: other threads run meanwhile."""
        call, words = self._unlocked if unlocked else self._function, list[Any]()
        for argument in arguments:
            _add_words(words, argument)
        if self._returns == "none":
            return call(self._arguments.pack(*words), None)
        result = ctypes.create_string_buffer(self._result.size)
        call(self._arguments.pack(*words), result)
        return _value(self._returns, iter(self._result.unpack(result)))


def _format(kind: Kind) -> str:
    """Words of a kind, in the letters of `struct`."""
    if isinstance(kind, str):
        letters: str = _LETTERS.get(kind, "q")
        return letters
    if kind[0] == "array":
        return "q" * int(1 + 2 * kind[2])
    if kind[0] in ("named", "tuple"):
        return "".join(map(_format, kind[3 if kind[0] == "named" else 1 :]))
    return "q"


def _address(array: np.ndarray) -> int:
    """The address of an array's first element."""
    flags = array.flags
    if flags.c_contiguous and flags.writeable:  # a quarter of the time that the attribute of the array takes
        return ctypes.addressof(_BYTES.from_buffer(array))
    return int(array.ctypes.data)


def _add_words(words: list[Any], value: Any) -> None:
    if isinstance(value, np.ndarray):
        words.append(_address(value))
        words.extend(value.shape)
        words.extend(value.strides)
    elif isinstance(value, tuple):
        for item in value:
            _add_words(words, item)
    elif isinstance(value, np.void):
        words.append(value.__array_interface__["data"][0])
    elif isinstance(value, np.bool_):
        words.append(bool(value))
    elif value is not None:
        words.append(getattr(value, "address", value))


def _value(kind: Kind, words: Iterator[Any]) -> Any:
    """A result of a kind from its words."""
    if kind == "none":
        return None
    if kind == "boolean":
        return bool(next(words))
    if isinstance(kind, str):
        return next(words)
    if kind[0] == "named":
        _, module, name, *items = kind
        return named_tuple(module, name)(*(_value(item, words) for item in items))
    return tuple(_value(item, words) for item in kind[1:])
