"""Which messages feed what: the routes of all channels, with the streams and frames behind them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from geomphys.recording.input_plan import is_static
from geomphys.recording.routes import JointRoute, RootRoute, Route
from geomphys.recording.transform_chain import FrameTracks
from geomphys.recording.transform_tree import is_of_tree, plain_frame

if TYPE_CHECKING:
    from geomphys.recording.frames import FrameSource


class Wiring(NamedTuple):
    """Routes by channel, and what they feed."""

    routes: dict[int, Route]
    roots: list[RootRoute]
    joints: list[JointRoute]
    tracks: FrameTracks


def wire(source: FrameSource, gap: int) -> Wiring:
    """Make the streams of a pass over a log and the routes to them; `gap` is the longest to interpolate over, ns."""
    plan, known, clock = source.plan, source.known, source.plan.clock
    by_topic = source.config.rate is None and clock is not None

    def keeps(topic: str, part: str) -> bool:
        return by_topic and clock is not None and (topic, part) == (clock.topic, clock.child)

    tracks = FrameTracks(source.frames, source.space, gap)
    wiring = Wiring({}, [], [], tracks)
    routes = wiring.routes
    for pose in plan.poses:
        root = RootRoute(pose, known, tracks, gap, keeps_clock=keeps(pose.topic, pose.child))
        root.stream.first = source.firsts.get((pose.topic, pose.child), root.stream.first)
        wiring.roots.append(root)
        child = known.only.get(pose.topic, "") if pose.is_only_child else pose.child
        for channel in pose.channels:
            routes.setdefault(channel.key, Route()).roots.setdefault(child, []).append(root)
    for joint_input in plan.joints:
        joints = JointRoute(
            joint_input, known, gap, source.prismatic, keeps_clock=keeps(joint_input.topic, joint_input.side)
        )
        wiring.joints.append(joints)
        for channel in joint_input.channels:
            routes.setdefault(channel.key, Route()).joints.append(joints)
    for channel in clock.channels if clock is not None else ():
        route = routes.setdefault(channel.key, Route())
        route.clock = True
        route.clock_child = (clock.child or known.only.get(clock.topic, "")) if clock is not None else ""
        route.clock_delay = round(clock.delay * 1e9) if clock is not None else 0
    _wire_frames(source, wiring)
    return wiring


def _wire_frames(source: FrameSource, wiring: Wiring) -> None:
    """Routes to the transforms of frames, and what parent a frame has that is watched."""
    for edge, track in wiring.tracks.tracks.items():
        for key in source.frames.tree.link(edge).keys:
            route = wiring.routes.setdefault(key, Route())
            route.tracks[edge.child], route.parents[edge.child] = track, edge.parent
            route.static = is_static(source.reader.channels[key].topic)
    for pose in source.plan.poses:
        frames = [plain_frame(f) for f in source.known.frames.get((pose.topic, pose.child), ())]
        parent = next((f for f in frames if f), None)
        child = source.known.only.get(pose.topic, "") if pose.is_only_child else pose.child
        for channel in pose.channels if parent is not None and child else ():
            if is_of_tree(channel):
                wiring.routes[channel.key].parents.setdefault(plain_frame(child), parent or "")
