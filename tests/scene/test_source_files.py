"""What a world was made of: contents and probes are noted, and a change of any is seen."""

from __future__ import annotations

from pathlib import Path

import pytest

from geomphys.scene.source_files import Sources, path_exists, track_contents, track_sources, tracked_sources


@pytest.fixture
def loaded(tmp_path: Path) -> tuple[Path, Sources]:
    """A file that was read, beside one that was looked for in vain and one that was found."""
    (tmp_path / "scene.toml").write_bytes(b"content")
    (tmp_path / "there").touch()
    with tracked_sources() as sources:
        assert track_contents(tmp_path / "scene.toml", b"content") == b"content"
        assert path_exists(tmp_path / "there")
        assert not path_exists(tmp_path / "absent")
    return tmp_path, sources


def test_what_is_as_it_was_is_unchanged(loaded: tuple[Path, Sources]) -> None:
    folder, sources = loaded
    assert sources.are_unchanged()
    (folder / "scene.toml").write_bytes(b"content")  # written anew, the same
    assert sources.are_unchanged()


@pytest.mark.parametrize("change", ["other bytes", "gone", "appeared", "vanished"])
def test_a_change_is_seen(loaded: tuple[Path, Sources], change: str) -> None:
    folder, sources = loaded
    if change == "other bytes":
        (folder / "scene.toml").write_bytes(b"Content")
    elif change == "gone":
        (folder / "scene.toml").unlink()
    elif change == "appeared":
        (folder / "absent").touch()
    else:
        (folder / "there").unlink()
    assert not sources.are_unchanged()


def test_an_enclosing_block_learns_what_an_inner_one_read(tmp_path: Path) -> None:
    with tracked_sources() as outer:
        with tracked_sources() as inner:
            track_contents(tmp_path / "a", b"a")
        track_contents(tmp_path / "b", b"b")
    assert set(inner.contents) == {tmp_path / "a"}
    assert set(outer.contents) == {tmp_path / "a", tmp_path / "b"}
    with tracked_sources() as later:
        track_sources(inner)
    assert later.contents == inner.contents


def test_outside_of_a_block_nothing_is_noted_and_names_that_are_no_paths_are_not_there(tmp_path: Path) -> None:
    assert track_contents(tmp_path / "a", b"a") == b"a"
    assert not path_exists(tmp_path / "a\0b")
