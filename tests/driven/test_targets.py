"""Offsets that a step leaves to the next."""

from __future__ import annotations

from pathlib import Path

import pytest

from geomphys.driven.goals import set_joint_limits
from geomphys.driven.targets import store_offsets
from geomphys.engine.state import make_machine
from geomphys.jit.packed_records import pack
from tests.driven.compound import CONE, shoulder


def test_the_step_of_a_joint_s_offset_is_its_whole_change_since_the_update_before(tmp_path: Path) -> None:
    """Also where a tree is moved once more in the step, out of what has moved into it."""
    scene = shoulder(tmp_path, CONE).scene
    machine = make_machine(scene)
    state, packed, q = machine.driven, (pack(scene), pack(machine)), 2
    driven, workspace = packed[1].driven, packed[1].workspace
    roots, angles, recorded = (v.copy() for v in (state.recorded.roots, state.recorded.angles, state.recorded.poses))
    for offsets in ((0.1, 0.13), (0.2, 0.16)):
        before = float(state.joint_offset[q])
        set_joint_limits(packed[0], driven, workspace, angles)
        for offset in offsets:
            state.last.angles[q] = angles[q] + offset
            store_offsets(packed[0], driven, workspace, roots, angles, recorded)
        assert state.joint_step[q] == pytest.approx(offsets[-1] - before, rel=1e-9)
