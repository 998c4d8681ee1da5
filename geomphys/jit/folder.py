"""The folder of cached machine code: one for each version of the kernels' sources."""

from __future__ import annotations

import hashlib
import os
import re
import sys
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from geomphys.jit.machine_code import processor
from geomphys.storage.cache import PACKAGE, Store, installed_state, remove_unused, sources, user_cache_folder

COMPILED = re.compile(rb"^@(kernel|noinline|inlined)$|^(from|import) (numba|llvmlite)\b", re.MULTILINE)
"""Found in modules that affect the machine code, as do those they import."""

MARKS = (b"@kernel", b"@noinline", b"@inlined", b"numba", b"llvmlite")
"""Wherever `COMPILED` matches there is one of them: finding those first is many times as fast."""

IMPORTED = re.compile(rb"^from (geomphys\.[\w.]+) import", re.MULTILINE)

FOLDERS = re.compile(r"kernels-[0-9a-f]{16}")
"""Names of the folders of all versions."""


@lru_cache(maxsize=1)
def cache_folder() -> Path:
    """Folder of the machine code of this version of the package, made on first use: see `geomphys.storage.cache`.

    It is named after the sources that affect the code, the versions of numba, llvmlite and Python, numba's settings, and
    the processor. Folders of versions that were not used for a month are removed.
    """
    about = _digest_of_sources(), sys.version, _numba_settings(), processor()
    folder = user_cache_folder(f"kernels-{hashlib.sha256(repr(about).encode()).hexdigest()[:16]}")
    remove_unused(folder, FOLDERS)
    return folder


@lru_cache(maxsize=1)
def store() -> Store:
    """The stored products in the folder."""
    return Store(cache_folder())


def _digest_of_sources() -> str:
    """Of the versions of numba and llvmlite, and of the sources that affect the code; cached while none of them changes."""
    state, name = installed_state("numba", "llvmlite"), PACKAGE.replace("/", "_")
    known = Store(user_cache_folder("sources"))
    found = known.load(name)
    if found is None or found[0] != state:
        from importlib.metadata import version

        digest = hashlib.sha256(f"{version('numba')} {version('llvmlite')}".encode())
        for module, text in _sources_of_machine_code():
            digest.update(module.encode() + b"\0" + text + b"\0")
        found = state, digest.hexdigest()
        known.save(name, found)
    return str(found[1])


def _numba_settings() -> tuple[list[tuple[str, str]], bytes]:
    """What numba reads its settings from: environment variables, and a file in the working directory."""
    variables = [item for item in os.environ.items() if item[0].startswith("NUMBA_") and item[0] != "NUMBA_CACHE_DIR"]
    file = b""
    with suppress(OSError):
        file = Path(".numba_config.yaml").read_bytes()
    return sorted(variables), file


def _sources_of_machine_code() -> list[tuple[str, bytes]]:
    """Names and texts of the modules with kernels and of all they import, sorted."""
    texts = sources()
    found: set[str] = set()
    marked = [name for name, text in texts.items() if any(mark in text for mark in MARKS)]
    waiting = [name for name in marked if COMPILED.search(texts[name])]
    while waiting:
        name = waiting.pop()
        if name in texts and name not in found:
            found.add(name)
            waiting.extend(match.decode() for match in IMPORTED.findall(texts[name]))
    return [(name, texts[name]) for name in sorted(found)]
