"""The kernels of this process, by module and name."""

from __future__ import annotations

import hashlib
import inspect
import os
import secrets
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

from geomphys.jit.kinds import Kind, text_of
from geomphys.jit.products import Key

PACKAGE = Path(__file__).parent.parent

PLAIN_NUMBA = os.environ.get("GEOMPHYS_PLAIN_NUMBA") == "1"
"""Set in the environment: numba does everything by itself, every kernel is compiled into its callers, and nothing is kept.

That takes minutes in every process and gives the same results: what `geomphys.jit.work` saves can be checked against it.
"""


class Definition:
    """What a kernel is compiled from.

    Parameters
    ----------
    function : callable
    inlined : bool
        It becomes part of each of its callers.
    noinline : bool
        It is compiled once for each signature, and its callers jump to it.
    """

    def __init__(self, function: Callable[..., Any], inlined: bool, noinline: bool) -> None:
        self.py_func = self.__wrapped__ = function
        self.inlined, self.noinline = inlined, noinline and not PLAIN_NUMBA
        self.__name__, self.__qualname__ = function.__name__, function.__qualname__
        self.__module__, self.__doc__ = function.__module__, function.__doc__
        self.parameters = function.__code__.co_argcount
        self._stamp = _stamp_of(inspect.getfile(function))
        definitions[self.__module__, self.__qualname__] = self

    def key(self, kinds: tuple[Kind, ...]) -> Key:
        """Key of this kernel for these kinds of arguments."""
        return Key(self.__module__, self.__qualname__, text_of(kinds), self._stamp)


class Instruction:
    """An instruction of LLVM, by the name of its intrinsic, that takes nothing and gives an int64."""

    def __init__(self, name: str) -> None:
        self.name = name
        instructions.append(self)

    def __call__(self) -> int:
        """Refused: only kernels call it."""
        raise TypeError(f"{self.name} is called by kernels alone")


definitions: dict[tuple[str, str], Definition] = {}
instructions: list[Instruction] = []


@lru_cache(maxsize=256)
def _stamp_of(path: str) -> str:
    """Digest of a source, or what is never found again if it is no file; none is needed inside the package."""
    source = Path(path)
    if PACKAGE in source.parents:
        return ""
    return hashlib.sha256(source.read_bytes()).hexdigest()[:16] if source.is_file() else secrets.token_hex(8)
