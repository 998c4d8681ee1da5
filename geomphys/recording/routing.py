"""Builds the routing table of a pass over a log: channel -> root poses, joints, transforms and frame clock."""

from __future__ import annotations

from typing import NamedTuple

from geomphys.recording.input_plan import is_static
from geomphys.recording.prepared_log import PreparedLog
from geomphys.recording.routes import ChannelRoutes, JointRoute, RootRoute
from geomphys.recording.transform_chain import TransformBuffer
from geomphys.recording.transform_tree import is_transform_channel, normalized_frame_id


class RoutingTable(NamedTuple):
    """Routes by channel key, and the streams and transforms they feed."""

    routes: dict[int, ChannelRoutes]
    poses: list[RootRoute]  # of roots and of points
    joints: list[JointRoute]
    tracks: TransformBuffer


def build_routing_table(source: PreparedLog, gap: int) -> RoutingTable:
    """Make the streams of a pass over a log and the routes to them; `gap` [ns] is the longest gap to interpolate."""
    plan, prescan, clock = source.plan, source.prescan, source.plan.clock
    by_topic = source.config.rate is None and clock is not None

    def is_frame_clock(topic: str, part: str) -> bool:
        return by_topic and clock is not None and (topic, part) == (clock.topic, clock.child)

    tracks = TransformBuffer(source.transforms, source.space, gap)
    routing = RoutingTable({}, [], [], tracks)
    routes = routing.routes
    for pose in plan.poses:
        holds_bad_samples = not pose.is_point and is_frame_clock(pose.topic, pose.child)
        root = RootRoute(pose, prescan, tracks, gap, holds_bad_samples=holds_bad_samples)
        root.stream.first = source.first_space_poses.get((pose.topic, pose.child), root.stream.first)
        routing.poses.append(root)
        child = prescan.implied_children.get(pose.topic, "") if pose.is_only_child else pose.child
        for channel in pose.channels:
            routes.setdefault(channel.key, ChannelRoutes()).roots.setdefault(child, []).append(root)
    for joint_input in plan.joints:
        joints = JointRoute(
            joint_input,
            prescan,
            gap,
            source.prismatic,
            holds_bad_samples=is_frame_clock(joint_input.topic, joint_input.side),
        )
        routing.joints.append(joints)
        for channel in joint_input.channels:
            routes.setdefault(channel.key, ChannelRoutes()).joints.append(joints)
    for channel in clock.channels if clock is not None else ():
        route = routes.setdefault(channel.key, ChannelRoutes())
        route.clock = True
        route.clock_child = (clock.child or prescan.implied_children.get(clock.topic, "")) if clock is not None else ""
        route.clock_points = clock.points if clock is not None else frozenset()
        route.clock_delay = round(clock.delay * 1e9) if clock is not None else 0
    _route_transforms(source, routing)
    return routing


def _route_transforms(source: PreparedLog, routing: RoutingTable) -> None:
    """Route messages to the transform buffer, and set the expected parent of each child frame."""
    for edge, track in routing.tracks.tracks.items():
        for key in source.transforms.tree.link(edge).keys:
            route = routing.routes.setdefault(key, ChannelRoutes())
            route.tracks[edge.child], route.expected_parents[edge.child] = track, edge.parent
            route.static = is_static(source.reader.channels[key].topic)
    for pose in source.plan.poses:
        transforms = [normalized_frame_id(f) for f in source.prescan.frame_ids.get((pose.topic, pose.child), ())]
        parent = next((f for f in transforms if f), None)
        child = source.prescan.implied_children.get(pose.topic, "") if pose.is_only_child else pose.child
        for channel in pose.channels if parent is not None and child else ():
            if is_transform_channel(channel):
                routing.routes[channel.key].expected_parents.setdefault(normalized_frame_id(child), parent or "")
