"""Where things that are costly to compute are kept between runs: compiled kernels, convex decompositions."""

from __future__ import annotations

import os
import tempfile
from functools import lru_cache
from pathlib import Path


@lru_cache(maxsize=16)
def user_folder(name: str) -> Path:
    """A folder of this name in the user's cache, made on first use.

    ``$XDG_CACHE_HOME/geomphys`` (default ``~/.cache/geomphys``); the system's temporary folder where that is not
    writable, and a new temporary folder where even that belongs to someone else.
    """
    home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    for base in (Path(home) / "geomphys", Path(tempfile.gettempdir()) / f"geomphys-{os.getuid()}"):
        folder = base / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    return Path(tempfile.mkdtemp(prefix="geomphys-"))
