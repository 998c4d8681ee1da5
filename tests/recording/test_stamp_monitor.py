"""Stamps that cannot be times of the log are refused, doubtful ones warned of, and single corrupt ones passed over."""

from __future__ import annotations

from pathlib import Path

import pytest

from geomphys.errors import LogError
from geomphys.recording.stamp_monitor import MAX_TRACKS, StampMonitor, StampStep, StampTrack

MS, S = 10**6, 10**9
DELAY = S
START = 1_000 * S  # ns, of the log
RATE = 10 * MS


def monitor(stamps: list[int], logged: list[int] | None = None, topic: str = "/a") -> StampMonitor:
    """A stream of these stamps, logged every 10 ms."""
    made = StampMonitor(Path("log.mcap"), DELAY)
    for k, stamp in enumerate(stamps):
        made.add(topic, "", stamp, START + k * RATE if logged is None else logged[k])
    made.finish()
    return made


def warnings(made: StampMonitor) -> list[str]:
    return list(made.warnings(("/a", "")))


def steady(count: int, step: int = RATE, start: int = 5 * S) -> list[int]:
    return [start + k * step for k in range(count)]


def test_stamps_of_another_clock_at_the_same_rate_are_good() -> None:
    assert warnings(monitor(steady(200))) == []


def test_the_excess_of_a_step_is_what_the_log_times_do_not_explain() -> None:
    assert StampStep(1 * S, 4 * S, 10 * S, 11 * S).excess == 2 * S


@pytest.mark.parametrize("back", [2 * S, 100 * S])
def test_stamps_that_start_over_end_the_reading(back: int) -> None:
    with pytest.raises(LogError, match=r"start over: they jump back by .* 1\.000 s into the log"):
        monitor([*steady(100, start=200 * S), *steady(100, start=200 * S + 100 * RATE - back)])


def test_one_stamp_that_is_late_or_corrupt_does_not() -> None:
    good = steady(200, start=200 * S)
    for k, wrong in ((50, 100 * S), (120, 0)):
        good[k] = wrong
    assert warnings(monitor(good)) == []


def test_stamps_a_little_out_of_order_are_good() -> None:
    stamps = steady(200)
    for k in range(0, 200, 10):
        stamps[k] -= DELAY // 2
    assert warnings(monitor(stamps)) == []
    back = 5 * S + 100 * RATE - DELAY // 2  # for good, by less than a message may come late
    assert warnings(monitor([*steady(100), *steady(100, start=back)])) == []


@pytest.mark.parametrize(
    ("step", "text"), [(1000 * RATE, "1000 times as fast"), (RATE // 1000, "1000 times slower")], ids=["fast", "slow"]
)
def test_stamps_in_another_unit_end_the_reading(step: int, text: str) -> None:
    with pytest.raises(LogError, match=text):
        monitor(steady(64, step))


def test_few_messages_are_judged_at_the_end_of_the_log() -> None:
    logged = [START + k * S for k in range(6)]
    made = StampMonitor(Path("log.mcap"), DELAY)
    for k in range(6):
        made.add("/a", "", 5 * S + k * 1000 * S, logged[k])
    with pytest.raises(LogError, match="1000 times as fast"):
        made.finish()


def test_a_permanent_jump_ahead_is_warned_of_with_its_place_and_size() -> None:
    stamps = [*steady(100), *steady(100, start=5 * S + 100 * RATE + 3 * S)]
    (text,) = warnings(monitor(stamps))
    assert "jump ahead by 3.000 s" in text
    assert "1.000 s into the log" in text
    assert warnings(monitor([*steady(100), *steady(100, start=5 * S + 100 * RATE + S // 2)])) == []


def test_a_pause_that_the_log_times_show_too_is_no_jump() -> None:
    logged = [START + k * RATE + (3 * S if k >= 100 else 0) for k in range(200)]
    stamps = [*steady(100), *steady(100, start=5 * S + 100 * RATE + 3 * S)]
    assert warnings(monitor(stamps, logged)) == []


@pytest.mark.parametrize(("drift", "warned"), [(7 * S // 10, True), (3 * S // 10, False)])
def test_drift_against_the_frame_clock_is_warned_of(drift: int, warned: bool) -> None:
    made, count = StampMonitor(Path("log.mcap"), DELAY), 400
    for k in range(count):
        made.add("/a", "", 5 * S + k * RATE, START + k * RATE)
        made.add("/b", "", 5 * S + k * RATE + k * drift // count, START + k * RATE)
    texts = warnings(made)
    assert len(texts) == warned
    assert all("/b" in text and "drift by +0.6" in text for text in texts)


def test_what_drifts_with_the_frame_clock_is_good() -> None:
    """The log's clock is the one that is slow."""
    made, count = StampMonitor(Path("log.mcap"), DELAY), 400
    for k in range(count):
        for topic in ("/a", "/b"):
            made.add(topic, "", 5 * S + k * RATE + k * S // count, START + k * RATE)
    assert warnings(made) == []


def test_log_times_of_a_log_that_was_written_afterwards_judge_nothing() -> None:
    logged = [START + k for k in range(200)]
    assert warnings(monitor(steady(200), logged)) == []
    track = StampTrack()
    for k in range(20):
        track.add(k * RATE, START + k, DELAY)
    assert not track.has_rate


def test_spans_are_those_of_the_stream_whatever_one_stamp_says() -> None:
    track = StampTrack()
    stamps = steady(100)
    stamps[0] = 0
    stamps[70] = 4_000_000 * S
    for k, stamp in enumerate(stamps):
        track.add(stamp, START + k * RATE, DELAY)
    span, log_span = track.spans
    assert span == pytest.approx(99 * RATE, abs=4 * RATE)
    assert log_span == pytest.approx(99 * RATE, abs=4 * RATE)


def test_absurdly_many_streams_are_not_all_watched() -> None:
    made = StampMonitor(Path("log.mcap"), DELAY)
    for k in range(MAX_TRACKS + 5):
        made.add("/a", str(k), S, START)
    assert len(made.tracks) == MAX_TRACKS
