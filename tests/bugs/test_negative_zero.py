"""A recorded -0.0 of a driven body became 0.0: an offset of nothing was added to it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.driven.logs import Thing, play
from tests.scene.models import joint, link, urdf


def test_a_recorded_minus_zero_stays(tmp_path: Path) -> None:
    urdf(
        tmp_path / "hand.urdf",
        link("palm", '<geometry><sphere radius="0.05"/></geometry>'),
        link("tip", '<geometry><sphere radius="0.02"/></geometry>'),
        joint("j", "palm", "tip", xyz="0 0 0.2"),
    )
    path = np.full((5, 3), -0.0)
    ball = Thing(name="ball", shape=("sphere", 0.05), role="driven", path=path + np.eye(3)[0])
    for mode in ("rigid", "chains"):
        avatar = (
            f'[[avatar]]\nname="hand"\nurdf="hand.urdf"\nmaterial="human"\nmode="{mode}"\n'
            'joints={topic="/angles"}\nroot={topic="/palm"}\n'
        )
        run = play(
            tmp_path, [ball], avatars=avatar, roots={"/palm": path}, angles={"/angles": (["j"], np.zeros((5, 1)))},
        )  # fmt: skip
        assert np.signbit(run.recorded[:, run.body("hand/palm"), :3]).all()
        assert run.corrected.tobytes() == run.recorded.tobytes(), mode
