"""A rigid hand of two plates that slide towards each other under a palm."""

from __future__ import annotations

from pathlib import Path

from tests.scene.models import joint, link, urdf

GRIP = (
    '[[avatar]]\nname="grip"\nurdf="grip.urdf"\nmode="rigid"\nmaterial="human"\n'
    'root={topic="/wrist"}\njoints={topic="/angles"}\n'
)


def gripper(folder: Path, palm: str, plate: str, along: int, apart: float) -> str:
    """Scene text of the hand: boxes `palm` and `plate` ("x y z" [m]), the plates `apart` [m] along x (0) or y (1)."""
    box = '<geometry><box size="{}"/></geometry>'
    elements = [link("palm", box.format(palm))]
    for name, sign in (("l", 1.0), ("r", -1.0)):
        axis, place = [0.0, 0.0, 0.0], [0.0, 0.0, -0.05]
        axis[along], place[along] = sign, -0.5 * sign * apart
        slide = f'<axis xyz="{spaced(axis)}"/><limit lower="0" upper="0.1" effort="1" velocity="1"/>'
        elements += [
            link(name, box.format(plate)),
            joint(f"j{name}", "palm", name, "prismatic", inside=slide, xyz=spaced(place)),
        ]
    urdf(folder / "grip.urdf", *elements)
    return GRIP


def spaced(values: list[float]) -> str:
    return " ".join(map(str, values))
