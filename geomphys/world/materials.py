"""Restitution and friction of pairs of materials."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from geomphys.errors import SceneError
from geomphys.world.scene import Materials
from geomphys.world.scene_file import MaterialPair

BUILT_IN = ("wood", "human", "metal")
_PAIRS = {
    ("wood", "wood"): (0.3, 0.3),
    ("wood", "human"): (0.2, 0.2),
    ("wood", "metal"): (0.2, 0.1),
    ("human", "human"): (0.1, 0.1),
    ("human", "metal"): (0.2, 0.1),
    ("metal", "metal"): (0.3, 0.1),
}
"""restitution and friction of the built-in materials"""


@dataclass(frozen=True, eq=False)
class MaterialTable:
    """Materials by name and the pairs of a scene: the built-in ones, then those it adds, in the order they appear."""

    names: tuple[str, ...]
    pairs: Materials

    def index(self, name: str) -> int:
        """Row of a material; one without pairs has a row too."""
        return self.names.index(name)

    def require(self, path: Path, meetings: Iterable[tuple[str, str, str, str]]) -> None:
        """Raise SceneError for the first two materials that can meet and have no pair.

        `meetings` are (material, who has it, material, who has it).
        """
        for first, owner, second, other in meetings:
            if np.isnan(self.pairs.restitution[self.index(first), self.index(second)]):
                raise SceneError(
                    f"{path}: materials {first!r} (of {owner!r}) and {second!r} (of {other!r}) can meet and have no "
                    f"pair: add a [[material_pair]] with both{self._suggestion(first, second)}"
                )

    def _suggestion(self, *materials: str) -> str:
        known = [n for k, n in enumerate(self.names) if not np.all(np.isnan(self.pairs.restitution[k]))]
        for name in materials:
            near = [] if name in known else get_close_matches(name, known, n=1)
            if near:
                return f", or did you mean {near[0]!r} instead of {name!r}?"
        return ""


def material_table(pairs: Iterable[MaterialPair], used: Iterable[str]) -> MaterialTable:
    """The built-in pairs, overridden and extended by those of a scene, over all materials in `used`."""
    pairs = tuple(pairs)
    names = list(dict.fromkeys([*BUILT_IN, *(m for p in pairs for m in p.materials), *used]))
    restitution, friction = (np.full((len(names), len(names)), np.nan) for _ in range(2))
    rows = [(a, b, e, mu) for (a, b), (e, mu) in _PAIRS.items()]
    rows += [(*p.materials, p.restitution, p.friction) for p in pairs]
    for first, second, bounce, rub in rows:
        i, j = names.index(first), names.index(second)
        restitution[i, j] = restitution[j, i] = bounce
        friction[i, j] = friction[j, i] = rub
    return MaterialTable(tuple(names), Materials(restitution, friction))
