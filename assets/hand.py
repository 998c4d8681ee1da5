"""The right hand: 18 parts with geometry, 22 joints, 4,964 triangles, the proportions of an adult.

Frames: x along the stretched fingers, z out of the back of the hand, y towards the thumb. All bends are positive when
the finger curls into the palm. At zero the fingers are straight and a little apart.

Bone lengths: Buryanov and Kotiuk, "Proportions of hand segments", International Journal of Morphology 28(3), 2010. With
their carpus of 32 mm the hand is 189 mm from the crease of the wrist to the tip of the middle finger.
Ranges of motion: American Academy of Orthopaedic Surgeons, "Joint motion: method of measuring and recording", 1965.
Breadths of fingers and palm are typical of an adult man.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from files import Joint, Link, Part, mesh, write_obj, write_urdf
from solids import Solid, lathe, limb

TRIANGLES = 4964
PARTS = 18
MM = 1e-3

# finger: its knuckle in the palm (mm), its splay (degrees), bone lengths (mm), radii at the ends of each bone (mm)
FINGERS: dict[str, tuple[tuple[float, float, float], float, tuple[float, ...], tuple[tuple[float, float], ...]]] = {
    "index": ((94.0, 27.0, 0.0), 4.0, (39.8, 22.4, 15.8), ((9.6, 9.0), (8.9, 8.1), (8.2, 6.3))),
    "middle": ((96.7, 6.3, 1.5), 0.0, (44.6, 26.3, 17.4), ((9.9, 9.2), (9.1, 8.3), (8.4, 6.5))),
    "ring": ((90.0, -13.8, 0.5), -4.0, (41.4, 25.7, 17.3), ((9.3, 8.7), (8.6, 7.8), (7.9, 6.1))),
    "little": ((81.5, -32.3, -2.5), -9.0, (32.7, 18.1, 16.0), ((8.2, 7.5), (7.4, 6.8), (6.9, 5.4))),
}
FLESH = 3.9  # mm of soft tissue beyond the last bone
THUMB_BONES = (46.2, 31.6, 21.7)
THUMB_RADII = ((12.5, 11.8), (11.2, 10.4), (10.6, 7.8))
THUMB_ROOT = (27.0, 25.0, -8.0)
THUMB_ALONG = (0.72, 0.58, -0.38)  # of the thumb at rest, in the palm's frame
THUMB_BACK = (-0.20, 0.75, 0.55)  # where its nail looks

# degrees, (extension or adduction, flexion or abduction)
MCP, PIP, DIP, SIDEWAYS = (-45.0, 90.0), (0.0, 100.0), (0.0, 90.0), (-20.0, 20.0)
THUMB_CMC_ABD, THUMB_CMC_FLEX, THUMB_MCP, THUMB_IP = (-35.0, 35.0), (-20.0, 15.0), (0.0, 50.0), (-20.0, 80.0)
WRIST_FLEX, WRIST_DEV = (-70.0, 80.0), (-30.0, 20.0)  # deviation positive towards the thumb


def make(folder: Path) -> int:
    """Write ``hand.urdf`` and its meshes into ``folder``; returns the number of triangles."""
    solids = {"forearm": forearm(), "wrist": wrist(), "palm": palm(), **phalanges()}
    total = sum(write_obj(folder / "meshes" / f"{n}.obj", s, f"right hand, {n}") for n, s in solids.items())
    if (len(solids), total) != (PARTS, TRIANGLES):
        raise ValueError(f"the hand has {len(solids)} parts and {total} triangles, wanted {PARTS} and {TRIANGLES}")
    links, joints = skeleton(list(solids))
    note = "Right hand, 18 parts, 22 joints; written by make_assets.py. MIT."
    write_urdf(
        folder / "hand.urdf", "hand", note, {"skin": (0.85, 0.66, 0.55), "sleeve": (0.32, 0.38, 0.47)}, links, joints
    )
    tips, ends = fingertips()
    write_urdf(
        folder / "hand_tips.urdf",
        "hand",
        "The same hand from the palm on, with links without geometry at the wrist and the fingertips, for points. MIT.",
        {"skin": (0.85, 0.66, 0.55), "sleeve": (0.32, 0.38, 0.47)},
        [link for link in links if link.name not in ("forearm", "wrist")] + tips,
        [joint for joint in joints if not joint.name.startswith("wrist")] + ends,
    )
    return total


def fingertips() -> tuple[list[Link], list[Joint]]:
    """A link at the end of the last bone of each finger, and one at the wrist, the origin of the palm."""
    lengths = {"thumb": THUMB_BONES[-1], **{finger: f[2][-1] for finger, f in FINGERS.items()}}
    links = [Link(f"{finger}_tip") for finger in lengths]
    joints = [
        Joint(f"{finger}_tip_end", segments(finger)[-1], f"{finger}_tip", (length * MM, 0.0, 0.0))
        for finger, length in lengths.items()
    ]
    return [Link("wrist"), *links], [Joint("wrist_end", "palm", "wrist", (0.0, 0.0, 0.0)), *joints]


def phalanges() -> dict[str, Solid]:
    """The fifteen finger bones with their flesh, each from its joint at the origin along x."""
    bones = {"thumb": (THUMB_BONES, THUMB_RADII), **{name: (f[2], f[3]) for name, f in FINGERS.items()}}
    found = {}
    for finger, (lengths, radii) in bones.items():
        for name, length, ends in zip(segments(finger), lengths, radii, strict=True):
            last = name.endswith("distal")
            reach = (length + FLESH - ends[1]) if last else length
            sides, rings = (16, 8) if last else (14, 8)
            top, bottom = (0.78, 0.98) if last else (0.92, 0.96)
            solid = limb(reach * MM, (ends[0] * MM, ends[1] * MM), sides, rings, top, bottom)
            found[name] = solid
    return found


def segments(finger: str) -> list[str]:
    """Link names of a finger from the palm outwards."""
    ends = ("metacarpal", "proximal", "distal") if finger == "thumb" else ("proximal", "middle", "distal")
    return [f"{finger}_{end}" for end in ends]


def forearm() -> Solid:
    """A stub of the forearm behind the wrist, convex."""
    stub = limb(66 * MM, (29.5 * MM, 25.5 * MM), 18, 8, 0.78, 0.78)
    return stub.moved((-104 * MM, 0.0, 0.0))


def wrist() -> Solid:
    """The carpus, a convex pebble about the centre of the wrist's two joints."""
    turn = 2 * np.pi * np.arange(13) / 13
    rings = []
    for i in range(1, 11):
        polar = np.pi * i / 11
        y, z = 26 * MM * np.sin(polar) * np.cos(turn), 19.5 * MM * np.sin(polar) * np.sin(turn)
        rings.append(np.stack([np.full(13, -22 * MM * np.cos(polar)), y, z], axis=1))
    return lathe(rings, np.array([-22 * MM, 0, 0]), np.array([22 * MM, 0, 0]))


def palm(sides: int = 28, rings: int = 16) -> Solid:
    """The palm: a rounded slab with balls of thumb and little finger, hollow between them, and a row of knuckles."""
    turn = 2 * np.pi * (np.arange(sides) + 0.5) / sides
    across = np.sign(np.cos(turn)) * np.abs(np.cos(turn)) ** 0.62
    up = np.sign(np.sin(turn)) * np.abs(np.sin(turn)) ** 0.62
    skins = []
    for i in range(1, rings + 1):
        along = -np.cos(np.pi * i / (rings + 1))
        spread = (1 - abs(along) ** 3.4) ** (1 / 3.4)
        skins.append(_palm_point(along, spread * across, spread * up))
    zero = np.zeros(1)
    return lathe(skins, _palm_point(-1.0, zero, zero)[0], _palm_point(1.0, zero, zero)[0])


def _palm_point(along: float, across: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Bend the unit slab into a palm: ``along`` 1 at the knuckles, ``across`` 1 at the thumb, ``up`` 1 dorsal."""
    half = 32.0 + 10.5 * (along + 1) / 2
    y = half * across - 2.5
    knuckles = 95.5 - 0.0065 * (y - 10.0) ** 2 + 1.5
    x = 13.0 + (knuckles - 13.0) * (along + 1) / 2

    def bump(at: float, beside: float, length: float, width: float) -> np.ndarray:
        return np.exp(-(((along - at) / length) ** 2) - ((across - beside) / width) ** 2)

    heads = sum(np.exp(-(((y - f[0][1]) / 7.0) ** 2)) for f in FINGERS.values())
    dorsal = 11.5 + 1.6 * heads * np.exp(-(((along - 0.75) / 0.35) ** 2))
    thumb_ball, little_ball = bump(-0.30, 0.72, 0.60, 0.42), bump(-0.30, -0.74, 0.75, 0.38)
    volar = 7.5 + 13.0 * thumb_ball + 11.0 * little_ball + 4.5 * bump(0.80, 0.0, 0.35, 3.0)
    z = np.where(up > 0, dorsal, volar) * up
    return np.stack([x, y, z], axis=1) * MM


def thumb_rpy() -> tuple[float, float, float]:
    """Fixed turn of the thumb's root: x along the thumb, z out of its nail."""
    x = np.array(THUMB_ALONG) / np.linalg.norm(THUMB_ALONG)
    z = np.array(THUMB_BACK) - (np.array(THUMB_BACK) @ x) * x
    z /= np.linalg.norm(z)
    r = np.stack([x, np.cross(z, x), z], axis=1)
    return (
        float(np.arctan2(r[2, 1], r[2, 2])),
        float(-np.arcsin(r[2, 0])),
        float(np.arctan2(r[1, 0], r[0, 0])),
    )


def skeleton(parts: list[str]) -> tuple[list[Link], list[Joint]]:
    """Links and joints of the hand; a knuckle that also moves sideways has a link without geometry inside."""
    links = [Link(n, (Part(mesh(f"meshes/{n}.obj")),), "sleeve" if n == "forearm" else "skin") for n in parts]
    here = (0.0, 0.0, 0.0)
    joints = [
        Joint("wrist_dev", "forearm", "wrist", here, axis=(0, 0, 1), limits=WRIST_DEV),
        Joint("wrist_flex", "wrist", "palm", here, limits=WRIST_FLEX),
    ]
    links.append(Link("thumb_base"))
    metacarpal, proximal, distal = segments("thumb")
    root = tuple(MM * v for v in THUMB_ROOT)
    joints += [
        Joint("thumb_cmc_abd", "palm", "thumb_base", root, thumb_rpy(), (0, 0, 1), THUMB_CMC_ABD),
        Joint("thumb_cmc_flex", "thumb_base", metacarpal, here, limits=THUMB_CMC_FLEX),
        Joint("thumb_mcp_flex", metacarpal, proximal, (THUMB_BONES[0] * MM, 0, 0), limits=THUMB_MCP),
        Joint("thumb_ip_flex", proximal, distal, (THUMB_BONES[1] * MM, 0, 0), limits=THUMB_IP),
    ]
    for finger, (knuckle, splay, lengths, _) in FINGERS.items():
        base = f"{finger}_base"
        links.append(Link(base))
        proximal, middle, distal = segments(finger)
        place = tuple(MM * v for v in knuckle)
        sideways = (0, 0, 1 if finger in ("index", "middle") else -1)
        joints += [
            Joint(f"{finger}_mcp_abd", "palm", base, place, (0, 0, np.radians(splay)), sideways, SIDEWAYS),
            Joint(f"{finger}_mcp_flex", base, proximal, here, limits=MCP),
            Joint(f"{finger}_pip_flex", proximal, middle, (lengths[0] * MM, 0, 0), limits=PIP),
            Joint(f"{finger}_dip_flex", middle, distal, (lengths[1] * MM, 0, 0), limits=DIP),
        ]
    return links, joints
