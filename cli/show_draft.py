"""Prints the result of drafting a scene file."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from .terminal import counted, fields, heading

if TYPE_CHECKING:
    from geomphys.authoring.avatar_draft import AvatarDraft
    from geomphys.authoring.scene_draft import SceneDraft
    from geomphys.recording.space_guess import SpaceGuess

    from .terminal import Terminal


def show_draft(terminal: Terminal, draft: SceneDraft, log: Path, out: Path) -> None:
    """Print what was found for each avatar, and what to do next."""
    rows = [(avatar.name, list(_found(avatar))) for avatar in draft.avatars]
    space = list(space_lines(draft.space))
    if space:
        rows.append(("Space", space))
    unused = [p.name for p in draft.others.poses] + list(draft.others.joints)
    if unused:
        rows.append(("Not used", [_some(unused)]))
    if not draft.is_replayable:
        rows.append(
            ("But", ["it cannot be replayed yet: nothing in it follows a topic; fill in the lines in comments"])
        )
    names = (shlex.quote(str(log)), shlex.quote(str(out)))
    steps = [f"look at the lines of {out} marked CHECK, then", "geomphys check {} --scene {}".format(*names)]
    if not all(avatar.tall for avatar in draft.avatars):
        steps.append(
            "for the height of the table; T0:T1 is when the hand lay flat on it, seconds from the first frame:"
        )
        steps.append("geomphys calibrate {} --scene {} --flat T0:T1 --on table --write".format(*names))
    rows.append(("Next", steps))
    terminal.result(heading(str(out), f" for {log.name}"), fields(rows))


def _found(avatar: AvatarDraft) -> Iterator[str]:
    """Yield the inputs of an avatar."""
    if avatar.keypoints is not None:
        points = avatar.keypoints
        yield f"points: {counted(points.links, 'link')} follow {points.topic} ({points.layout}); angles are fitted to them"
        yield f"root {avatar.root_link}: " + ("fitted too" if avatar.root is None else f"follows {avatar.root.name}")
        return
    if avatar.root is None:
        yield f"root {avatar.root_link}: stands still, no pose of the log looks like it"
    else:
        yield f"root {avatar.root_link}: follows {avatar.root.name}"
    if not avatar.joints_topic:
        guesses = counted(len(avatar.matches), "guess", "guesses")
        what = (
            f"; {guesses} in comments"
            if avatar.matches
            else "; names to fill in are in comments"
            if avatar.guessed_topic
            else ""
        )
        yield f"joints: none of the log has a name of the URDF, so all stand still{what}"
        if avatar.two_sides:
            yield f"side: {avatar.guessed_topic} has a left and a right hand, and nothing says which this is"
        return
    by_name = sum(m.how == "name" for m in avatar.matches)
    how = f"{by_name} by name" if by_name else f"{len(avatar.used)} under other names"
    yield f"joints: {how} from {avatar.joints_topic}, {avatar.unit.unit} ({avatar.unit.reason})"
    if avatar.unit.doubt:
        yield f"unit: {avatar.unit.doubt}"
    if avatar.mirrored:
        yield f"sign: opposite in {_some(avatar.mirrored)}? They would be within their limits"
    renamed = sum(m.how == "spelling" for m in avatar.matches)
    guessed = sum(m.how == "guess" and m.is_used for m in avatar.matches)
    alike = len(avatar.matches) - by_name - renamed - guessed
    if renamed or guessed or alike:
        labels = (
            f"{renamed} spelled otherwise",
            f"{guessed} guessed and renamed",
            f"{alike} only alike and left in comments",
        )
        yield f"names: {', '.join(t for t, n in zip(labels, (renamed, guessed, alike), strict=True) if n)}"
    if avatar.joint_choices:
        yield f"or: the same joints are on {_some(avatar.joint_choices)}"
    if avatar.unmatched_joints:
        yield f"{counted(len(avatar.unmatched_joints), 'joint')} not recorded, they stand still: {_some(avatar.unmatched_joints)}"


def space_lines(space: SpaceGuess) -> Iterator[str]:
    """Yield the guesses of the recorded space that differ from the defaults."""
    for statement, reason, is_certain in (
        (f"{space.up} is up", space.up_reason, space.is_up_certain),
        (f"lengths are in {space.unit}", space.unit_reason, space.is_unit_certain),
    ):
        if reason:
            yield f"{statement}: {reason}" if is_certain else f"perhaps {statement}: {reason}"


def _some(names: Sequence[str]) -> str:
    """Return the first names, and how many more there are."""
    return ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")
