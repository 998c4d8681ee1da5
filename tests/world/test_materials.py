"""The table of materials: built-in pairs, a scene's own, and pairs that are missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.errors import SceneError
from geomphys.world.materials import MaterialTable, material_table
from geomphys.world.scene_file import MaterialPair

TABLE = {
    ("wood", "wood"): (0.3, 0.3),
    ("wood", "human"): (0.2, 0.2),
    ("wood", "metal"): (0.2, 0.1),
    ("human", "human"): (0.1, 0.1),
    ("human", "metal"): (0.2, 0.1),
    ("metal", "metal"): (0.3, 0.1),
}


def pair(first: str, second: str, bounce: float, rub: float) -> MaterialPair:
    return MaterialPair(materials=(first, second), restitution=bounce, friction=rub)


def of(table: MaterialTable, first: str, second: str) -> tuple[float, float]:
    i, j = table.index(first), table.index(second)
    return table.pairs.restitution[i, j], table.pairs.friction[i, j]


@pytest.mark.parametrize("materials", TABLE)
def test_the_built_in_pairs(materials: tuple[str, str]) -> None:
    table = material_table([], [])
    assert of(table, *materials) == TABLE[materials]
    assert of(table, *materials[::-1]) == TABLE[materials]


def test_a_scene_adds_and_overrides() -> None:
    table = material_table([pair("rubber", "wood", 0.8, 0.9), pair("wood", "wood", 0.5, 0.6)], ["stone"])
    assert table.names == ("wood", "human", "metal", "rubber", "stone")
    assert of(table, "wood", "rubber") == (0.8, 0.9)
    assert of(table, "wood", "wood") == (0.5, 0.6)
    assert of(table, "wood", "metal") == TABLE["wood", "metal"]
    assert np.isnan(of(table, "rubber", "rubber")).all()
    assert np.isnan(of(table, "stone", "wood")).all()


def test_a_pair_that_is_missing_is_named_with_its_owners() -> None:
    table = material_table([], ["wod"])
    table.require(Path("s.toml"), [("wood", "table", "human", "hand")])
    with pytest.raises(SceneError) as caught:
        table.require(Path("s.toml"), [("wood", "table", "human", "hand"), ("wod", "shelf", "human", "hand")])
    message = str(caught.value)
    assert message.startswith("s.toml: ")
    for fact in ("'wod' (of 'shelf')", "'human' (of 'hand')", "[[material_pair]]", "did you mean 'wood'"):
        assert fact in message
