"""What a drafted scene file came to, as a person reads it."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from .terminal import counted, fields, heading

if TYPE_CHECKING:
    from geomphys.draft import SceneDraft
    from geomphys.draft_text import AvatarDraft

    from .terminal import Terminal


def show_draft(terminal: Terminal, draft: SceneDraft, log: Path, out: Path) -> None:
    """Print what was found for each avatar, and what to do next."""
    rows = [(avatar.name, list(_found(avatar))) for avatar in draft.avatars]
    left = [p.name for p in draft.others.poses] + list(draft.others.joints)
    if left:
        more = f" and {len(left) - 6} more" if len(left) > 6 else ""
        rows.append(("Not used", [", ".join(left[:6]) + more]))
    names = (shlex.quote(str(log)), shlex.quote(str(out)))
    rows.append(
        ("Next", [f"look at the lines of {out} marked CHECK, then", "geomphys check {} --scene {}".format(*names)])
    )
    terminal.result(heading(str(out), f" for {log.name}"), fields(rows))


def _found(avatar: AvatarDraft) -> Iterator[str]:
    """Yield what an avatar follows."""
    if avatar.root is None:
        yield f"root {avatar.root_link}: stands still, no pose of the log looks like it"
    else:
        yield f"root {avatar.root_link}: follows {avatar.root.name}"
    if not avatar.joints_topic:
        guesses = f"; {counted(len(avatar.matches), 'guess')} in comments" if avatar.matches else ""
        yield f"joints: none of the log has a name of the URDF{guesses}".replace("guesss", "guesses")
        return
    by_name = sum(m.how == "name" for m in avatar.matches)
    yield f"joints: {by_name} by name from {avatar.joints_topic}, {avatar.unit.unit} ({avatar.unit.reason})"
    renamed = sum(m.how == "spelling" for m in avatar.matches)
    guessed = sum(m.how == "guess" for m in avatar.matches)
    if renamed or guessed:
        yield f"names: {renamed} spelled otherwise and renamed, {guessed} only alike and left in comments"
    if avatar.unmatched_joints:
        yield f"{counted(len(avatar.unmatched_joints), 'joint')} not recorded: {', '.join(avatar.unmatched_joints[:6])}"
