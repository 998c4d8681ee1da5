"""Findings of a scene as lines for people: one for each model, with the first reasons and how many more."""

from __future__ import annotations

from geomphys.scene.findings import MAX_REASONS, Findings, NotShown, RenamedFrame


def test_skipped_visuals_are_listed_by_model_and_bounded() -> None:
    many = tuple(NotShown("hand.urdf", f"link l{k}: cannot be read") for k in range(MAX_REASONS + 2))
    lines = Findings(not_shown=(NotShown("cup.urdf", "link cup: no file"), *many), sizes=("is 30 m wide",)).warnings
    assert lines[0] == "cup.urdf: a visual is not shown: link cup: no file"
    assert lines[1].startswith(f"hand.urdf: {MAX_REASONS + 2} visuals are not shown: link l0")
    assert lines[1].endswith("; and 2 more")
    assert lines[1].count("cannot be read") == MAX_REASONS
    assert lines[2] == "is 30 m wide"


def test_as_many_reasons_as_are_listed_leave_no_rest() -> None:
    (line,) = Findings(not_shown=tuple(NotShown("a.urdf", f"r{k}") for k in range(MAX_REASONS))).warnings
    assert "more" not in line


def test_renamed_frames_are_notes() -> None:
    (line,) = Findings(renamed_frames=(RenamedFrame("hand/palm", "palm", "hand/palm"),)).notes
    assert "'palm' of 'hand'" in line
    assert "'hand/palm'" in line
    assert Findings().warnings == Findings().notes == ()
