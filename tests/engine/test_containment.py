"""A driven tree whose state is not finite is put back where it was, at rest, and no other is touched."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from geomphys.engine.quarantine import FARTHEST, contain_driven, keep_posture
from geomphys.engine.state import ReplayData, make_replay_data
from geomphys.jit.packed_records import pack
from geomphys.results import FLAG_QUARANTINED
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Sphere
from tests.driven.paper.test_descent import planar_arm
from tests.simulated.scenes import Thing, floor, make_scene

BAD = (math.nan, math.inf, -math.inf, 1.01 * FARTHEST)


class Contained:
    """Two driven balls and a floor: both have moved and have offsets."""

    def __init__(self) -> None:
        scene = make_scene([Thing(shape=Sphere(0.05), role=s.DRIVEN, at=(k, 0, 1)) for k in range(2)] + [floor()])
        self.data: ReplayData = make_replay_data(scene)
        self.scene, self.packed = pack(scene), pack(self.data)
        m = self.data
        m.start[:2, :3] = [[0.1, 0, 1], [1.1, 0, 1]]
        m.corrected[:2, :3] = [[0.2, 0, 1], [1.2, 0, 1]]
        m.recorded[:2, :3] = [[0.3, 0, 1], [1.3, 0, 1]]
        m.driven.last.poses[:2] = m.corrected[:2]
        m.driven.last.roots[:2] = m.corrected[:2]
        m.driven.offset[:2], m.driven.offset_velocity[:2] = (-0.1, 0, 0), (0.5, 0, 0)
        m.detection.axes.rows["pair"] = 7

    def contain(self, first: bool = False) -> int:
        return int(contain_driven(self.scene, self.packed, self.data.recorded.copy(), np.zeros(0), first))


def test_what_is_finite_stays_as_it_is() -> None:
    made = Contained()
    before = [a.copy() for a in (made.data.corrected, made.data.driven.offset, made.data.driven.offset_velocity)]
    assert made.contain() == 0
    after = (made.data.corrected, made.data.driven.offset, made.data.driven.offset_velocity)
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
    assert (made.data.detection.axes.rows["pair"] == 7).all()


@pytest.mark.parametrize("value", BAD)
@pytest.mark.parametrize("where", ["corrected", "offset", "offset_velocity", "translation", "angular_velocity"])
def test_one_that_is_not_is_put_back_to_the_start_of_the_frame(where: str, value: float) -> None:
    made = Contained()
    m = made.data
    if where == "corrected":
        m.corrected[0, 4] = value
    elif where in ("offset", "offset_velocity"):
        getattr(m.driven, where)[0, 1] = value
    else:
        m.driven.link_offsets[where][0, 2] = value
    assert made.contain() == FLAG_QUARANTINED
    assert m.corrected[0].tolist() == m.start[0].tolist()
    assert m.driven.last.poses[0].tolist() == m.start[0].tolist()
    assert m.driven.offset_velocity[0].tolist() == [0, 0, 0]
    assert m.driven.offset[0] == pytest.approx([0.1 - 0.3, 0, 0], abs=1e-15)  # from the recording
    assert np.isfinite(m.driven.link_offsets["translation"]).all()
    assert m.corrected[1, 0] == 1.2  # the other one
    assert m.driven.offset_velocity[1, 0] == 0.5
    assert (m.detection.axes.rows["pair"] == -1).all()  # directions may be of bad poses
    assert made.contain() == 0


def test_in_the_first_frame_it_is_put_where_it_was_recorded() -> None:
    made = Contained()
    made.data.driven.offset[0] = math.nan
    assert made.contain(first=True) == FLAG_QUARANTINED
    assert made.data.corrected[0].tolist() == made.data.recorded[0].tolist()
    assert made.data.driven.offset[0].tolist() == [0, 0, 0]


def test_the_posture_to_go_back_to_is_the_last_good_one(tmp_path: Path) -> None:
    data = make_replay_data(planar_arm(tmp_path).scene)
    packed = pack(data)
    for angles in ((0.1, 0.2), (0.3, math.nan), (math.inf, 0.4)):
        data.driven.last.angles[:] = angles
        keep_posture(packed)
    assert data.posture.tolist() == [0.3, 0.4]
