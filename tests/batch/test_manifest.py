"""The record of a batch on disk."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from geomphys.batch.manifest import FORMAT, Entry, Manifest, ManifestRecord
from geomphys.errors import OutputError

ENTRY = Entry(
    log="/logs/a.mcap",
    out="a.mcap",
    version="1",
    scene_sha256="s",
    world_sha256="w",
    parameters={"seed": 0, "rate": None},
)


def test_what_is_saved_is_loaded(tmp_path: Path) -> None:
    manifest = Manifest(tmp_path, {"b.mcap": replace(ENTRY, out="b.mcap", error="ö"), "a.mcap": ENTRY})
    manifest.save()
    assert Manifest.load(tmp_path).entries == manifest.entries
    assert [path.name for path in tmp_path.iterdir()] == ["manifest.json"]
    assert Manifest.load(tmp_path / "nowhere").entries == {}


def test_the_file_is_the_record_as_json_after_every_change(tmp_path: Path) -> None:
    """Entries that were saved before are not encoded again, which the file does not show."""
    manifest = Manifest(tmp_path)
    manifest.save()
    changes = [
        ENTRY,
        replace(ENTRY, out="b/ö.mcap"),
        replace(ENTRY, error='two\nlines "x"', metrics={"a": [1.5, None]}),
    ]
    for entry in changes:
        manifest.entries[entry.out] = entry
        manifest.save()
        record = ManifestRecord(FORMAT, tuple(manifest.entries[out] for out in sorted(manifest.entries)))
        whole = json.dumps(asdict(record), indent=1, ensure_ascii=False) + "\n"
        assert manifest.path.read_text(encoding="utf-8") == whole
    assert len(manifest.entries) == 2


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"format": 1, "logs": [{"log": "a"}]}', '{"format": 9, "logs": []}'])
def test_what_is_no_manifest_is_said(tmp_path: Path, text: str) -> None:
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(OutputError, match=r"manifest\.json"):
        Manifest.load(tmp_path)


@pytest.mark.parametrize(
    "change",
    [
        {"status": "failed"}, {"status": "pending"}, {"version": "2"}, {"world_sha256": "x"}, {"scene_sha256": "x"},
        {"parameters": {"seed": 1, "rate": None}}, {"rrd": "a.rrd"}, {"input_sha256": "other"},
    ],
)  # fmt: skip
def test_only_the_same_input_scene_parameters_and_version_count_as_done(change: dict[str, object]) -> None:
    done = replace(ENTRY, status="done", input_sha256="i")
    assert done.is_made_from(ENTRY, "i")
    assert not replace(done, **change).is_made_from(ENTRY, "i")  # type: ignore[arg-type]


def test_outputs_that_were_touched_are_not_whole(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"result")
    entry = replace(ENTRY, out_sha256=hashlib.sha256(b"result").hexdigest())
    assert entry.outputs_are_complete(tmp_path)
    (tmp_path / "a.mcap").write_bytes(b"resulT")
    assert not entry.outputs_are_complete(tmp_path)
    (tmp_path / "a.mcap").unlink()
    assert not entry.outputs_are_complete(tmp_path)


GOOD = {"log": "a", "out": "a.mcap", "version": "1", "world_sha256": "a", "parameters": {}}


@pytest.mark.parametrize(
    "content",
    [
        [],
        None,
        3,
        {"format": 1},
        {"format": 1, "logs": 3},
        {"format": 1, "logs": [3]},
        {"format": 1, "logs": [{"out": "a.mcap"}]},
        {"format": 1, "logs": [GOOD | {"out": ["a"]}]},
        {"format": 1, "logs": [GOOD | {"status": "perhaps"}]},
        {"format": 1, "logs": [GOOD | {"parameters": 3}]},
        {"format": 1, "logs": [GOOD | {"metrics": [1]}]},
        {"format": [1]},
        "[" * 100_000,
        "\x00",
        b"\xff\xfe",
    ],
)
def test_a_damaged_manifest_is_one_line(tmp_path: Path, content: object) -> None:
    data = (
        content
        if isinstance(content, bytes)
        else (content if isinstance(content, str) else json.dumps(content)).encode()
    )
    (tmp_path / "manifest.json").write_bytes(data)
    with pytest.raises(OutputError, match=r"manifest\.json: (is no manifest of a batch|has format)") as caught:
        Manifest.load(tmp_path)
    assert "\n" not in str(caught.value)


def test_a_good_entry_is_read(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text(json.dumps({"format": 1, "logs": [GOOD]}))
    assert Manifest.load(tmp_path).entries["a.mcap"].status == "pending"


def test_saving_takes_a_small_share_of_the_time_of_a_long_batch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A log ends every second, saving takes a quarter: it is saved every 125 seconds, and said not to be in between."""
    clock = [0.0]
    monkeypatch.setattr(
        "geomphys.batch.manifest.time", SimpleNamespace(monotonic=lambda: clock[0], thread_time=lambda: clock[0])
    )

    def write(path: Path, data: bytes, *, force: bool) -> None:
        clock[0] += 0.25
        saved.append(len(json.loads(data)["logs"]))

    saved: list[int] = []
    monkeypatch.setattr("geomphys.batch.manifest.write_file", write)
    manifest = Manifest(tmp_path)
    for number in range(500):
        manifest.set(replace(ENTRY, out=f"{number}.mcap"))
        clock[0] += 1.0
    assert saved == [1, 126, 251, 376]
    assert not manifest.is_saved
    manifest.save()
    assert saved[-1] == 500
    assert manifest.is_saved
