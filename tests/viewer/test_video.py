"""Videos: pictures in order, two halves, the stretch asked for, and the same from one process and from two."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import geomphys
from geomphys.errors import ConfigError, LogError, OutputError
from geomphys.viewer.video import VideoConfig, make_video
from tests.made import Results

SMALL = (128, 96)


def pictures(path: Path) -> NDArray[np.float64]:
    """All pictures (n, h, w, 3) of a GIF or MP4."""
    if path.suffix == ".gif":
        with Image.open(path) as image:
            found = []
            for number in range(image.n_frames):
                image.seek(number)
                found.append(np.asarray(image.convert("RGB"), float))
            return np.array(found)
    import imageio_ffmpeg

    reader = imageio_ffmpeg.read_frames(str(path))
    width, height = next(reader)["size"]
    return np.array([np.frombuffer(data, np.uint8).reshape(height, width, 3) for data in reader], float)


@pytest.mark.filterwarnings(
    "ignore::pytest.PytestUnraisableExceptionWarning"
)  # pipes that imageio-ffmpeg leaves to the collector
@pytest.mark.parametrize("suffix", [".gif", ".mp4"])
def test_a_video_shows_the_stretch_in_two_halves(landed: Results, tmp_path: Path, suffix: str) -> None:
    out = tmp_path / f"video{suffix}"
    made = make_video(landed.out, out, VideoConfig(start=0.2, end=0.9, rate=10.0, size=SMALL))
    assert (made.pictures, made.rate) == (8, 10.0)
    found = pictures(out)
    assert found.shape == (8, 96, 256, 3)
    left, right = found[:, 20:, :126], found[:, 20:, 130:]
    apart = np.abs(left - right).mean(axis=(1, 2, 3))
    assert apart[-1] > 1.5 * apart[0], "in the air both are nearly the same; on the table the corrected one is not"
    assert np.abs(np.diff(right, axis=0)).mean(axis=(1, 2, 3)).max() > 0.3, "it moves"


def test_processes_do_not_change_it(landed: Results, tmp_path: Path) -> None:
    outs = [tmp_path / f"{k}.gif" for k in (1, 2)]
    for processes, out in enumerate(outs, 1):
        make_video(landed.out, out, VideoConfig(end=0.3, rate=10.0, size=(64, 64), processes=processes))
    assert outs[0].read_bytes() == outs[1].read_bytes()


@pytest.mark.parametrize(
    ("ending", "said"),
    [
        ("cat > /dev/null; echo '[out @ 0x1] No space left' >&2; exit 1", "No space left"),
        ("echo 'no such codec' >&2; exit 1", "no such codec"),
        ("kill -9 $$", ""),
    ],
)
def test_an_encoder_that_fails_is_one_line_and_no_video(
    landed: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str, said: str
) -> None:
    """A disk that was full at its end gave a broken video, and exit code 0."""
    encoder = tmp_path / "ffmpeg"
    encoder.write_text(f"#!/bin/sh\nfor last; do :; done; echo begun > $last; {ending}\n")
    encoder.chmod(0o700)
    monkeypatch.setattr("imageio_ffmpeg.get_ffmpeg_exe", lambda: str(encoder))
    with pytest.raises(OutputError, match=rf"a\.mp4: ffmpeg could not write it \({said}\); is the disk full\?$"):
        make_video(landed.out, tmp_path / "a.mp4", VideoConfig(end=0.3, rate=10.0, size=(64, 64)))
    assert [path.name for path in tmp_path.iterdir()] == ["ffmpeg"]


def test_the_worst_frame_is_in_the_worst_stretch(landed: Results, tmp_path: Path) -> None:
    columns = geomphys.open_output(landed.out).metrics()
    worst = int(columns["frame"][np.argmax(columns["correction_m"])])
    made = make_video(landed.out, tmp_path / "worst.gif", VideoConfig(worst=True, rate=2.0, size=(64, 64)))
    assert made.first_frame <= worst <= made.last_frame + 30


def test_what_cannot_be_shown_is_told(landed: Results, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"has no frame from 5 to 6 s; it is 1\.18333 s long"):
        make_video(landed.out, tmp_path / "x.gif", VideoConfig(start=5.0, end=6.0))
    with pytest.raises(ConfigError, match="no body 'foot'"):
        make_video(landed.out, tmp_path / "x.gif", VideoConfig(focus="foot"))
    with pytest.raises(OutputError, match=r"a video is \.mp4 or \.gif"):
        make_video(landed.out, tmp_path / "x.avi")
    assert list(tmp_path.iterdir()) == []
    for settings in (
        {"worst": True, "start": 1.0},
        {"start": 2.0, "end": 1.0},
        {"rate": 0.0},
        {"size": (63, 64)},
        {"start": float("nan")},
        {"end": float("inf")},
        {"processes": 0},
    ):
        with pytest.raises(ConfigError):
            VideoConfig(**settings)
