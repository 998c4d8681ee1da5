"""Things that nobody can move close on a hand that cannot get out between them: it is put past one of them, and that is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.results import FLAG_NOT_CONVERGED
from tests.driven.logs import Run, Thing, assert_free, play
from tests.driven.test_chains import ROD, check_limits, finger, hand, names, palm
from tests.scene.models import joint, link

CEILING = Thing(name="ceiling", shape=("box", 12, 12, 0.1), at=(0.0, 0.0, 0.57))
ALONG_Y = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
HOOKED = (0.0, 1.5, 1.5)  # rad: a finger round the bar, to under the palm
BLOCK = '<geometry><box size="0.02 0.02 0.02"/></geometry>'
SLIDE = '<axis xyz="0 -1 0"/><limit lower="{}" upper="0.02" effort="1" velocity="1"/>'


def blocks(low: float) -> list[str]:
    """Two blocks on the palm that are 1 cm apart, less what the joint of one moves it towards the other, `low` [m] at least."""
    return [
        *(link(name, BLOCK) for name in ("block", "slider3")),
        joint("stuck", "palm", "block", "fixed", xyz="0.1 0 0"),
        joint("slide", "palm", "slider3", "prismatic", SLIDE.format(low), "0.1 0.03 0"),
    ]


def squeezed(folder: Path, apart: float) -> Run:
    """A finger round a bar longer than any way aside, which presses the palm on a ceiling; two blocks on it stay `apart` [m]."""
    n = 40
    height = 0.452 + np.concatenate([np.zeros(10), np.linspace(0.0, 0.055, 10), np.full(20, 0.055)])
    bar = np.column_stack([np.full(n, 0.02), np.zeros(n), height, np.tile(ALONG_Y, (n, 1))])
    angles = np.tile([*HOOKED, 0.01 - apart], (n, 1))
    return play(
        folder,
        [CEILING, Thing(name="bar", shape=("cylinder", 0.01, 8.0), path=bar)],
        avatars=hand(folder, [finger("a", 0.0, ROD), blocks(0.01 - apart)], ["a", "slider"]),
        roots={"/palm": palm(n, 0.5)},
        angles={"/angles": ([*names("a"), "slide"], angles)},
    )


@pytest.mark.parametrize("apart", [5e-3, 1e-6], ids=["links apart", "links nearer than the gap"])
def test_a_hand_that_has_closed_on_a_bar_is_put_where_it_is_free(tmp_path: Path, apart: float) -> None:
    run = squeezed(tmp_path, apart)
    assert_free(run)
    check_limits(run)
    assert not (run.figures("flags").astype(int) & FLAG_NOT_CONVERGED).any()
    assert any("leave no way out" in text for result in run.results for _, text in result.messages)


def test_a_hand_that_starts_deep_inside_with_links_in_each_other_is_freed_of_both(tmp_path: Path) -> None:
    """It is translated out of the box, and the blocks are moved apart by the 5 mm that they overlap."""
    run = play(
        tmp_path,
        [Thing(name="box", shape=("box", 0.6, 0.6, 0.6), at=(0.0, 0.0, 0.45))],
        avatars=hand(tmp_path, [finger("a", 0.0, ROD), blocks(-0.02)], ["a", "slider"]),
        roots={"/palm": palm(4, 0.5)},
        angles={"/angles": ([*names("a"), "slide"], np.tile([0.0, 0.3, 0.3, 0.015], (4, 1)))},
    )
    assert_free(run)
    slide = run.angles[:, run.world.dof_names.index("slide")]
    assert slide == pytest.approx(np.full(4, 0.01), abs=1e-4)
