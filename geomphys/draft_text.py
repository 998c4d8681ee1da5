"""The text of a drafted scene file: TOML that can be replayed as it is, with comments on what to look at."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from geomphys.recording.inspect import LogInfo, TopicInfo
from geomphys.recording.matching import JointMatch, PoseCandidate, UnitGuess
from geomphys.recording.naming import plain

FAR = 50.0
"""m; positions further from the origin than this are probably millimetres."""
TOLD = 12
"""Names of a list in a comment."""


@dataclass(frozen=True)
class AvatarDraft:
    """What an avatar of a drafted scene follows, and how that was found."""

    name: str
    urdf: str  # path, as the scene file names it
    root_link: str
    tall: bool  # a body, not a hand
    hull: bool  # a mesh of it has holes
    root: PoseCandidate | None
    root_choices: tuple[str, ...]  # the other poses, likeliest first
    joints_topic: str  # "" if none matches
    side: str  # of a glove topic that holds several; else ""
    unit: UnitGuess
    matches: tuple[JointMatch, ...]
    unmatched_recorded: tuple[str, ...]
    unmatched_joints: tuple[str, ...]
    guessed_topic: str  # topic whose joints are only alike; "" if there is a better one or none
    chains: tuple[tuple[str, str, str], ...]  # name, base link, tip link


@dataclass(frozen=True)
class Others:
    """What of a log no avatar follows."""

    poses: tuple[PoseCandidate, ...]
    joints: tuple[str, ...]


def scene_text(log: LogInfo, avatars: Sequence[AvatarDraft], others: Others, lowest: float) -> str:
    """TOML of a scene in which these avatars follow a log; `lowest` is how low [m] the links of hands come."""
    lines = [*_head(log, avatars)]
    for avatar in avatars:
        lines += ["", *_avatar(avatar)]
    lines += ["", *_example(avatars, lowest), "", *_tracked(others)]
    return "\n".join(lines).rstrip("\n") + "\n"


def _head(log: LogInfo, avatars: Sequence[AvatarDraft]) -> Iterator[str]:
    name = log.path.replace("\\", "/").rstrip("/").rsplit("/", 1)[-1]
    yield f"# A scene for {plain(name)}, drafted by `geomphys init`. Lines with CHECK need your eye:"
    yield "# what they say was guessed, or only you can know it."
    yield "# Lengths in metres, angles in radians, world z up, quaternions x y z w; paths are relative to this file."
    yield "#"
    yield "# The log has"
    used = _users(avatars)
    widest = max((len(plain(t.topic)) for t in log.topics), default=0)
    for topic in log.topics:
        what = f"{plain(topic.schema) or 'no schema'}, {_content(topic)}"
        yield f"#   {plain(topic.topic):<{widest}}  {what}{used.get(topic.topic, '')}"
    yield ""
    yield "[scene]"
    yield f"name = {_quoted(_title(name))}"
    yield "gravity = [0.0, 0.0, -9.81]"


def _users(avatars: Sequence[AvatarDraft]) -> dict[str, str]:
    """Topic -> what of the scene follows it, as told behind it."""
    used: dict[str, list[str]] = {}
    for avatar in avatars:
        if avatar.root is not None:
            used.setdefault(avatar.root.name.split("#")[0], []).append(f"root of {avatar.name}")
        if avatar.joints_topic:
            used.setdefault(avatar.joints_topic, []).append(f"joints of {avatar.name}")
    return {topic: " -> " + ", ".join(names) for topic, names in used.items()}


def _content(topic: TopicInfo) -> str:
    """What a topic holds, in a few words."""
    if not topic.kind:
        return "not understood"
    rate = f"{topic.rate_hz:.4g} Hz" if topic.rate_hz is not None else f"{topic.messages} messages"
    if topic.messages == 1:
        rate = "once"
    if topic.joints:
        return f"{rate}, {len(topic.joints)} joints"
    if topic.frames:
        return f"{rate}, {len(topic.frames)} frames"
    return rate


def _avatar(avatar: AvatarDraft) -> Iterator[str]:
    yield "[[avatar]]"
    yield f"name = {_quoted(avatar.name)}"
    yield f"urdf = {_quoted(avatar.urdf)}"
    if avatar.tall:
        yield 'mode = "chains"                # arms, legs, neck bend; "rigid" moves the body as one'
    else:
        yield 'mode = "rigid"                 # keeps the recorded shape; "chains" bends finger by finger'
    yield 'material = "human"'
    if avatar.hull:
        yield 'decomposition = "hull"         # CHECK: a mesh of it has holes, so each collides as its convex hull'
    yield ""
    yield from _root(avatar)
    yield ""
    yield from _joints(avatar)
    for name, base, tip in avatar.chains:
        yield ""
        yield "[[avatar.chain]]"
        yield f"name = {_quoted(name.replace('/', '_').replace('#', '_'))}"
        yield f"base = {_quoted(base)}"
        yield f"tip = {_quoted(tip)}"


def _root(avatar: AvatarDraft) -> Iterator[str]:
    yield "[avatar.root]"
    if avatar.root is None:
        yield "# CHECK: no pose of the log looks like that of the root link; it stands still here."
        for name in avatar.root_choices[:TOLD]:
            yield f"# topic = {_quoted(name)}"
    else:
        others = f"; else: {_named(avatar.root_choices)}" if avatar.root_choices else ""
        yield f"# CHECK: is it the pose of {plain(avatar.root_link)!r}{others}"
        yield f"topic = {_quoted(avatar.root.name)}"
        low, high = avatar.root.low, avatar.root.high
        if max(abs(v) for v in (*low, *high)) > FAR:
            yield "# CHECK: its positions go beyond 50 m. Metres are expected; if they are millimetres, convert the log."
    yield f"# CHECK: where {plain(avatar.root_link)!r} is, seen from the tracker: measure it."
    yield "position = [0.0, 0.0, 0.0]"
    yield "orientation = [0.0, 0.0, 0.0, 1.0]"


def _joints(avatar: AvatarDraft) -> Iterator[str]:
    guesses = [m for m in avatar.matches if m.how == "guess"]
    spelled = [m for m in avatar.matches if m.how == "spelling"]
    topic = avatar.joints_topic or avatar.guessed_topic
    hidden = "" if avatar.joints_topic else "# "
    if not topic:
        yield "# No topic of the log has joints of this URDF: all stay at 0."
        if avatar.unmatched_joints:
            yield f"# The URDF has {_named(avatar.unmatched_joints)}"
        return
    if hidden:
        yield "# CHECK: no recorded joint has a name of this URDF. If the guesses below are right, uncomment them all."
    yield hidden + "[avatar.joints]"
    yield hidden + f"topic = {_quoted(topic + ('#' + avatar.side if avatar.side else ''))}"
    yield hidden + f'unit = "{avatar.unit.unit}"                   # CHECK: {plain(avatar.unit.reason)}'
    if avatar.unmatched_joints:
        yield f"# Not recorded, they stay at 0: {_named(avatar.unmatched_joints)}"
    if avatar.unmatched_recorded:
        yield f"# Recorded, but of no use here: {_named(avatar.unmatched_recorded)}"
    if not spelled and not guesses:
        return
    yield ""
    yield hidden + "[avatar.joints.rename]            # recorded name = joint of the URDF"
    for match in spelled:
        yield f"{_quoted(match.recorded)} = {_quoted(match.joint)}"
    if guesses and not hidden:
        yield "# CHECK: only alike; uncomment what is right."
    for match in guesses:
        yield f"# {_quoted(match.recorded)} = {_quoted(match.joint)}"


def _example(avatars: Sequence[AvatarDraft], lowest: float) -> Iterator[str]:
    """A thing to run into: a floor for a body, a table for hands."""
    roots = [a.root for a in avatars if a.root is not None]
    low = [min((r.low[i] for r in roots), default=0.0) for i in range(3)]
    high = [max((r.high[i] for r in roots), default=0.0) for i in range(3)]
    x, y = (round((a + b) / 2, 2) + 0.0 for a, b in zip(low[:2], high[:2], strict=True))
    if avatars and all(a.tall for a in avatars):
        name, size, z, why = "floor", [10.0, 10.0, 0.1], -0.05, "its top is at z = 0"
    else:
        size = [round(min(b - a, 10.0) + 0.8, 1) for a, b in zip(low[:2], high[:2], strict=True)] + [0.05]
        z = round(lowest - 0.025, 3) + 0.0
        name, why = "table", "its top is where the recorded links came lowest"
    yield "# CHECK: an example of an object; put your own things here. class: fixed, simulated or driven;"
    yield "# shape: box, sphere, cylinder, capsule, mesh or urdf (`geomphys schema` lists every key)."
    yield "[[object]]"
    yield f'name = "{name}"'
    yield 'class = "fixed"'
    yield f"box = {size}"
    yield f"position = {[x, y, z]}   # of its middle; {why}"
    yield 'material = "wood"'


def _tracked(others: Others) -> Iterator[str]:
    """Things whose poses the log has, as objects to uncomment."""
    if others.joints:
        yield f"# Joints of the log that nothing here follows: {_named(others.joints)}"
    if not others.poses:
        return
    yield "# Poses of the log that nothing here follows. A tracked thing is an object with a topic, such as:"
    yield "#"
    first = others.poses[0]
    for line in (
        "[[object]]",
        f"name = {_quoted(_title(first.name.rsplit('/', 1)[-1].rsplit('#', 1)[-1]))}",
        'class = "fixed"                 # where it was recorded; "driven": it yields when blocked',
        f"topic = {_quoted(first.name)}",
        "box = [0.1, 0.1, 0.1]           # or mesh, sphere, cylinder, capsule, urdf",
        'material = "wood"',
    ):
        yield f"# {line}"
    if len(others.poses) > 1:
        yield "#"
        yield f"# The others: {_named([p.name for p in others.poses[1:]])}"


def _title(name: str) -> str:
    """A name for a scene or an object from that of a file or a topic."""
    stem = plain(name.rsplit(".mcap", 1)[0]).replace("/", "_").replace("#", "_").strip()
    return stem or "scene"


def _named(names: Sequence[str]) -> str:
    more = f" and {len(names) - TOLD} more" if len(names) > TOLD else ""
    return ", ".join(plain(n) for n in names[:TOLD]) + more


def _quoted(text: str) -> str:
    """A string of TOML."""
    return json.dumps(text, ensure_ascii=False)
