"""Messages that are added many at once give the frames and the report that they give one by one."""

from __future__ import annotations

import math
import random
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.recording import channels, log_pass, message_batches, stream_prescan
from geomphys.recording.frames import FrameSource
from geomphys.scene.world import World
from tests.recording.log_files import Item, Tree, joints, make_world, pose, turned, write_log

WORLD = make_world(Tree(root="/wrist", topic="/glove", joints=("a", "b", "c")))
MOUNTED = make_world(
    Tree(root="/wrist", topic="/glove", joints=("a", "b", "c"), offset=(0.01, -0.02, 0.03, *turned(0.4))),
    recording={"up": "y", "unit": "cm", "position": [0.1, 0.2, 0.3]},
)
LIMITED = make_world(Tree(root="/wrist", topic="/glove", joints=("a", "b", "c"), limits=(-0.9, 0.8)))
S = 10**9


def steady(seconds: float = 8.0, joint_rate: int = 50) -> list[Item]:
    """A wrist at 60 Hz, and three joints at 50 Hz in another order than the scene's; with 60 Hz at the wrist's stamps."""
    wrist = [
        pose("/wrist", 100 + k / 60, (math.sin(k / 60), 0.1, 0.2, *turned(k / 90)), stamp=90 * S + k * S // 60)
        for k in range(int(60 * seconds))
    ]
    glove = [
        joints(
            "/glove",
            100.003 + k / joint_rate,
            {n: math.sin(k / 9 + i) for i, n in enumerate("cab")},
            stamp=90 * S + k * S // joint_rate,
        )
        for k in range(int(joint_rate * seconds))
    ]
    return sorted([*wrist, *glove], key=lambda item: item.log_time)


def found(
    path: Path, config: Config, monkeypatch: pytest.MonkeyPatch, *, batches: bool, world: World = WORLD
) -> tuple[object, int, int]:
    """What a log gives: frames with all bits, report or error; how many batches were added, and frames made, at once."""
    added, made = [0], [0]
    add, frames_at_samples = message_batches.BatchAdder.add, log_pass.LogPass._frames_at_samples

    def counted(self, batch, watermark):
        done = batches and add(self, batch, watermark)
        added[0] += done
        return done

    def made_at_once(self, times):
        frames = frames_at_samples(self, times) if batches else []
        made[0] += len(frames)
        return frames

    with monkeypatch.context() as patch:
        patch.setattr(channels, "_cache", threading.local())  # readers that have learned no layout yet
        patch.setattr(log_pass.BatchAdder, "add", counted)
        patch.setattr(log_pass.LogPass, "_frames_at_samples", made_at_once)
        frames = []
        try:
            with FrameSource(path, world, config) as source:
                for f in source:
                    frames.append((f.index, f.time_ns, f.roots.tobytes(), f.angles.tobytes(), f.held, f.flags))
                return (frames, source.report), added[0], made[0]
        except LogError as error:
            return (frames, str(error)), added[0], made[0]


def late(items: list[Item], k: int, chance: random.Random) -> None:
    items.insert(min(len(items), k + chance.randrange(1, 250)), items.pop(k))
    for i, item in enumerate(items):  # the order in the file is that of the log times
        items[i] = replace(item, log_time=100 * S + i * S // 110)


def late_topic(items: list[Item], k: int, chance: random.Random) -> None:
    items[k:] = [replace(i, log_time=i.log_time + 2 * S * (i.topic == "/glove")) for i in items[k:]]
    items.sort(key=lambda item: item.log_time)


def changed(**values: object) -> Callable[[list[Item], int, random.Random], None]:
    def change(items: list[Item], k: int, chance: random.Random) -> None:
        items[k] = replace(items[k], **values)

    return change


def value(make: Callable[[Item], object]) -> Callable[[list[Item], int, random.Random], None]:
    def change(items: list[Item], k: int, chance: random.Random) -> None:
        items[k] = replace(items[k], value=make(items[k]))

    return change


IRREGULAR: dict[str, Callable[[list[Item], int, random.Random], None]] = {
    "nothing": lambda items, k, chance: None,
    "late": late,
    "late topic": late_topic,
    "repeated": lambda items, k, chance: items.insert(k, items[k]),
    "gap": lambda items, k, chance: items.__delitem__(slice(k, k + 60)),
    "zero stamp": changed(stamp=0),
    "stamp of the future": changed(stamp=95 * S),
    "stamp of the past": changed(stamp=80 * S),
    "bad value": value(lambda i: dict(i.value, a=math.nan) if i.kind == "joints" else (math.nan, *i.value[1:])),
    "scaled": value(lambda i: dict.fromkeys(i.value, 2000000000.0) if i.kind == "joints" else tuple(1.001 * v for v in i.value)),
    "missing": value(lambda i: {n: v for n, v in i.value.items() if n != "b"} if i.kind == "joints" else i.value),
    "another order": value(lambda i: dict(reversed(i.value.items())) if i.kind == "joints" else i.value),
}  # fmt: skip


@pytest.mark.parametrize("name", IRREGULAR)
@pytest.mark.parametrize(
    ("joint_rate", "world", "config"),
    [
        pytest.param(50, WORLD, Config(), id="interpolated"),
        pytest.param(50, WORLD, Config(rate=45.0), id="rate"),
        pytest.param(60, WORLD, Config(), id="at samples"),
        pytest.param(60, MOUNTED, Config(), id="tracker mounted on the wrist"),
        pytest.param(60, LIMITED, Config(), id="outside limits"),
        pytest.param(60, LIMITED, Config(clamp_limits=True), id="clamped"),
    ],
)
def test_the_same_frames_and_report(
    name: str, joint_rate: int, world: World, config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chance = random.Random(name)
    for trial in range(4):
        items = steady(joint_rate=joint_rate)
        for _ in range(trial):
            IRREGULAR[name](items, chance.randrange(len(items) - 60), chance)
        path = write_log(tmp_path / f"{trial}.mcap", items)
        one_by_one, *_ = found(path, config, monkeypatch, batches=False, world=world)
        at_once, added, made = found(path, config, monkeypatch, batches=True, world=world)
        assert at_once == one_by_one
        assert added or trial, "of a steady recording most messages are added at once"
        assert made > 400 or trial or joint_rate == 50, "frames at the stamps of all streams are made at once"


@pytest.mark.parametrize("name", IRREGULAR)
def test_the_same_is_known_of_the_beginning(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    chance, answers = random.Random(name), list[bool]()
    repeats = stream_prescan._repeats

    def recorded(*arguments):
        answers.append(repeats(*arguments))
        return answers[-1]

    for trial in range(8):
        items = steady()
        for _ in range(trial):
            IRREGULAR[name](items, chance.randrange(140), chance)
        path = write_log(tmp_path / f"{trial}.mcap", items)
        found = []
        for asked in (recorded, lambda *_: False):
            monkeypatch.setattr(channels, "_cache", threading.local())
            monkeypatch.setattr(stream_prescan, "_repeats", asked)
            try:
                with FrameSource(path, WORLD, Config()) as source:
                    found.append({**vars(source.prescan), **vars(source.times), "readers": None, "channels": None})
            except LogError as error:
                found.append(str(error))
        assert found[0] == found[1]
        assert trial or any(answers), "of a steady recording most messages are passed over at once"


def test_a_jump_to_another_clock_is_found_at_the_same_message(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    items = [replace(item, stamp=item.stamp + (k > 400) * 10**6 * S) for k, item in enumerate(steady())]
    path = write_log(tmp_path / "log.mcap", items)
    one_by_one, *_ = found(path, Config(), monkeypatch, batches=False)
    assert "jump ahead by" in str(one_by_one)
    assert found(path, Config(), monkeypatch, batches=True)[0] == one_by_one
