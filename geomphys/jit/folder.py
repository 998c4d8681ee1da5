"""Where machine code is kept between runs: one folder for each version of the kernels' sources."""

from __future__ import annotations

import hashlib
import re
import sys
from functools import lru_cache
from pathlib import Path

import llvmlite
import llvmlite.binding
import numba

from geomphys.storage.cache import Store, sources, user_cache_folder

PACKAGE = Path(__file__).parent.parent

COMPILED = re.compile(rb"^@(kernel|outlined|inlined)$|^(from|import) (numba|llvmlite)\b", re.MULTILINE)
"""Found in modules that have a say in the machine code; those they import have one too."""

IMPORTED = re.compile(rb"^from (geomphys\.[\w.]+) import", re.MULTILINE)


@lru_cache(maxsize=1)
def cache_folder() -> Path:
    """Folder of the machine code of this version of the package, made on first use: see `geomphys.storage.cache`.

    It is named after the sources that bear on the code, where they are and when they were written (numba looks at both),
    the versions of numba and Python, and the processor.
    """
    settings = [getattr(numba.config, name) for name in ("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "ENABLE_AVX")]
    processor = llvmlite.binding.get_host_cpu_name(), llvmlite.binding.get_host_cpu_features().flatten()
    digest = hashlib.sha256(f"{numba.__version__} {llvmlite.__version__} {sys.version} {settings} {processor}".encode())
    for name, text in _sources_of_machine_code():
        digest.update(name.encode() + b"\0" + text + b"\0")
    for path in sorted(PACKAGE.rglob("*.py")):
        if COMPILED.search(path.read_bytes()):
            digest.update(f"{path} {path.stat().st_mtime_ns}".encode())
    return user_cache_folder(f"kernels-{digest.hexdigest()[:16]}")


@lru_cache(maxsize=1)
def store() -> Store:
    """What is known of the machine code in the folder."""
    return Store(cache_folder())


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
