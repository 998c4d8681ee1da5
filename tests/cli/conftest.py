"""The log and the scene the command line is tried on."""

from __future__ import annotations

import pytest

from tests.cli.press import SCENE, Case, write_log


@pytest.fixture(scope="session")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """The log and the scene; nothing is written beside them."""
    folder = tmp_path_factory.mktemp("press")
    write_log(folder / "press.mcap")
    (folder / "press.toml").write_text(SCENE)
    return Case(folder, folder / "press.mcap", folder / "press.toml")
