"""The version of the installed package."""

from __future__ import annotations

from importlib import metadata


def _installed_version() -> str:
    """From the package's metadata; `0+unknown` in a checkout that was never installed."""
    try:
        return metadata.version("geomphys")
    except metadata.PackageNotFoundError:
        return "0+unknown"


__version__ = _installed_version()
