"""The `[avatar.joints]` tables of a drafted scene file: topic, unit, sign, renamed joints, joints to fill in."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence

from geomphys.authoring.avatar_draft import AvatarDraft
from geomphys.recording.display_names import printable
from geomphys.recording.joint_matching import JointMatch

MAX_NAMES = 12
"""Maximum names of a list in a comment."""
MAX_FILL_IN_LINES = 60
"""Maximum lines to fill in."""


def joint_lines(avatar: AvatarDraft) -> Iterator[str]:
    """TOML of the joints of an avatar; uncertain lines are comments."""
    topic = avatar.joints_topic or avatar.guessed_topic
    if not topic:
        yield "# No topic of the log has joints of this URDF: all stay at 0."
        if avatar.unmatched_joints:
            yield f"# The URDF has {short_list(avatar.unmatched_joints)}"
        return
    comment_prefix = "" if avatar.joints_topic else "# "
    if comment_prefix:
        yield "# CHECK: no recorded joint has a name of this URDF, so all its joints stand still. If the guesses below are"
        yield "# right, uncomment them all; fill in what is missing."
    if avatar.two_sides:
        yield "# CHECK: the topic has a left and a right hand, and nothing says which of them this is."
    yield comment_prefix + "[avatar.joints]"
    if avatar.joint_choices:
        yield f"# CHECK: or another topic with such joints: {short_list(avatar.joint_choices)}"
    yield comment_prefix + f"topic = {quoted(topic + ('#' + avatar.side if avatar.side else ''))}"
    yield comment_prefix + f'unit = "{avatar.unit.unit}"                   # CHECK: {plain_line(avatar.unit.reason)}'
    if avatar.unit.doubt:
        yield f"# CHECK: {plain_line(avatar.unit.doubt)} Convert them, or map them to rad by `scale` and `offset`."
    if avatar.mirrored:
        yield "# CHECK: recorded with the opposite sign? These joints would then be within their limits; uncomment it if so."
        yield f"# sign = {{ {', '.join(f'{quoted(j)} = -1' for j in avatar.mirrored)} }}"
    if avatar.unmatched_joints:
        yield f"# Not recorded, they stay at 0: {short_list(avatar.unmatched_joints)}"
    if avatar.unmatched_recorded and not comment_prefix:
        yield f"# Recorded, but of no use here: {short_list(avatar.unmatched_recorded)}; if that is meant so:"
        yield f"# ignore = [{', '.join(quoted(n) for n in avatar.unmatched_recorded[:MAX_FILL_IN_LINES])}]"
    yield from _rename(avatar, comment_prefix)


def _rename(avatar: AvatarDraft, comment_prefix: str) -> Iterator[str]:
    """The table of recorded names -> joints of the URDF, and lines to fill in."""
    respelled = [m for m in avatar.matches if m.how == "spelling"]
    guessed = [m for m in avatar.matches if m.how == "guess" and m.is_used]
    similar = [m for m in avatar.matches if not m.is_used]
    unmatched = avatar.unmatched_recorded[:MAX_FILL_IN_LINES] if avatar.unmatched_joints else ()
    if not respelled and not guessed and not similar and not unmatched:
        return
    yield ""
    yield comment_prefix + "[avatar.joints.rename]            # recorded name = joint of the URDF"
    yield from (_pair(m) for m in respelled)
    if guessed:
        yield "# CHECK: guessed from finger, segment and motion."
        yield from (_pair(m) for m in guessed)
    if similar:
        if not comment_prefix:
            yield "# CHECK: only alike; uncomment what is right."
        yield from (f"# {_pair(m)}" for m in similar)
    if unmatched:
        yield f"# CHECK: fill in a joint and uncomment; free are {short_list(avatar.unmatched_joints)}"
        yield from (f'# {quoted(n)} = ""' for n in unmatched)


def _pair(match: JointMatch) -> str:
    return f"{quoted(match.recorded)} = {quoted(match.joint)}"


def plain_line(text: str) -> str:
    """Text as one line of a comment."""
    return "".join(c if c.isprintable() else "?" for c in text)


def short_list(names: Sequence[str]) -> str:
    """The first `MAX_NAMES` names, separated by commas."""
    more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
    return ", ".join(printable(n) for n in names[:MAX_NAMES]) + more


def quoted(text: str) -> str:
    """A string of TOML."""
    return json.dumps(text, ensure_ascii=False)
