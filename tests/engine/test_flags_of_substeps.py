"""What happens in the first substep of a frame alone is in the flags of the frame."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.engine.coupled_step import SUBSTEP
from geomphys.engine.frame_buffer import Block, make_block
from geomphys.engine.state import Method, ReplayData, StepParameters, make_replay_data
from geomphys.engine.step import Recording, run_block
from geomphys.jit.packed_records import pack
from geomphys.results import FLAG_BLOCKED, FLAG_QUARANTINED
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Sphere
from tests.simulated.scenes import Thing, make_scene

GAP, DT = 2e-6, 1 / 30
SUBSTEPS = 8
RADIUS, HALF = 0.05, 0.02


class Frames:
    """A driven plate, recorded at rest, and a ball that falls on it, frame by frame; the first has been done."""

    def __init__(self, clearance: float, speed: float, mass: float) -> None:
        at = (0, 0, HALF + RADIUS + clearance)
        ball = Thing(shape=Sphere(RADIUS), at=at, v=(0, 0, -speed), mass=mass, material="rubber")
        scene = make_scene([Thing(shape=Box((0.2, 0.2, HALF)), role=s.DRIVEN), ball])
        self.data: ReplayData = make_replay_data(scene)
        self.block: Block = make_block(np.arange(2), self.data.recorded.copy(), 0, frames=1)
        self.scene, self.packed, self.packed_block = pack(scene), pack(self.data), pack(self.block)
        self.roots = scene.trees.rest[None].copy()
        self.step()
        self.data.velocity[1, 2] = -speed  # nothing moves in a first frame

    def step(self) -> int:
        """The flags of a frame."""
        params = StepParameters(GAP, 100, Method(GAP, None))
        recording = Recording(self.roots, np.zeros((1, 0)), np.array([DT]))
        assert run_block(self.scene, self.packed, recording, params, self.packed_block) == 1
        return int(self.block.figures["flags"][0])


@pytest.mark.parametrize("poison", [np.nan, np.inf])
def test_a_body_put_back_in_the_first_substep(poison: float) -> None:
    frames = Frames(1e-3, 0.0, 0.05)
    frames.data.driven.offset[0, 2] = poison
    assert frames.step() & FLAG_QUARANTINED
    assert frames.data.coupled.solve["substep_duration"] == pytest.approx(DT / SUBSTEPS)
    assert DT / SUBSTEPS <= SUBSTEP * 1.0001
    assert not frames.step() & FLAG_QUARANTINED


def test_a_body_that_was_hit_is_not_blocked_though_what_hit_it_has_left() -> None:
    """The ball rebounds within the first substep; the plate recoils, and is not back at its free pose by the frame's end."""
    frames = Frames(1e-3, 2.0, 0.05)
    flags = frames.step()
    figures = frames.block.figures[0]
    assert frames.data.velocity[1, 2] > 0.0
    assert figures["impacts"] == 1
    assert frames.data.coupled.trees["touched"][0] == 0  # nor pressed in the last substep
    assert figures["correction"] > 1e-3
    assert frames.block.contact_end[1] > 0
    assert not flags & FLAG_BLOCKED
