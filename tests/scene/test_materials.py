"""The table of materials: built-in pairs, a scene's own, and pairs that are missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.errors import SceneError
from geomphys.scene.materials import MaterialTable, material_table
from geomphys.scene.scene_file import MaterialPair

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
    table = material_table([])
    assert of(table, *materials) == TABLE[materials]
    assert of(table, *materials[::-1]) == TABLE[materials]


def test_a_scene_adds_and_overrides() -> None:
    table = material_table([pair("rubber", "wood", 0.8, 0.9), pair("wood", "wood", 0.5, 0.6)])
    assert table.names == ("wood", "human", "metal", "rubber")
    assert of(table, "wood", "rubber") == (0.8, 0.9)
    assert of(table, "wood", "wood") == (0.5, 0.6)
    assert of(table, "wood", "metal") == TABLE["wood", "metal"]
    assert np.isnan(of(table, "rubber", "rubber")).all()


def test_a_material_that_nothing_defines_names_the_known_ones() -> None:
    table = material_table([pair("rubber", "wood", 0.8, 0.9)])
    table.require_known(Path("s.toml"), [("wood", "table"), ("rubber", "ball")])
    with pytest.raises(SceneError) as caught:
        table.require_known(Path("s.toml"), [("wood", "table"), ("wod", "shelf")])
    message = str(caught.value)
    assert message.startswith("s.toml: material 'wod' of 'shelf' is not known: did you mean 'wood'?")
    assert "Known are wood, human, metal, rubber" in message


def test_a_pair_that_is_missing_is_derived_from_each_with_itself() -> None:
    table = material_table([pair("rubber", "rubber", 0.9, 0.8), pair("ice", "ice", 0.05, 0.02)])
    meetings = [("wood", "table", "rubber", "ball"), ("rubber", "ball", "ice", "rink"), ("wood", "a", "human", "b")]
    full, found = table.with_defaults(Path("s.toml"), meetings)
    assert of(full, "rubber", "wood") == (0.3, pytest.approx(np.sqrt(0.8 * 0.3)))
    assert of(full, "ice", "rubber") == of(full, "rubber", "ice") == (0.05, pytest.approx(np.sqrt(0.8 * 0.02)))
    assert of(full, "wood", "human") == TABLE["wood", "human"]
    assert [p.materials for p in found] == [("wood", "rubber"), ("rubber", "ice")]
    assert found[0].owners == ("table", "ball")
    assert np.isnan(of(full, "ice", "wood")).all()  # which cannot meet
    assert np.isnan(of(table, "rubber", "wood")).all()  # the first table stays as it is


def test_a_material_without_a_pair_with_itself_gives_no_default() -> None:
    table = material_table([pair("rubber", "wood", 0.8, 0.9)])
    with pytest.raises(SceneError) as caught:
        table.with_defaults(Path("s.toml"), [("rubber", "ball", "metal", "plate")])
    message = str(caught.value)
    for fact in (
        "'rubber' (of 'ball')",
        "'metal' (of 'plate')",
        "'rubber' has none with itself",
        '["rubber", "rubber"]',
    ):
        assert fact in message
