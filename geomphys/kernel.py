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
from typing import Any, TypeVar, cast

import numba

from geomphys.cache import user_folder
from geomphys.outlining import follow

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
    return any(cache_folder().rglob("step.run_block-*.nbi"))


def kernel(function: F) -> F:
    """Compile `function` with numba on its first call and keep the machine code in `cache_folder`."""
    return _compiled(function)


def outlined(function: F) -> F:
    """Compile `function` once; its callers jump to it: for long ones at the bottom of many others."""
    return _compiled(function, out=True)


def inlined(function: F) -> F:
    """Compile `function` into each of its callers: for short ones that take many arrays and hand on a few numbers."""
    return _compiled(function, into=True)


def _compiled(function: F, into: bool = False, out: bool = False) -> F:
    config = cast(Any, numba.config)
    before = config.CACHE_DIR
    config.CACHE_DIR = str(cache_folder())
    try:
        compiled = cast(Any, numba).njit(cache=True, error_model="numpy", _nrt=False, forceinline=into)(function)
    finally:
        config.CACHE_DIR = before
    follow(compiled, cache_folder(), out)
    return cast(F, compiled)
