"""Reports inputs of a scene that have no usable sample in the log: missing poses, topics without matching joints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import compress

from geomphys.recording.display_names import did_you_mean, join_names, printable
from geomphys.recording.input_plan import MIN_POINTS, Plan, PoseInput
from geomphys.recording.name_words import side_of
from geomphys.recording.reader import LogReader
from geomphys.recording.stream_prescan import Prescan, joint_key


def input_problems(reader: LogReader, plan: Plan, prescan: Prescan) -> Iterator[str]:
    """Say which poses never come, or never well, and which topics have no joint of the tree that follows them."""
    for keypoints in plan.keypoints:
        good = [p for p in keypoints.points if _has_good(prescan, p)]
        if len(good) < MIN_POINTS:
            yield (
                f"{reader.path}: topic {keypoints.topic!r} has {len(good)} points with a link and a good position, at least "
                f"{MIN_POINTS} are needed: all others are missing, NaN or marked as not valid"
            )
    for pose in plan.poses:
        if pose.is_point:
            continue
        facts = prescan.streams.get((pose.topic, pose.child))
        names = sorted(prescan.names.get(pose.topic, ()), key=lambda n: (len(n) if n.isdigit() else 0, n))
        if facts is None:
            what = "no readable pose"
            if not names and pose.topic in prescan.unreadable:
                what += f": a message {prescan.unreadable[pose.topic]}"
            elif pose.child:
                reported = {"poses": "with the index", "named_poses": "named"}.get(str(pose.content), "of the frame")
                what = f"no pose {reported} {pose.child!r}{did_you_mean(pose.child, names)}; it has {join_names(names)}"
            yield f"{reader.path}: topic {pose.topic!r} has {what}"
        elif pose.is_only_child and len(names) > 1:
            yield (
                f"{reader.path}: topic {pose.topic!r} has poses of several frames, {join_names(names)}: name the one to follow "
                f"as {pose.topic}#{printable(names[0])}"
            )
        elif facts.value is None:
            name = f"{pose.topic}#{pose.child}" if pose.child else pose.topic
            yield f"{reader.path}: topic {name!r} has no good pose: all are NaN or have no unit quaternion"
    for joints in plan.joints:
        awaited = joints.recorded_names()
        if not awaited or any((joints.topic, joint_key(n, joints.side)) in prescan.streams for n in awaited):
            continue
        sides = prescan.sides.get(joints.topic, set())
        if joints.side and joints.side not in sides:
            recorded_sides = join_names(sorted(sides))
            yield f"{reader.path}: topic {joints.topic!r} has no glove of the side {joints.side!r}; it has {recorded_sides}"
            continue
        names = sorted(prescan.names.get(joints.topic, ()))
        if not names and joints.topic in prescan.unreadable:
            yield f"{reader.path}: topic {joints.topic!r} has no readable joints: a message {prescan.unreadable[joints.topic]}"
            continue
        yield (
            f"{reader.path}: topic {joints.topic!r} has none of the joints {join_names(sorted(awaited))}; it has "
            f"{join_names(names)}; {_remedy(names, awaited)}"
        )


def _has_good(prescan: Prescan, point: PoseInput) -> bool:
    facts = prescan.streams.get((point.topic, point.child))
    return facts is not None and facts.value is not None


def without_lost_points(plan: Plan, prescan: Prescan) -> None:
    """Take points that never have a good position out of the plan; they are listed as left out."""
    for k, keypoints in enumerate(plan.keypoints):
        good = [_has_good(prescan, point) for point in keypoints.points]
        plan.keypoints[k] = replace(
            keypoints,
            points=tuple(compress(keypoints.points, good)),
            links=tuple(compress(keypoints.links, good)),
            weights=tuple(compress(keypoints.weights, good)),
            left_out=(
                *keypoints.left_out,
                *(f"{p.child} (never seen)" for p, is_good in zip(keypoints.points, good, strict=True) if not is_good),
            ),
        )
    plan.poses = [p for p in plan.poses if not p.is_point or _has_good(prescan, p)]


def _remedy(recorded: Iterable[str], awaited: Iterable[str]) -> str:
    """The remedy where no recorded joint is one of the scene: swapped hands, or names to be mapped."""
    recorded_sides, scene_sides = ({side_of(name) for name in names} - {""} for names in (recorded, awaited))
    if len(recorded_sides) == len(scene_sides) == 1 and recorded_sides != scene_sides:
        sides = f"the recorded ones are of the {recorded_sides.pop()} side, those of the scene of the {scene_sides.pop()} one"
        return f"{sides}: choose the topic or the URDF of the same side"
    return "map them by `rename`"
