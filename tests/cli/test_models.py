"""Every model beside the real recordings goes the whole way with a log made for it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.zoo import through_all, through_commands

SHARED = Path(os.environ.get("GEOMPHYS_SHARED", ROOT.parent / "shared")).resolve()
MODELS = sorted((SHARED / "models").glob("*/*.urdf"))
OWN = sorted((ROOT / "assets").rglob("*.urdf"))


@pytest.mark.parametrize("model", MODELS, ids=lambda path: path.stem)
def test_a_model_goes_the_whole_way(model: Path, tmp_path: Path) -> None:
    outcome = through_all(model, tmp_path)
    assert outcome.audit["frames_broken"] == 0
    assert outcome.audit["same_world"]
    assert outcome.check["warnings"] == []


def test_by_the_commands(tmp_path: Path) -> None:
    outcome = through_commands(OWN[0], tmp_path)
    assert outcome.audit["frames_broken"] == 0
