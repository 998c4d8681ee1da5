"""Grips on simulated things as they would be recorded: jaws, grippers, three fingers and the shipped hand, in every task at once.

A thing is gripped, lifted, held, carried along and across the closing axis, turned about each axis and back, released.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from geomphys.config import Config
from geomphys.engine.grasps import Grasp, GraspMeter
from geomphys.load import load_world
from geomphys.replays import replay
from tests.laws.hand_grasp import HAND, BalancedGrasp, balanced_grasp
from tests.laws.replayed import Run, thing
from tests.laws.test_grasp import frictions, ramp
from tests.laws.test_gripper import write_gripper
from tests.recording.log_files import Item, joints, pose, write_log

HALF = 0.025  # m, half the width of all things
STIFFNESS = 1000.0  # N/m, of all grips
THINGS: dict[str, dict[str, object]] = {
    "cube": {"box": (2 * HALF, 2 * HALF, 2 * HALF), "mass": 0.2},
    "ball": {"sphere": HALF, "mass": 0.1},
    "cylinder": {"cylinder": (HALF, 0.08), "mass": 0.2},
}
HEIGHT = {"cube": HALF, "ball": HALF, "cylinder": 0.04}  # m, of the centre above what it stands on

CLOSED, LIFTED, HELD, CARRIED, TURNED, OPENS, END = 1.0, 2.3, 7.3, 9.0, 17.3, 17.6, 18.4  # s
GRIPPED, RESTED = 1.25, 2.8  # s
TOUCHING = 0.8  # share of the closing at which the hand's fingers touch
APPROACH = 5e-3  # m: how far the hand's palm comes to the thing while its fingers close
QUARTER = 0.5 * math.pi


def frame_of_task(t: float) -> tuple[np.ndarray, Rotation]:
    """Where what is gripped is to be, from where it stood: displacement (3,) [m] and rotation."""
    along, across = ramp(t, 7.5, 8.1, 0.3), ramp(t, 8.3, 8.9, 0.3)
    turn = Rotation.identity()
    for axis, begin in enumerate((9.1, 11.9, 14.7)):
        angle = ramp(t, begin, begin + 1.3, QUARTER) - ramp(t, begin + 1.3, begin + 2.6, QUARTER)
        turn = Rotation.from_rotvec(angle * np.eye(3)[axis]) * turn
    return np.array([along, across, ramp(t, 1.3, LIFTED, 0.2)]), turn


def closing(t: float) -> float:
    """How far the grip is closed, 0 to 1."""
    return ramp(t, 0.3, CLOSED, 1.0) - ramp(t, OPENS, OPENS + 0.3, 1.0)


@dataclass
class Grip:
    """What grips: its part of the scene file, its messages at a time [s], and the height of what the thing stands on [m]."""

    scene: str
    messages: Callable[[float, float], list[Item]]  # of time t and the height of the thing's centre
    height: float = 0.0


def driven_fingers(what: str, squeeze: float, pads: list[tuple[float, float, float]], **shape: object) -> Grip:
    """Objects of a `shape` that follow a topic each, towards `pads`: x, y on the thing's surface, and reach of the shape [m]."""
    names = [f"finger_{k}" for k in range(len(pads))]
    spring = f"coupling = {{ stiffness = {STIFFNESS}, damping = 40.0 }}\n"
    parts = [thing(n, "driven", topic=f"/{n}", mass=0.4, material="human", **shape) + spring for n in names]

    def messages(t: float, height: float) -> list[Item]:
        at, turn = frame_of_task(t)
        out = []
        for name, (x, y, reach) in zip(names, pads, strict=True):
            inwards = (
                -np.array([math.copysign(1, x), 0, 0]) if what == "cube" else -np.array([x, y, 0]) / math.hypot(x, y)
            )
            here = np.array([x, y, 0.0]) - inwards * (reach + 0.03) + inwards * closing(t) * (0.03 + squeeze)
            out.append(pose(f"/{name}", 1.0 + t, [*(np.add(at, (0, 0, height)) + turn.apply(here)), *turn.as_quat()]))
        return out

    return Grip("".join(parts), messages)


def jaws(what: str, squeeze: float, folder: Path) -> Grip:
    """Two boxes that close along x."""
    return driven_fingers(what, squeeze, [(-HALF, 0, 0.01), (HALF, 0, 0.01)], box=(0.02, 0.06, 0.04))


def three_fingers(what: str, squeeze: float, folder: Path) -> Grip:
    """Three balls: round the thing, or against a cube one on one side and two on the other."""
    round_it = [(HALF * math.cos(a), HALF * math.sin(a), 0.01) for a in (0.0, 2 * math.pi / 3, 4 * math.pi / 3)]
    on_cube = [(HALF, 0, 0.01), (-HALF, 0.012, 0.01), (-HALF, -0.012, 0.01)]
    return driven_fingers(what, squeeze, on_cube if what == "cube" else round_it, sphere=0.01)


def gripper(mode: str) -> Callable[[str, float, Path], Grip]:
    """A palm with two fingers on prismatic joints, in a mode."""

    def make(what: str, squeeze: float, folder: Path) -> Grip:
        write_gripper(folder / "gripper.urdf", 100.0, False)
        scene = (
            f'[[avatar]]\nname = "gripper"\nurdf = "gripper.urdf"\nmode = "{mode}"\nmaterial = "human"\n'
            'root = { topic = "/root" }\njoints = { topic = "/joints" }\n'
        )

        def messages(t: float, height: float) -> list[Item]:
            at, turn = frame_of_task(t)
            at = np.add(at, (0, 0, height)) + turn.apply([0, 0, 0.068])
            slide = closing(t) * (0.055 - HALF + squeeze)
            names = ("slide_left", "slide_right")
            return [
                pose("/root", 1.0 + t, [float(x) for x in (*at, *turn.as_quat())]),
                joints("/joints", 1.0 + t, dict.fromkeys(names, slide)),
            ]

        return Grip(scene, messages)

    return make


HAND_SCENE = (
    f'[[avatar]]\nname = "hand"\nurdf = "{HAND}"\nmode = "chains"\nmaterial = "human"\n'
    f"coupling = {{ stiffness = {STIFFNESS}, damping = 40.0 }}\n"
    'root = { topic = "/root" }\njoints = { topic = "/joints" }\n'
)


def hand_grasp(what: str, largest: float, folder: Path) -> BalancedGrasp:
    """The shipped hand's grasp of a thing with fingers that press by `largest` [N] at most."""
    (folder / "hand.toml").write_text('[scene]\nname = "hand"\n' + HAND_SCENE)
    return balanced_grasp(load_world(folder / "hand.toml"), what, largest)


def hand(what: str, squeeze: float, folder: Path) -> Grip:
    """The shipped hand from the side, upright like round a glass, which presses a thing onto its palm with forces in balance."""
    grasp = hand_grasp(what, STIFFNESS * squeeze, folder)

    def messages(t: float, height: float) -> list[Item]:
        at, turn = frame_of_task(t)
        share = closing(t)
        near, in_it = min(1.0, share / TOUCHING), max(0.0, (share - TOUCHING) / (1.0 - TOUCHING))
        root = turn * grasp.root_rotation
        position = np.add(at, (0, 0, height)) + turn.apply(
            grasp.root_position + (1.0 - near) * APPROACH * grasp.outwards
        )
        values = grasp.opened + near * (grasp.touching - grasp.opened) + in_it * (grasp.pressing - grasp.touching)
        return [
            pose("/root", 1.0 + t, [float(x) for x in (*position, *root.as_quat())]),
            joints("/joints", 1.0 + t, dict(zip(grasp.joints, values.tolist(), strict=True))),
        ]

    post = thing("post", "fixed", box=(0.016, 0.016, 0.3), position=(0, 0, 0.15), material="metal")
    return Grip(HAND_SCENE + post, messages, 0.3)


GRIPS: dict[str, Callable[[str, float, Path], Grip]] = {
    "jaws": jaws, "three": three_fingers, "chains": gripper("chains"), "rigid": gripper("rigid"), "hand": hand,
}  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """A task that is over."""

    run: Run
    grasps: tuple[Grasp, ...]
    rate: float
    height: float  # m, of the thing's centre at first

    def frame(self, t: float) -> int:
        """Index of the frame at a time."""
        return round(t * self.rate)

    def slips(self) -> dict[int, np.ndarray]:
        """How far the thing slid on each body, see `Run.slips`."""
        return self.run.slips("thing")

    def slip(self, slips: dict[int, np.ndarray], since: float, until: float) -> float:
        """Farthest that any driven body slid on the thing between two moments, from where it was at first [m]."""
        return self.run.farthest_slip(slips, slice(self.frame(since), self.frame(until) + 1))

    def force(self, t: float) -> dict[str, float]:
        """Normal force of everything on the thing [N]."""
        names, c = self.run.world.body_names, self.run.results[self.frame(t)].contacts
        held, out = names.index("thing"), {}
        for a, b, j in zip(c.body_a, c.body_b, c.normal_impulse, strict=True):
            if held in (a, b):
                other = names[b if a == held else a]
                out[other] = out.get(other, 0.0) + float(j) * self.rate
        return out


def grip_task(
    folder: Path, grip: str, what: str, squeeze: float, friction: float, rate: float = 60, noise: float = 0.0, end: float = END
) -> Outcome:  # fmt: skip
    """Replay the task of one grip on one thing; `noise` [m] is white on the tracked positions."""
    folder.mkdir(parents=True, exist_ok=True)
    made = GRIPS[grip](what, squeeze, folder)
    height = made.height + HEIGHT[what]
    base = thing("floor", "fixed", box=(20, 20, 0.2), position=(0, 0, -0.1), material="metal")
    held = thing("thing", position=(0, 0, height + 1e-5), **THINGS[what])
    (folder / "scene.toml").write_text(f'[scene]\nname = "grip"\n{frictions(friction)}{made.scene}{held}{base}')
    tremble, items = np.random.default_rng(11), []
    for k in range(round(end * rate) + 1):
        for item in made.messages(k / rate, height):
            if noise and item.kind == "pose":
                item.value = (*(np.array(item.value[:3]) + tremble.normal(0, noise, 3)), *item.value[3:])
            items.append(item)
    write_log(folder / "log.mcap", items, encoding="protobuf")
    world = load_world(folder / "scene.toml")
    meter, results = GraspMeter(world), []
    for result in replay(folder / "log.mcap", world, config=Config()):
        meter.add(result)
        results.append(result)
    return Outcome(Run(world, results), meter.grasps(), rate, height)
