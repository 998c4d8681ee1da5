"""Scenes of a few objects as an outsider would write them: a scene file and a small log, replayed."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from geomphys.config import Config
from geomphys.load import load_world
from geomphys.replays import replay
from geomphys.results import FrameResult
from geomphys.scene.arrays import DRIVEN
from geomphys.scene.world import World
from tests.recording.log_files import pose, write_log

GRAVITY = 9.81
EARTH, SPACE = (0.0, 0.0, -GRAVITY), (0.0, 0.0, 0.0)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
Path7 = Callable[[float], Sequence[float]]


def thing(name: str, role: str = "simulated", **keys: object) -> str:
    """An `[[object]]` of the scene file; wood unless told otherwise."""
    keys = {"material": "wood", **keys}
    lines = [f'[[object]]\nname = "{name}"\nclass = "{role}"']
    for key, value in keys.items():
        plain = [float(x) for x in value] if isinstance(value, tuple | list | np.ndarray) else value
        lines.append(f"{key} = {json.dumps(plain)}")
    return "\n".join(lines) + "\n"


def floor(**keys: object) -> str:
    """A fixed box whose top is the plane z = 0."""
    return thing("floor", "fixed", **{"box": (20, 20, 0.2), "position": (0, 0, -0.1), **keys})


def turned(*vector: float) -> list[float]:
    """Orientation (x y z w) of a rotation vector [rad]."""
    return [float(x) for x in Rotation.from_rotvec(vector).as_quat()]


@dataclass(frozen=True)
class Run:
    """A replay that is over."""

    world: World
    results: list[FrameResult] = field(repr=False)

    @property
    def t(self) -> np.ndarray:
        """(N,) s since the first frame."""
        first = self.results[0].frame.time_ns
        return np.array([r.frame.time_ns - first for r in self.results]) * 1e-9

    def path(self, name: str) -> np.ndarray:
        """(N, 7) poses of a body."""
        body = self.world.body_names.index(name)
        return np.array([r.corrected[body] for r in self.results])

    def mass(self, name: str) -> float:
        """kg"""
        return float(self.world.scene.bodies.mass[self.world.body_names.index(name)])

    def velocity(self, name: str, frame: int) -> np.ndarray:
        """(3,) m/s of the body's origin, mean from a frame to the next."""
        p, t = self.path(name), self.t
        return (p[frame + 1, :3] - p[frame, :3]) / (t[frame + 1] - t[frame])

    def drift(self, name: str, since: int = 0) -> tuple[float, float]:
        """Farthest from where it was in frame `since` [m], and most turned [deg]."""
        p = self.path(name)[since:]
        turn = Rotation.from_quat(p[:, 3:]) * Rotation.from_quat(p[0, 3:]).inv()
        return float(np.linalg.norm(p[:, :3] - p[0, :3], axis=1).max()), float(np.degrees(turn.magnitude().max()))

    def slips(self, name: str) -> dict[int, np.ndarray]:
        """Body -> (N, 3) m: how far a thing slid on it since the first frame, in the thing's frame: summed over frames."""
        held, out = self.world.body_names.index(name), {}
        for k in range(1, len(self.results)):
            before, now = self.results[k - 1], self.results[k]
            c = now.contacts
            for body in np.unique(np.where(c.body_a == held, c.body_b, c.body_a)):
                mine = ((c.body_a == held) & (c.body_b == body)) | ((c.body_b == held) & (c.body_a == body))
                mine &= c.normal_impulse > 0.0
                if not mine.any():
                    continue
                point, normal = c.point[mine].mean(axis=0), c.normal[mine].mean(axis=0)
                normal /= np.linalg.norm(normal)
                ways = [motion_of(before.corrected[i], now.corrected[i], point) for i in (held, int(body))]
                slid = ways[0] - ways[1]
                slid -= normal * (slid @ normal)
                contact = out.setdefault(int(body), np.zeros((len(self.results), 3)))
                contact[k] = Rotation.from_quat(now.corrected[held, 3:]).inv().apply(slid)
        return {body: contact.cumsum(axis=0) for body, contact in out.items()}

    def farthest_slip(self, slips: dict[int, np.ndarray], frames: slice) -> float:
        """Farthest that any driven body slid in some frames, from where it was in the first of them [m]; inf: none touched."""
        role = self.world.scene.bodies.role
        contacts = [contact[frames] for body, contact in slips.items() if role[body] == DRIVEN]
        return max((float(np.linalg.norm(r - r[0], axis=1).max()) for r in contacts), default=math.inf)

    @property
    def overlap(self) -> float:
        """Deepest overlap reported after the first frame [m]."""
        return max(r.metrics.residual_penetration_m for r in self.results[1:])

    @property
    def flags(self) -> int:
        """Flags of any frame."""
        return int(np.bitwise_or.reduce([r.metrics.flags for r in self.results]))


def motion_of(before: np.ndarray, now: np.ndarray, point: np.ndarray) -> np.ndarray:
    """How far the material point of a body that is at `point` now has come between two poses (7,), (3,) m."""
    inside = Rotation.from_quat(now[3:]).inv().apply(point - now[:3])
    return point - (before[:3] + Rotation.from_quat(before[3:]).apply(inside))


def play(
    folder: Path,
    things: Sequence[str],
    seconds: float,
    rate: float = 60.0,
    *,
    gravity: Sequence[float] = EARTH,
    pairs: str = "",
    paths: dict[str, Path7] | None = None,
    config: Config | None = None,
    times: Sequence[float] | None = None,
) -> Run:
    """Write scene and log, replay. `paths`: topic -> pose (7) at a time [s]. A far-off marker that is tracked is the clock.

    `times` [s] are those of the frames, where they are not `1 / rate` apart.
    """
    folder.mkdir(parents=True, exist_ok=True)
    head = f'[scene]\nname = "law"\ngravity = {list(gravity)}\n{pairs}\n'
    marker = thing("marker", "fixed", sphere=0.001, topic="/marker")
    (folder / "scene.toml").write_text(head + "".join(things) + marker)
    followed = {"/marker": lambda _: (50.0, 50.0, 50.0, *UPRIGHT), **(paths or {})}
    items = [
        pose(topic, 1.0 + t, [float(x) for x in path(t)])
        for t in times or [k / rate for k in range(math.floor(seconds * rate + 0.5) + 1)]
        for topic, path in followed.items()
    ]
    write_log(folder / "log.mcap", items, encoding="protobuf")
    world = load_world(folder / "scene.toml")
    return Run(world, list(replay(folder / "log.mcap", world, config=config or Config(clock="/marker"))))
