"""Drafts a scene file for a log and URDFs: matches joints, guesses units and topics, marks what the user must check."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geomphys.authoring.avatar_draft import (
    AvatarDraft,
    find_joints,
    find_root,
    guess_angles,
    hand_sides,
    is_of_either_hand,
)
from geomphys.authoring.keypoint_draft import find_keypoints
from geomphys.authoring.lowest_link import lowest_link
from geomphys.authoring.scene_toml import UnusedStreams, scene_text
from geomphys.errors import LogError, MeshError
from geomphys.output.provenance import files_of_log
from geomphys.recording.display_names import join_names
from geomphys.recording.input_plan import is_static
from geomphys.recording.inspect import LogInfo, TopicInfo, inspect_log, log_space
from geomphys.recording.message_kinds import type_names
from geomphys.recording.name_words import side_of
from geomphys.recording.recorded_space import RecordedSpace
from geomphys.recording.root_candidates import PoseCandidate, is_command_topic
from geomphys.recording.samples import JOINTS, POSES
from geomphys.recording.space_guess import SpaceGuess
from geomphys.scene.chains import suggested_chains
from geomphys.scene.meshes import load_mesh, require_closed
from geomphys.scene.scene_file import parse_scene
from geomphys.scene.skeleton import Skeleton, load_skeleton, require_solid
from geomphys.scene.source_files import tracked_sources
from geomphys.scene.urdf_file import MeshShape
from geomphys.storage.output_file import write_file
from geomphys.storage.remote_files import AnyPath, as_path

BODY_REACH = 0.8
"""m; an avatar with a larger reach in its zero pose is a body (mode "chains"), a smaller one a hand."""


@dataclass(frozen=True)
class SceneDraft:
    """A drafted scene file, and the findings it is based on."""

    text: str  # TOML, valid
    log: LogInfo
    avatars: tuple[AvatarDraft, ...]
    others: UnusedStreams  # poses and joints of the log that no avatar follows
    space: SpaceGuess
    source_files: tuple[AnyPath, ...] = ()  # what was read for it

    @property
    def is_replayable(self) -> bool:
        """Whether the scene can be replayed as it is: an avatar follows a topic."""
        return any(a.root is not None or a.joints_topic or a.keypoints is not None for a in self.avatars)

    def as_dict(self) -> dict[str, Any]:
        """All of it as plain values, as in `DraftRecord`."""
        record = DraftRecord(self.text, self.log, self.avatars, self.others, self.space, self.is_replayable)
        return dataclasses.asdict(record)

    def write(self, path: Path | str, *, force: bool = False) -> None:
        """Write the scene file; OutputError if it is there (without `force`), was read, or cannot be written."""
        write_file(Path(path), self.text.encode(), force=force, inputs=self.source_files)


@dataclass(frozen=True)
class DraftRecord:
    """A `SceneDraft` as it is in JSON."""

    text: str  # TOML, valid
    log: LogInfo
    avatars: tuple[AvatarDraft, ...]
    others: UnusedStreams
    space: SpaceGuess
    replayable: bool


def draft_scene(
    log: AnyPath | str, urdfs: Sequence[Path | str], *, folder: Path | str = ".", recover: bool = False
) -> SceneDraft:
    """Draft a scene file for a log and the avatars it is of.

    Joints are matched by name, units, the recorded space and the topic of the root are guessed; the text says which is
    which. What has no match is left out, in comments; unless that is all (`SceneDraft.is_replayable`), it can be replayed
    as it is.

    Parameters
    ----------
    log
        An MCAP file or a ROS 2 bag directory.
    urdfs
        One URDF an avatar.
    folder
        Folder of the scene file, to which its paths are relative.
    recover
        Go by what is readable of a damaged log.

    Raises
    ------
    LogError, DamagedLogError
        The log cannot be read, or holds neither poses nor joints.
    ModelError, MeshError
        A URDF or one of its meshes is wrong.
    """
    log = as_path(log)
    with tracked_sources() as sources:
        draft = _draft(log, urdfs, folder, recover)
    return dataclasses.replace(draft, source_files=(*files_of_log(log), *sources.contents))


def _draft(log: AnyPath, urdfs: Sequence[Path | str], folder: Path | str, recover: bool) -> SceneDraft:
    info = inspect_log(log, recover=recover)
    poses, joints = pose_candidates(info), [t for t in info.topics if t.kind in JOINTS and _is_valid_name(t.topic)]
    if not poses and not joints:
        found = join_names([f"{t.topic} ({t.schema or 'no schema'}, {t.encoding})" for t in info.topics], 6)
        raise LogError(
            f"{log}: holds no pose and no joint values that are understood, so nothing can follow it: {found}; types that "
            f"are: {', '.join(type_names(JOINTS + POSES))}"
        )
    unreadable = next((t for t in info.topics if t.bad_reason or t.problem), None)
    if unreadable is not None and not poses and not any(t.joints for t in joints):
        reason = unreadable.problem or f"{log}: topic {unreadable.topic}: a message {unreadable.bad_reason}"
        raise LogError(f"{reason}; nothing else in the log has poses or joint values")
    skeletons = [load_skeleton(Path(urdf)) for urdf in urdfs]
    for skeleton in skeletons:
        require_solid(skeleton)
    sides = hand_sides(skeletons, [*(p.name for p in poses), *(t.topic for t in joints)])
    avatars: list[AvatarDraft] = []
    for skeleton, hand in zip(skeletons, sides, strict=True):
        taken = {a.root.name for a in avatars if a.root is not None}
        free = [p for p in poses if p.name not in taken]
        points = [t for t in info.topics if _is_valid_name(t.topic)]
        avatars.append(_avatar(skeleton, Path(folder), hand, free, joints, points, avatars))
    fitted = {a.keypoints.topic for a in avatars if a.keypoints is not None}
    roots = {a.root.name for a in avatars if a.root is not None}
    others = UnusedStreams(
        poses=tuple(p for p in poses if p.name not in roots and p.name.split("#")[0] not in fitted),
        joints=tuple(t.topic for t in joints if t.topic not in {a.joints_topic for a in avatars} | fitted),
    )
    space = log_space(info, roots | {f"{t.topic}#{c}" for t in info.topics if t.topic in fitted for c in t.motions})
    heights = [
        lowest_link(
            log,
            skeleton,
            avatar.root.name,
            f"{avatar.joints_topic}#{avatar.side}" if avatar.side else avatar.joints_topic,
            {m.recorded: m.joint for m in avatar.used},
            avatar.unit.unit == "deg",
            RecordedSpace.from_table(space.table),
            recover=recover,
        )
        for skeleton, avatar in zip(skeletons, avatars, strict=True)
        if avatar.root is not None and not avatar.tall and not (avatar.keypoints is not None and avatar.keypoints.boxes)
    ]
    recorded = RecordedSpace.from_table(space.table)
    heights += [a.keypoints.lowest_height(recorded) for a in avatars if a.keypoints is not None and a.keypoints.boxes]
    text = scene_text(info, avatars, others, space, min((h for h in heights if h is not None), default=0.0))
    parse_scene(text, Path(folder) / "scene.toml")
    return SceneDraft(text, info, tuple(avatars), others, space)


def _avatar(
    skeleton: Skeleton,
    folder: Path,
    hand: str,
    poses: Sequence[PoseCandidate],
    topics: Sequence[TopicInfo],
    points: Sequence[TopicInfo],
    earlier: Sequence[AvatarDraft],
) -> AvatarDraft:
    """Draft an avatar: joints are among `topics`, points among `points`; `earlier` are the avatars drafted before."""
    joints = find_joints(skeleton, topics, hand, {(a.joints_topic, a.side) for a in earlier})
    matches = joints.matches if joints is not None else ()
    used = [m for m in matches if m.is_used]
    topic = joints.topic if joints is not None else _topic_with_most_messages(topics)
    recorded = [n for n in topic.joints if _is_valid_name(n)] if topic is not None else []
    if hand:
        recorded = [n for n in recorded if side_of(n) in ("", hand)]
    keypoints = None
    if not used:
        taken = {a.keypoints.topic for a in earlier if a.keypoints is not None}
        keypoints = find_keypoints(skeleton, points, hand, taken)
    if keypoints is not None:
        poses = [p for p in poses if p.name.split("#")[0] != keypoints.topic]
    root, choices = find_root(skeleton, poses, hand, joints)
    angles = guess_angles(skeleton, topic, used or matches)
    mimics = {j.name for j in skeleton.joints if j is not None and j.mimics is not None}
    found = {m.recorded for m in matches} | mimics
    path, stem = os.path.relpath(str(skeleton.path), folder), skeleton.path.stem
    return AvatarDraft(
        name=_unique_name(stem, {a.name for a in earlier}),
        urdf=Path(path).as_posix(),
        root_link=skeleton.links[0].name,
        tall=_reach(skeleton) > BODY_REACH,
        hull=_needs_hull(skeleton),
        hand=hand,
        root=root,
        root_choices=choices,
        joints_topic=joints.topic.topic if joints is not None and used else "",
        joint_choices=joints.others if joints is not None and used else (),
        side=joints.side if joints is not None else "",
        unit=angles.unit,
        mirrored=angles.mirrored,
        matches=matches,
        unmatched_recorded=tuple(n for n in recorded if n not in found),
        unmatched_joints=tuple(n for n in skeleton.dof_names if n not in {m.joint for m in matches}),
        guessed_topic=topic.topic if topic is not None and not used else "",
        two_sides=joints is not None and is_of_either_hand(hand, joints.topic.joints, skeleton.dof_names),
        chains=tuple(_chains(skeleton)),
        keypoints=keypoints,
    )


def _topic_with_most_messages(topics: Sequence[TopicInfo]) -> TopicInfo | None:
    """The joint topic with most messages, for names to be filled in by hand."""
    candidates = [t for t in topics if t.messages and t.joints and not is_command_topic(t.topic)]
    return max(candidates, key=lambda t: t.messages, default=None)


def pose_candidates(info: LogInfo) -> list[PoseCandidate]:
    """All poses of a log that a root or object could follow."""
    found = []
    for topic in info.topics:
        if topic.kind not in POSES or not _is_valid_name(topic.topic) or is_static(topic.topic):
            continue
        for child, (low, high) in topic.boxes.items():
            if topic.kind == "pose" or (topic.kind == "transform" and len(topic.frames) < 2):
                found.append(PoseCandidate(topic.topic, topic.messages, low, high))
                break
            if _is_valid_name(child):
                found.append(PoseCandidate(f"{topic.topic}#{child}", topic.messages, low, high))
    return found


def _is_valid_name(name: str) -> bool:
    """Whether a scene file can hold a name."""
    return 0 < len(name) <= 512 and name == name.strip() and name.isprintable()


def _unique_name(stem: str, taken: set[str]) -> str:
    """A unique name for an avatar."""
    printable = "".join(c if c.isprintable() and c not in "/#" else "_" for c in stem).strip()
    name = printable if printable and printable not in ("world", "recorded", "table", "floor") else "avatar"
    number = 2
    while name in taken:
        name, number = f"{printable}_{number}", number + 1
    return name


def _reach(skeleton: Skeleton) -> float:
    """Longest distance between link origins along an axis in the zero pose, m."""
    origins = skeleton.forward()[:, :3, 3]
    span = float((origins.max(axis=0) - origins.min(axis=0)).max())
    return span if math.isfinite(span) else 0.0


def _needs_hull(skeleton: Skeleton) -> bool:
    """Whether a mesh is not closed, so that it can only collide as its convex hull. MeshError for one that cannot be read."""
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
