"""A first scene file for a log: what it has is looked up, what only its owner knows is marked to be filled in."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geomphys.draft_height import lowest_link
from geomphys.draft_text import AvatarDraft, Others, scene_text
from geomphys.errors import LogError, MeshError, OutputError
from geomphys.recording.inspect import LogInfo, TopicInfo, inspect_log
from geomphys.recording.kinds import short_names
from geomphys.recording.matching import (
    JointMatch,
    PoseCandidate,
    UnitGuess,
    guess_unit,
    is_request,
    match_joints,
    rank_roots,
    side_of,
)
from geomphys.recording.naming import listed
from geomphys.recording.plan import is_static
from geomphys.recording.samples import JOINTS, POSES
from geomphys.remote import place
from geomphys.world.chains import suggested_chains
from geomphys.world.meshes import load_mesh, require_closed
from geomphys.world.scene_file import parse_scene
from geomphys.world.skeleton import Skeleton, load_skeleton, require_solid
from geomphys.world.urdf_file import MeshShape

TALL = 0.8
"""m; an avatar whose links reach further in its zero pose is a body, which yields limb by limb; a smaller one a hand."""
UNLIKELY = -3.0
"""A pose that scores less is not taken for a root: it says itself that it is something else."""


@dataclass(frozen=True)
class SceneDraft:
    """A scene file for a log, and what was found out for it."""

    text: str  # TOML, valid
    log: LogInfo
    avatars: tuple[AvatarDraft, ...]
    others: Others  # poses and joints of the log that no avatar follows

    def as_dict(self) -> dict[str, Any]:
        """All of it as plain values."""
        return dataclasses.asdict(self)

    def write(self, path: Path | str, *, force: bool = False) -> None:
        """Write the scene file; OutputError if it is there (without `force`) or cannot be written."""
        path = Path(path)
        if path.exists() and not force:
            raise OutputError(f"{path}: exists; choose another name or replace it with force")
        try:
            path.write_text(self.text, encoding="utf-8")
        except OSError as problem:
            raise OutputError(f"{path}: cannot be written: {problem.strerror}") from problem


def draft_scene(
    log: Path | str, urdfs: Sequence[Path | str], *, folder: Path | str = ".", recover: bool = False
) -> SceneDraft:
    """Draft a scene file for a log and the avatars it is of.

    Joints are matched by name, units and the topic of the root are guessed; the text says which is which. It can be
    replayed as it is: what has no match is left out, in comments.

    Parameters
    ----------
    log
        An MCAP file or a ROS 2 bag directory.
    urdfs
        One URDF an avatar.
    folder
        Where the scene file will stand: its paths are relative to that.
    recover
        Go by what is readable of a damaged log.

    Raises
    ------
    LogError, DamagedLogError
        The log cannot be read, or holds neither poses nor joints.
    ModelError, MeshError
        A URDF or one of its meshes is wrong.
    """
    info = inspect_log(place(log), recover=recover)
    poses, joints = pose_candidates(info), [t for t in info.topics if t.kind in JOINTS and _sayable(t.topic)]
    if not poses and not joints:
        found = listed([f"{t.topic} ({t.schema or 'no schema'}, {t.encoding})" for t in info.topics], 6)
        raise LogError(
            f"{log}: holds no pose and no joint values that are understood, so nothing can follow it: {found}; types that "
            f"are: {', '.join(short_names(JOINTS + POSES))}"
        )
    unreadable = next((t for t in info.topics if t.bad_reason or t.problem), None)
    if unreadable is not None and not poses and not any(t.joints for t in joints):
        why = unreadable.problem or f"{log}: topic {unreadable.topic}: a message {unreadable.bad_reason}"
        raise LogError(f"{why}; nothing else in the log has poses or joint values")
    avatars: list[AvatarDraft] = []
    for urdf in urdfs:
        taken = {a.root.name for a in avatars if a.root is not None}
        free = [p for p in poses if p.name not in taken]
        avatars.append(_avatar(Path(urdf), Path(folder), free, joints, {a.name for a in avatars}))
    others = Others(
        poses=tuple(p for p in poses if p.name not in {a.root.name for a in avatars if a.root is not None}),
        joints=tuple(t.topic for t in joints if t.topic not in {a.joints_topic for a in avatars}),
    )
    heights = [
        lowest_link(
            place(log),
            load_skeleton(Path(urdf)),
            avatar.root.name,
            f"{avatar.joints_topic}#{avatar.side}" if avatar.side else avatar.joints_topic,
            {m.recorded: m.joint for m in avatar.matches if m.how != "guess"},
            avatar.unit.unit == "deg",
            recover=recover,
        )
        for urdf, avatar in zip(urdfs, avatars, strict=True)
        if avatar.root is not None and not avatar.tall
    ]
    text = scene_text(info, avatars, others, min((h for h in heights if h is not None), default=0.0))
    parse_scene(text, Path(folder) / "scene.toml")
    return SceneDraft(text, info, tuple(avatars), others)


def _avatar(
    urdf: Path, folder: Path, poses: Sequence[PoseCandidate], topics: Sequence[TopicInfo], names: set[str]
) -> AvatarDraft:
    """What an avatar follows."""
    skeleton = load_skeleton(urdf)
    require_solid(skeleton)
    topic, side, matches = _joints(skeleton, topics)
    sure = [m for m in matches if m.how != "guess"]
    ranked = rank_roots(
        poses,
        skeleton.links[0].name,
        [urdf.stem],
        topic.topic if topic is not None and sure else "",
        topic.messages if topic is not None else 0,
    )
    root = ranked[0][1] if ranked and ranked[0][0] > UNLIKELY else None
    mimics = {j.name for j in skeleton.joints if j is not None and j.mimics is not None}
    recorded = () if topic is None else topic.joints
    found = {m.recorded for m in matches} | mimics
    return AvatarDraft(
        name=_name(urdf.stem, names),
        urdf=Path(os.path.relpath(urdf, folder)).as_posix(),
        root_link=skeleton.links[0].name,
        tall=_height(skeleton) > TALL,
        hull=_needs_hull(skeleton),
        root=root,
        root_choices=tuple(c.name for _, c in ranked if c is not root),
        joints_topic="" if topic is None or not sure else topic.topic,
        side=side,
        unit=_unit(skeleton, topic, sure),
        matches=matches,
        unmatched_recorded=tuple(n for n in recorded if n not in found) if sure else (),
        unmatched_joints=tuple(n for n in skeleton.dof_names if n not in {m.joint for m in matches}),
        guessed_topic=topic.topic if topic is not None and matches and not sure else "",
        chains=tuple(_chains(skeleton)),
    )


def _joints(skeleton: Skeleton, topics: Sequence[TopicInfo]) -> tuple[TopicInfo | None, str, tuple[JointMatch, ...]]:
    """The topic that has most of a tree's joints, the side of the glove it must name, and what matches."""
    best: tuple[tuple[float, ...], TopicInfo, str, tuple[JointMatch, ...]] | None = None
    own = {s for s in (side_of(n) for n in (skeleton.path.stem, skeleton.links[0].name)) if s}
    for topic in topics:
        if topic.messages == 0:
            continue
        matches = match_joints((n for n in topic.joints if _sayable(n)), skeleton.dof_names)
        sure = sum(m.how != "guess" for m in matches)
        sides = {side_of(topic.topic), *topic.sides} - {""}
        wrong = bool(own and sides and not own & sides)
        rank = (-wrong, sure, len(matches), not is_request(topic.topic), topic.messages)
        side = next(iter(own & set(topic.sides)), min(topic.sides, default="")) if len(topic.sides) > 1 else ""
        if matches and (best is None or rank > best[0]):
            best = rank, topic, side, matches
    return (None, "", ()) if best is None else best[1:]


def _unit(skeleton: Skeleton, topic: TopicInfo | None, sure: Sequence[JointMatch]) -> UnitGuess:
    """The unit of a topic's angles."""
    if topic is not None and topic.kind == "glove":
        return UnitGuess("deg", "gloves of this type send degrees")
    if topic is None:
        return UnitGuess("rad", "")
    turning = {j.name for j in skeleton.joints if j is not None and j.type in ("revolute", "continuous")}
    place = {name: i for i, name in enumerate(skeleton.dof_names)}
    used = {m.recorded: place[m.joint] for m in sure if m.joint in turning and m.recorded in topic.ranges}
    limits = {n: (float(skeleton.lower[c]), float(skeleton.upper[c])) for n, c in used.items()}
    return guess_unit({n: topic.ranges[n] for n in used}, limits)


def pose_candidates(info: LogInfo) -> list[PoseCandidate]:
    """Everything in a log that has a pose."""
    found = []
    for topic in info.topics:
        if topic.kind not in POSES or not _sayable(topic.topic) or is_static(topic.topic):
            continue
        for child, (low, high) in topic.boxes.items():
            if topic.kind == "pose" or (topic.kind == "transform" and len(topic.frames) < 2):
                found.append(PoseCandidate(topic.topic, topic.messages, low, high))
                break
            if _sayable(child):
                found.append(PoseCandidate(f"{topic.topic}#{child}", topic.messages, low, high))
    return found


def _sayable(name: str) -> bool:
    """Whether a scene file can hold a name."""
    return 0 < len(name) <= 512 and name == name.strip() and name.isprintable()


def _name(stem: str, taken: set[str]) -> str:
    """A name for an avatar that is not taken."""
    plain = "".join(c if c.isprintable() and c not in "/#" else "_" for c in stem).strip()
    name = plain if plain and plain not in ("world", "recorded", "table", "floor") else "avatar"
    number = 2
    while name in taken:
        name, number = f"{plain}_{number}", number + 1
    return name


def _height(skeleton: Skeleton) -> float:
    """Longest distance between link origins along an axis in the zero pose, m."""
    origins = skeleton.forward()[:, :3, 3]
    span = float((origins.max(axis=0) - origins.min(axis=0)).max())
    return span if math.isfinite(span) else 0.0


def _needs_hull(skeleton: Skeleton) -> bool:
    """Whether a mesh has holes: it can then only collide as its hull. MeshError for one that cannot be read."""
    shapes = {g.shape for link in skeleton.links for g in link.collisions if isinstance(g.shape, MeshShape)}
    for shape in sorted(shapes, key=lambda s: (str(s.path), str(s.scale))):
        mesh = load_mesh(shape.path, name=f"{skeleton.path}: mesh {shape.path.name}")
        try:
            require_closed(mesh)
        except MeshError:
            return True
    return False


def _chains(skeleton: Skeleton) -> list[tuple[str, str, str]]:
    """Name, base and tip of the chains that the tree suggests."""
    found = []
    for links in suggested_chains(skeleton):
        joint = skeleton.joints[links[0]]
        assert joint is not None
        tip = skeleton.links[links[-1]].name
        found.append((tip, skeleton.links[joint.parent].name, tip))
    return found
