"""What is said of samples out of order, repeated times, and joint messages of unequal lengths: the worst topic, with counts."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from geomphys.recording.routes import LengthMismatches
from geomphys.recording.sample_warnings import largest_disorder, length_mismatch_warnings, most_repeated


def route(topic: str, out_of_order: int = 0, disorder: int = 0, duplicates: int = 0, **lengths: int) -> Any:
    return SimpleNamespace(
        input=SimpleNamespace(topic=topic), out_of_order=out_of_order, max_disorder=disorder,
        stream=SimpleNamespace(duplicates=duplicates), length_mismatches=LengthMismatches(**lengths),
    )  # fmt: skip


def log_pass(poses: list[Any] = [], joints: list[Any] = []) -> Any:  # noqa: B006 - never changed
    return SimpleNamespace(poses=poses, joints=joints)


def source(time: str = "header", **messages: int) -> Any:
    topics = {f"/{name}": [SimpleNamespace(messages=count)] for name, count in messages.items()}
    reader = SimpleNamespace(of_topic=lambda topic: topics.get(topic, []))
    return SimpleNamespace(reader=reader, config=SimpleNamespace(time=time))


def test_the_topic_farthest_behind_is_named() -> None:
    routes = [route("/a", 3, 10**9), route("/b", 1, 2_500_000_000), route("/c", 0, 9 * 10**9)]
    assert largest_disorder(log_pass(routes[:1], routes[1:])) == ": up to 2.500 s behind, on topic /b"
    assert largest_disorder(log_pass(routes[2:])) == ""


def test_repeated_times_are_told_where_most_of_a_topic_is_lost() -> None:
    passed = log_pass([route("/a", duplicates=60)], [route("/b", duplicates=10)])
    assert most_repeated(source(a=100, b=10), passed).startswith(": 60 of the 100 of topic /a")
    assert most_repeated(source(a=120, b=10), passed) == ""  # half of them
    assert most_repeated(source("log", a=100), passed) == ""
    assert most_repeated(source(), log_pass()) == ""


def test_unequal_lengths_are_counted_once_a_topic() -> None:
    """Two trees that follow one topic count the same messages."""
    joints = [route("/j", empty=3, shorter=2), route("/j", empty=3), route("/k", longer=4), route("/l")]
    texts = [str(warning) for warning in length_mismatch_warnings(source(j=20, k=10, l=5), log_pass(joints=joints))]
    assert len(texts) == 2
    assert texts[0].startswith("topic /j: of 20 messages 3 have no positions and 2 have fewer positions than names")
    assert texts[1].startswith("topic /k: of 10 messages 4 have more positions than names")
