"""What all tests share: where the real recordings are."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def shared_dir() -> Path:
    """Folder with the real recordings and models: $GEOMPHYS_SHARED or ../shared; the test is skipped without it."""
    folder = Path(os.environ.get("GEOMPHYS_SHARED", ROOT.parent / "shared"))
    if not (folder / "recordings").is_dir():
        pytest.skip(f"real recordings are not in {folder} (set GEOMPHYS_SHARED)")
    return folder


@pytest.fixture(scope="session")
def root() -> Path:
    """The checkout."""
    return ROOT
