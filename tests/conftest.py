"""What all tests share: where the real recordings are."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from tests.made import Results

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def shared_dir() -> Path:
    """Folder with the real recordings and models: $GEOMPHYS_SHARED or ../shared; the test is skipped without it."""
    folder = Path(os.environ.get("GEOMPHYS_SHARED", ROOT.parent / "shared")).resolve()
    if not (folder / "recordings").is_dir():
        pytest.skip(f"real recordings are not in {folder} (set GEOMPHYS_SHARED)")
    return folder


@pytest.fixture(scope="session")
def root() -> Path:
    """The checkout."""
    return ROOT


@pytest.fixture(scope="session")
def pressed(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """Results of a sphere that is pressed into a table."""
    from tests.made import make_pressed

    return make_pressed(tmp_path_factory.mktemp("pressed"))


@pytest.fixture(scope="session")
def landed(tmp_path_factory: pytest.TempPathFactory, root: Path) -> Results:
    """Results of a recorded hand that comes down on a table."""
    from tests.made import make_landed

    return make_landed(tmp_path_factory.mktemp("landed"), root)
