"""The colours of the rerun recording, as red, green, blue, opacity of 0 to 255."""

from __future__ import annotations

import zlib

Colour = tuple[int, int, int, int]

FREE: Colour = (226, 190, 166, 255)
"""A link where it was recorded."""
CORRECTED: Colour = (120, 178, 214, 255)
"""A link moved from where it was recorded."""
TOUCHING: Colour = (242, 142, 43, 255)
"""A link in contact."""
GHOST: Colour = (214, 60, 110, 90)
"""The recorded pose of a link that was moved."""
HIDDEN: Colour = (0, 0, 0, 0)
CONTACT: Colour = (200, 30, 30, 255)
DEPTH: Colour = (130, 60, 190, 255)
"""Vectors of global penetration depth."""

_MATERIALS: dict[str, Colour] = {
    "wood": (186, 150, 108, 255),
    "human": FREE,
    "metal": (150, 160, 174, 255),
}
_OTHERS: tuple[Colour, ...] = (
    (143, 170, 129, 255),
    (171, 143, 178, 255),
    (128, 165, 168, 255),
    (190, 170, 120, 255),
    (176, 132, 128, 255),
)


def of_material(name: str) -> Colour:
    """Colour of an object of that material; one the palette does not know has one of a few, always the same."""
    return _MATERIALS.get(name) or _OTHERS[zlib.crc32(name.encode()) % len(_OTHERS)]
