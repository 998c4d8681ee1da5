"""Colours of the rerun recording and the robot descriptions: red, green, blue, opacity, each 0 to 255."""

from __future__ import annotations

import zlib

from geomphys.scene.scene_facts import SceneFacts

Colour = tuple[int, int, int, int]

FREE: Colour = (226, 190, 166, 255)
"""A link at its recorded pose."""
CORRECTED: Colour = (120, 178, 214, 255)
"""A link whose pose was corrected."""
IN_CONTACT: Colour = (242, 142, 43, 255)
"""A link in contact."""
GHOST: Colour = (220, 40, 100, 80)
"""The recorded pose of a corrected link, drawn translucent."""
HIDDEN: Colour = (0, 0, 0, 0)
CONTACT: Colour = (200, 30, 30, 255)
DEPTH: Colour = (130, 60, 190, 255)
"""Vectors of global penetration depth."""

_MATERIALS: dict[str, Colour] = {
    "wood": (205, 194, 176, 255),
    "human": FREE,
    "metal": (160, 170, 184, 255),
}
_FALLBACKS: tuple[Colour, ...] = (
    (143, 170, 129, 255),
    (171, 143, 178, 255),
    (128, 165, 168, 255),
    (190, 170, 120, 255),
    (176, 132, 128, 255),
)
_SIMULATED: tuple[Colour, ...] = (
    (72, 128, 170, 255),
    (92, 150, 96, 255),
    (168, 88, 96, 255),
    (140, 104, 168, 255),
    (60, 150, 150, 255),
)
"""Simulated objects are more saturated than fixed ones."""
_SHADES = (1.0, 0.90, 1.10, 0.95, 1.05)


def colour_of_material(name: str) -> Colour:
    """Colour of a material; an unknown one gets one of a few colours, chosen by a hash of its name."""
    return _MATERIALS.get(name) or _FALLBACKS[zlib.crc32(name.encode()) % len(_FALLBACKS)]


def colour_of_object(name: str, material: str, *, simulated: bool) -> Colour:
    """Colour of an object: a shade of its material, so that neighbours differ; a colour of its own if it is simulated."""
    number = zlib.crc32(name.encode())
    if simulated:
        return _SIMULATED[number % len(_SIMULATED)]
    shade = _SHADES[number % len(_SHADES)]
    red, green, blue, opacity = colour_of_material(material)
    return (min(255, int(red * shade)), min(255, int(green * shade)), min(255, int(blue * shade)), opacity)


def colours_of_trees(facts: SceneFacts) -> dict[str, Colour]:
    """Colour of every avatar and object of a scene by its name."""
    avatars = {name: colour_of_material(material) for name, material in facts.avatars}
    objects = {o.name: colour_of_object(o.name, o.material, simulated=o.simulated) for o in facts.objects}
    return avatars | objects
