"""Figures of a result."""

from __future__ import annotations

import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

import geomphys
from geomphys.analysis.binned_curve import BinnedCurve
from tests.made import Results


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_the_same_output_gives_the_same_picture(landed: Results, tmp_path: Path, suffix: str) -> None:
    pictures = set()
    for number in range(6 if suffix == ".svg" else 2):  # the layout of panels varies in the last bits, now and then
        other_places_in_memory = [object() for _ in range(1000 * number)]
        path = tmp_path / f"{number}{suffix}"
        geomphys.plot_output(landed.out, path)
        pictures.add(path.read_bytes())
        assert path.stat().st_size > 5000
        del other_places_in_memory
    assert len(pictures) == 1


def test_a_png_is_as_wide_as_a_column_of_print(landed: Results, tmp_path: Path) -> None:
    geomphys.plot_output(landed.out, tmp_path / "a.png")
    picture = Image.open(tmp_path / "a.png").convert("RGB")
    assert picture.width == 1440
    assert len(np.unique(np.asarray(picture).reshape(-1, 3), axis=0)) > 100


def test_each_panel_alone_is_smaller(landed: Results, tmp_path: Path) -> None:
    heights = []
    for panel in ("time", "penetration", "correction", "contacts"):
        geomphys.plot_output(landed.out, tmp_path / f"{panel}.svg", panels=[panel])
        heights.append(
            float(ElementTree.parse(tmp_path / f"{panel}.svg").getroot().get("height", "").removesuffix("pt"))
        )
    geomphys.plot_output(landed.out, tmp_path / "all.svg")
    whole = float(ElementTree.parse(tmp_path / "all.svg").getroot().get("height", "").removesuffix("pt"))
    assert max(heights) < whole < sum(heights)


def test_without_stage_times_the_others_are_shown(pressed: Results, tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    geomphys.run(pressed.log, pressed.scene, out=out, options=geomphys.OutputOptions(timing=False))
    geomphys.plot_output(out, tmp_path / "a.png")
    with pytest.raises(geomphys.LogError, match="--no-timing"):
        geomphys.plot_output(out, tmp_path / "b.png", panels=["time"])
    assert not (tmp_path / "b.png").exists()


@pytest.mark.parametrize(
    ("name", "options"), [("a.gif", {}), ("a.png", {"panels": ["speed"]}), ("a.png", {"scale": "cubic"})]
)
def test_wrong_parameters(pressed: Results, tmp_path: Path, name: str, options: dict[str, object]) -> None:
    with pytest.raises(geomphys.ConfigError):
        geomphys.plot_output(pressed.out, tmp_path / name, **options)  # type: ignore[arg-type]


def test_a_picture_is_not_overwritten(pressed: Results, tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"old")
    with pytest.raises(geomphys.OutputError, match="exists"):
        geomphys.plot_output(pressed.out, tmp_path / "a.png")
    geomphys.plot_output(pressed.out, tmp_path / "a.png", force=True)


@pytest.mark.parametrize("length", [1, 2, 3, 16, 17, 333])
@pytest.mark.parametrize("capacity", [2, 16, 50])
def test_bins_keep_means_and_largest_of_equal_stretches(length: int, capacity: int) -> None:
    series = np.random.default_rng(length).random(length)
    bins = BinnedCurve(capacity)
    for frame, value in enumerate(series):
        bins.add(frame, value)
    starts = range(0, length, bins.stride)
    assert bins.frames().tolist() == list(starts)
    assert len(bins.frames()) <= capacity
    assert bins.maximum().tolist() == [series[k : k + bins.stride].max() for k in starts]
    assert bins.mean() == pytest.approx([series[k : k + bins.stride].mean() for k in starts])


def test_without_matplotlib_the_extra_is_named(
    landed: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(geomphys.ConfigError, match=r"pip install 'geomphys\[plots\]'"):
        geomphys.plot_output(landed.out, tmp_path / "a.png")
    assert list(tmp_path.iterdir()) == []
