"""The decorator of every compiled kernel, and where the machine code is kept.

Kernels are numba functions without ``fastmath`` (results must not depend on the machine's vector width) whose machine
code is cached on disk. numba looks only at the file a function stands in when it decides whether its cache is fresh,
so a change in a callee of another module would go unseen; the cache folder is therefore named after the sources of
the whole package and the versions of numba and Python.

Kernels never allocate: they are compiled without numba's memory management, which also spares the counting of
references at every access to an array.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TypeVar, cast

import numba

from geomphys.cache import user_folder
from geomphys.compiling.entries import Kernel
from geomphys.compiling.keys import Store

F = TypeVar("F", bound=Callable[..., object])


@lru_cache(maxsize=1)
def cache_folder() -> Path:
    """Folder of the machine code of this version of the package, made on first use: see `geomphys.cache`."""
    package = Path(__file__).parent
    digest = hashlib.sha256(f"{numba.__version__} {sys.version}".encode())
    for source in sorted(package.rglob("*.py")):
        text = source.read_bytes()
        if b"geomphys.kernel" in text or b"numba" in text:
            digest.update(source.relative_to(package).as_posix().encode() + b"\0" + text)
    name = f"kernels-{digest.hexdigest()[:16]}"
    return user_folder(name)


def are_compiled() -> bool:
    """Whether the machine code of the frame step is in the cache: if not, the first frame waits for the compiler."""
    return any(cache_folder().glob("geomphys.step.run_block.*.entry"))


def kernel(function: F) -> F:
    """Compile `function` when it is first called, and into each kernel that calls it."""
    return cast(F, Kernel(function, _store(), outlined=False, inlined=False))


def outlined(function: F) -> F:
    """Compile `function` once; its callers jump to it: for long ones at the bottom of many others.

    What it returns must be annotated: None, bool, int, float, or a tuple or NamedTuple of them.
    """
    return cast(F, Kernel(function, _store(), outlined=True, inlined=False))


def inlined(function: F) -> F:
    """Compile `function` into each of its callers: for short ones that take many arrays and hand on a few numbers."""
    return cast(F, Kernel(function, _store(), outlined=False, inlined=True))


@lru_cache(maxsize=1)
def _store() -> Store:
    return Store(cache_folder())
