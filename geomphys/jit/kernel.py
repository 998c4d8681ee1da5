"""The decorators of every compiled kernel, and where the machine code is kept.

Kernels are numba functions without ``fastmath`` (results must not depend on the machine's vector width) whose machine
code is cached on disk; `geomphys.jit.compiling` makes it. The cache folder is named after the sources that bear on it, the
versions of numba and Python, and the processor: it depends on nothing else, so that two installations of the same
version share it.

Kernels never allocate: they are compiled without numba's memory management, which also spares the counting of
references at every access to an array. What they return is annotated; they do not call themselves.
"""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TypeVar, cast

import llvmlite
import llvmlite.binding
import numba

from geomphys.jit.compiling.entries import Kernel
from geomphys.storage.cache import Store, sources, user_cache_folder

F = TypeVar("F", bound=Callable[..., object])


COMPILED = re.compile(rb"^@(kernel|outlined|inlined)$|^(from|import) (numba|llvmlite)\b", re.MULTILINE)
"""Found in modules that have a say in the machine code; those they import have one too."""

IMPORTED = re.compile(rb"^from (geomphys\.[\w.]+) import", re.MULTILINE)


@lru_cache(maxsize=1)
def cache_folder() -> Path:
    """Folder of the machine code of this version of the package, made on first use: see `geomphys.storage.cache`."""
    settings = [getattr(numba.config, name) for name in ("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "ENABLE_AVX")]
    processor = llvmlite.binding.get_host_cpu_name(), llvmlite.binding.get_host_cpu_features().flatten()
    digest = hashlib.sha256(f"{numba.__version__} {llvmlite.__version__} {sys.version} {settings} {processor}".encode())
    for name, text in _sources_of_machine_code():
        digest.update(name.encode() + b"\0" + text + b"\0")
    return user_cache_folder(f"kernels-{digest.hexdigest()[:16]}")


def _sources_of_machine_code() -> list[tuple[str, bytes]]:
    """Names and texts of the modules with kernels and of all they import, sorted."""
    texts = sources()
    found: set[str] = set()
    waiting = [name for name, text in texts.items() if COMPILED.search(text)]
    while waiting:
        name = waiting.pop()
        if name in texts and name not in found:
            found.add(name)
            waiting.extend(match.decode() for match in IMPORTED.findall(texts[name]))
    return [(name, texts[name]) for name in sorted(found)]


def are_compiled() -> bool:
    """Whether the machine code of the frame step is in the cache: if not, the first frame waits for the compiler."""
    return any(cache_folder().glob("geomphys.engine.step.run_block.*.entry"))


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
