"""Clips for batches are cut without loss, and whole processes are timed with their shares."""

from __future__ import annotations

from pathlib import Path

import pytest

from geomphys.bench.experiments import ExperimentFiles
from geomphys.bench.whole import CLIP_NS, cut_clips, time_batches, time_process
from geomphys.recording.reader import open_log
from tests.cli.press import SCENE, write_log


def messages(log: Path) -> list[tuple[str, int, bytes]]:
    with open_log(log, recover=False) as reader:
        topics = {key: channel.topic for key, channel in reader.channels.items()}
        return [(topics[m.key], m.log_time, m.data) for m in reader.read()]


def test_clips_hold_the_messages_of_five_seconds_each_and_come_round_again(root: Path, tmp_path: Path) -> None:
    log = root / "recordings/hand_ball.mcap"
    whole = messages(log)
    seconds = cut_clips(log, tmp_path / "clips", 4)
    clips = [messages(path) for path in sorted((tmp_path / "clips").iterdir())]
    distinct = [clip for k, clip in enumerate(clips) if clip not in clips[:k]]
    first = whole[0][1]
    for number, clip in enumerate(distinct):
        assert clip == [m for m in whole if number == (m[1] - first) // CLIP_NS]
        assert clip[-1][1] - clip[0][1] < CLIP_NS
    assert len(distinct) < len(clips) == 4
    assert clips[len(distinct)] == clips[0]
    assert seconds == pytest.approx(sum(clip[-1][1] - clip[0][1] for clip in clips) * 1e-9, abs=1e-9)


@pytest.mark.slow
def test_a_process_and_its_shares_and_batches(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    write_log(tmp_path / "log.mcap", frames=600)
    files = ExperimentFiles(name="press", log=tmp_path / "log.mcap", scene=tmp_path / "scene.toml")
    found = time_process(files, 1, rrd=True)
    assert found.frames == 600
    assert sum(share.seconds for share in found.shares) == pytest.approx(found.wall_s)
    assert all(share.seconds > 0 for share in found.shares)
    batch = time_batches(files, 3, (1,))[0]
    assert batch.recorded_s > 10.0
    assert batch.real_time_ratio == batch.recorded_s / batch.wall_s
