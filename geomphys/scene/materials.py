"""Table of restitution and friction per pair of materials; defaults for pairs that are not given."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

from geomphys.errors import SceneError
from geomphys.scene.arrays import Materials
from geomphys.scene.findings import DefaultPair
from geomphys.scene.scene_file import MaterialPair
from geomphys.storage.remote_files import AnyPath

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
        """Row of a material."""
        return self.names.index(name)

    def require_known(self, path: AnyPath, used_by: Iterable[tuple[str, str]]) -> None:
        """Raise SceneError for the first undefined material; `used_by` are (material, object or avatar)."""
        for name, owner in used_by:
            if name not in self.names:
                close = get_close_matches(name, self.names, n=1)
                hint = f"did you mean {close[0]!r}? " if close else ""
                raise SceneError(
                    f"{path}: material {name!r} of {owner!r} is not known: {hint}Known are {', '.join(self.names)}; add "
                    f"a [[material_pair]] with materials = [{_quoted(name)}, {_quoted(name)}] for another"
                )

    def with_defaults(
        self, path: AnyPath, contacts: Iterable[tuple[str, str, str, str]]
    ) -> tuple[MaterialTable, tuple[DefaultPair, ...]]:
        """The table completed for every pair that can come into contact, and the pairs that were missing.

        A missing pair takes the geometric mean of the friction and the smaller restitution of each material with itself.
        `contacts` are (material, who has it, material, who has it). Raises SceneError for a missing pair of which a
        material has no pair with itself.
        """
        restitution, friction = self.pairs.restitution.copy(), self.pairs.friction.copy()
        found: dict[tuple[int, int], DefaultPair] = {}
        for first, owner, second, other in contacts:
            i, j = self.index(first), self.index(second)
            if not np.isnan(restitution[i, j]):
                continue
            for name, row in ((first, i), (second, j)):
                if np.isnan(self.pairs.restitution[row, row]):
                    pair_text = f"[{_quoted(first)}, {_quoted(second)}]"
                    alternative = (
                        "" if first == second else f", or one with [{_quoted(name)}, {_quoted(name)}] to derive it from"
                    )
                    raise SceneError(
                        f"{path}: materials {first!r} (of {owner!r}) and {second!r} (of {other!r}) can come into "
                        f"contact and have no pair, and {name!r} has none with itself: add a [[material_pair]] with "
                        f"materials = {pair_text}{alternative}"
                    )
            e = float(min(self.pairs.restitution[i, i], self.pairs.restitution[j, j]))
            mu = float(np.sqrt(self.pairs.friction[i, i] * self.pairs.friction[j, j]))
            restitution[i, j] = restitution[j, i] = e
            friction[i, j] = friction[j, i] = mu
            found[i, j] = DefaultPair((first, second), (owner, other), e, mu)
        return MaterialTable(self.names, Materials(restitution, friction)), tuple(found.values())


def _quoted(name: str) -> str:
    """A name as a TOML string."""
    return json.dumps(name, ensure_ascii=False)


def material_table(pairs: Iterable[MaterialPair]) -> MaterialTable:
    """The built-in pairs, overridden and extended by those of a scene."""
    pairs = tuple(pairs)
    names = list(dict.fromkeys([*BUILT_IN, *(m for p in pairs for m in p.materials)]))
    restitution, friction = (np.full((len(names), len(names)), np.nan) for _ in range(2))
    rows = [(a, b, e, mu) for (a, b), (e, mu) in _PAIRS.items()]
    rows += [(*p.materials, p.restitution, p.friction) for p in pairs]
    for first, second, restitution_coefficient, friction_coefficient in rows:
        i, j = names.index(first), names.index(second)
        restitution[i, j] = restitution[j, i] = restitution_coefficient
        friction[i, j] = friction[j, i] = friction_coefficient
    return MaterialTable(tuple(names), Materials(restitution, friction))
