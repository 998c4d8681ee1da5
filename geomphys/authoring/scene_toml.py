"""The text of a drafted scene file: valid TOML with comments on what to check."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from geomphys.authoring.avatar_draft import AvatarDraft
from geomphys.authoring.joints_toml import MAX_NAMES, joint_lines, quoted, short_list
from geomphys.authoring.keypoint_draft import KeypointDraft
from geomphys.recording.display_names import printable
from geomphys.recording.inspect import LogInfo, TopicInfo
from geomphys.recording.recorded_space import RecordedSpace
from geomphys.recording.root_candidates import PoseCandidate
from geomphys.recording.space_guess import SpaceGuess


@dataclass(frozen=True)
class UnusedStreams:
    """Poses and joint topics of a log that no avatar follows."""

    poses: tuple[PoseCandidate, ...]
    joints: tuple[str, ...]


def scene_text(
    log: LogInfo, avatars: Sequence[AvatarDraft], unused: UnusedStreams, space: SpaceGuess, lowest: float
) -> str:
    """TOML of a scene in which these avatars follow a log; `lowest` is the lowest height [m] of links of hands."""
    lines = [*_head(log, avatars), *_recording(space)]
    for avatar in avatars:
        lines += ["", *_avatar(avatar)]
    lines += ["", *_example(avatars, space, lowest), "", *_unused_lines(unused)]
    return "\n".join(lines).rstrip("\n") + "\n"


def _head(log: LogInfo, avatars: Sequence[AvatarDraft]) -> Iterator[str]:
    name = log.path.replace("\\", "/").rstrip("/").rsplit("/", 1)[-1]
    yield f"# A scene for {printable(name)}, drafted by `geomphys init`. Lines with CHECK need your eye:"
    yield "# what they say was guessed, or only you can know it."
    yield "# Lengths in metres, angles in radians, world z up, quaternions x y z w; paths are relative to this file."
    yield "#"
    yield "# The log has"
    followers = _followers(avatars)
    widest = max((len(printable(t.topic)) for t in log.topics), default=0)
    for topic in log.topics:
        what = f"{printable(topic.schema) or 'no schema'}, {_content(topic)}"
        yield f"#   {printable(topic.topic):<{widest}}  {what}{followers.get(topic.topic, '')}"
    yield ""
    yield "[scene]"
    yield f"name = {quoted(_title(name))}"
    yield "gravity = [0.0, 0.0, -9.81]"


def _recording(space: SpaceGuess) -> Iterator[str]:
    """The `[recording]` table, where the recorded space is not the world; uncertain guesses are comments."""
    if not space.up_reason and not space.unit_reason:
        return
    yield ""
    is_certain = bool((space.up_reason and space.is_up_certain) or (space.unit_reason and space.is_unit_certain))
    yield f"{'' if is_certain else '# '}[recording]                     # the space of the log"
    for key, value, reason, is_row_certain in (
        ("up", space.up, space.up_reason, space.is_up_certain),
        ("unit", space.unit, space.unit_reason, space.is_unit_certain),
    ):
        if reason:
            comment_prefix = "" if is_row_certain else "# "
            question = "" if is_row_certain else "; uncomment it if that is so"
            yield f'{comment_prefix}{key} = "{value}"{" " * (12 - len(key) - len(value))}# CHECK: {reason}{question}'


def _followers(avatars: Sequence[AvatarDraft]) -> dict[str, str]:
    """Topic -> text on what in the scene follows it."""
    followers: dict[str, list[str]] = {}
    for avatar in avatars:
        if avatar.root is not None:
            followers.setdefault(avatar.root.name.split("#")[0], []).append(f"root of {avatar.name}")
        if avatar.keypoints is not None:
            followers.setdefault(avatar.keypoints.topic, []).append(f"points of {avatar.name}")
        if avatar.joints_topic:
            followers.setdefault(avatar.joints_topic, []).append(f"joints of {avatar.name}")
    return {topic: " -> " + ", ".join(names) for topic, names in followers.items()}


def _content(topic: TopicInfo) -> str:
    """A short description of a topic's content."""
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
    yield f"name = {quoted(avatar.name)}"
    yield f"urdf = {quoted(avatar.urdf)}"
    limbs = "arms, legs, neck" if avatar.tall else "fingers"
    yield f'mode = "auto"                  # {limbs} yield joint by joint; "rigid" keeps the recorded shape'
    yield 'material = "human"'
    if avatar.hull:
        yield 'decomposition = "hull"         # CHECK: a mesh of it has holes, so each collides as its convex hull'
    yield ""
    if avatar.keypoints is None or avatar.root is not None:
        yield from _root(avatar)
        yield ""
    yield from (joint_lines(avatar) if avatar.keypoints is None else _keypoints(avatar.keypoints, avatar.root is None))
    for name, base, tip in avatar.chains:
        yield ""
        yield "[[avatar.chain]]"
        yield f"name = {quoted(name.replace('/', '_').replace('#', '_'))}"
        yield f"base = {quoted(base)}"
        yield f"tip = {quoted(tip)}"


def _root(avatar: AvatarDraft) -> Iterator[str]:
    yield "[avatar.root]"
    if avatar.root is None:
        yield "# CHECK: no pose of the log looks like that of the root link; it stands still here."
        for name in avatar.root_choices[:MAX_NAMES]:
            yield f"# topic = {quoted(name)}"
    else:
        unused = f"; else: {short_list(avatar.root_choices)}" if avatar.root_choices else ""
        yield f"# CHECK: is it the pose of {printable(avatar.root_link)!r}{unused}"
        yield f"topic = {quoted(avatar.root.name)}"
    yield f"# CHECK: where {printable(avatar.root_link)!r} is, seen from the tracker: measure it, or let"
    yield "# `geomphys calibrate` find it from a recording in which the hand touches something."
    yield "position = [0.0, 0.0, 0.0]"
    yield "orientation = [0.0, 0.0, 0.0, 1.0]"


def _keypoints(keypoints: KeypointDraft, fits_root: bool) -> Iterator[str]:
    yield "[avatar.keypoints]              # joint angles are fitted to these points"
    yield f"# CHECK: {keypoints.links} links have a point; `geomphys check` lists which"
    yield f"topic = {quoted(keypoints.topic)}"
    yield f'layout = "{keypoints.layout}"'
    yield 'scale = "fingers"              # bone lengths are those of the recording, finger by finger; or "hand", "none"'
    if fits_root:
        yield "# The pose of its root is fitted too; a tracker that gives it goes into [avatar.root]."


def _example(avatars: Sequence[AvatarDraft], space: SpaceGuess, lowest: float) -> Iterator[str]:
    """An example of an object: a floor for a body, a table for hands."""
    roots = [a.root for a in avatars if a.root is not None]
    recorded = RecordedSpace.from_table(space.table)
    boxes = [(r.low, r.high) for r in roots] + [
        b for a in avatars if a.keypoints is not None for b in a.keypoints.boxes
    ]
    corners = [recorded.world_position(p) for box in boxes for p in box] or [(0.0, 0.0, 0.0)]
    low, high = ([extremum(c[i] for c in corners) for i in range(3)] for extremum in (min, max))
    x, y = (round((a + b) / 2, 2) + 0.0 for a, b in zip(low[:2], high[:2], strict=True))
    if avatars and all(a.tall for a in avatars):
        name, size, z, reason = "floor", [10.0, 10.0, 0.1], -0.05, "its top is at z = 0"
    else:
        size = [round(min(b - a, 10.0) + 0.8, 1) for a, b in zip(low[:2], high[:2], strict=True)] + [0.05]
        z = round(lowest - 0.025, 3) + 0.0
        name, reason = "table", "a guess until `geomphys calibrate` finds it: as low as the recorded links came"
    yield "# CHECK: an example of an object; put your own things here. class: fixed, simulated or driven;"
    yield "# shape: box, sphere, cylinder, capsule, mesh or urdf (`geomphys schema` lists every key)."
    yield "[[object]]"
    yield f'name = "{name}"'
    yield 'class = "fixed"'
    yield f"box = {size}"
    yield f"position = {[x, y, z]}   # of its middle; {reason}"
    yield 'material = "wood"'


def _unused_lines(unused: UnusedStreams) -> Iterator[str]:
    """Unused poses of the log, as objects in comments."""
    if unused.joints:
        yield f"# Joints of the log that nothing here follows: {short_list(unused.joints)}"
    if not unused.poses:
        return
    yield "# Poses of the log that nothing here follows. A tracked thing is an object with a topic, such as:"
    yield "#"
    first = unused.poses[0]
    for line in (
        "[[object]]",
        f"name = {quoted(_title(first.name.rsplit('/', 1)[-1].rsplit('#', 1)[-1]))}",
        'class = "fixed"                 # where it was recorded; "driven": it yields when blocked',
        f"topic = {quoted(first.name)}",
        "box = [0.1, 0.1, 0.1]           # or mesh, sphere, cylinder, capsule, urdf",
        'material = "wood"',
    ):
        yield f"# {line}"
    if len(unused.poses) > 1:
        yield "#"
        yield f"# The others: {short_list([p.name for p in unused.poses[1:]])}"


def _title(name: str) -> str:
    """A name of a scene or object, from that of a file or topic."""
    stem = printable(name.rsplit(".mcap", 1)[0]).replace("/", "_").replace("#", "_").strip()
    return stem or "scene"
