"""The figure page: it has every experiment, and its pictures are what the program gives now."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import geomphys

ROOT = Path(__file__).resolve().parent.parent
PICTURES = ROOT / "assets" / "docs" / "pictures"


@pytest.fixture
def scripts(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "assets"))
    yield
    for name in ("figure_scenes", "figure_drawing", "grip_figures", "make_figures"):
        sys.modules.pop(name, None)


def pixels(data: bytes, tmp_path: Path) -> np.ndarray:
    from matplotlib.image import imread

    path = tmp_path / "picture.png"
    path.write_bytes(data)
    return imread(path)[..., :3]


@pytest.mark.usefixtures("scripts")
def test_the_page_shows_every_experiment():
    from figure_scenes import EXPERIMENTS

    page = (ROOT / "assets" / "docs" / "figures.md").read_text()
    for experiment in EXPERIMENTS:
        assert f"## {experiment.title}\n" in page, "run: make figures"
        for name in [f"{experiment.name}_times.png", *(f"{experiment.name}_{s.frame}.png" for s in experiment.shots)]:
            assert f"(pictures/{name})" in page, "run: make figures"
            assert (PICTURES / name).is_file(), "run: make figures"


@pytest.mark.usefixtures("scripts")
def test_the_page_shows_every_grip():
    from grip_figures import GRIP_FIGURES

    page = (ROOT / "assets" / "docs" / "figures.md").read_text()
    for grip in GRIP_FIGURES:
        assert f"| {grip.title} |" in page, "run: make figures"
        assert f"(pictures/{grip.name}_held.png)" in page, "run: make figures"
        assert (PICTURES / f"{grip.name}_held.png").is_file(), "run: make figures"


@pytest.mark.usefixtures("scripts")
def test_pictures_show_what_the_program_does(tmp_path):
    from figure_drawing import before_and_after
    from figure_scenes import EXPERIMENTS

    (experiment,) = [e for e in EXPERIMENTS if e.name == "finger_snip"]
    scene = ROOT / "assets" / "scenes" / "finger_snip.toml"
    world = geomphys.load_world(scene)
    wanted = {n for shot in experiment.shots for n in (shot.frame, shot.later)}
    last = max(wanted)
    results = {}
    for result in geomphys.replay(
        ROOT / "recordings" / "finger_snip.mcap", world, config=geomphys.Config(end=last / 120)
    ):
        if result.frame.index in wanted:
            results[result.frame.index] = result
    for shot in experiment.shots:
        drawn = before_and_after(world, results[shot.frame], results[shot.later], shot)
        committed = (PICTURES / f"finger_snip_{shot.frame}.png").read_bytes()
        difference = np.abs(pixels(drawn, tmp_path) - pixels(committed, tmp_path))
        assert difference.mean() < 0.02, "run: make figures"  # a ball may roll a little further
