"""One pass over a log: its messages in order, resampled to frames at the frame clock.

The log is streamed: a frame is made as soon as no later message can change it, which is when the watermark of the log is
`max_gap` + `max_delay` past the frame's time. Only samples after the last frame are kept in memory.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import LogError
from geomphys.recording.channels import JointSample, Pose
from geomphys.recording.clock import FrameClock, RateClock, TopicClock
from geomphys.recording.decoders import BadMessageError
from geomphys.recording.input_plan import is_static
from geomphys.recording.keypoint_routes import KeypointRoute
from geomphys.recording.message_batches import BatchAdder
from geomphys.recording.message_times import Watermark
from geomphys.recording.pose_tuples import PoseTuple
from geomphys.recording.prepared_log import PreparedLog
from geomphys.recording.raw_messages import RawMessage
from geomphys.recording.reading_ahead import batches
from geomphys.recording.routes import ChannelRoutes, RootRoute
from geomphys.recording.routing import build_routing_table
from geomphys.recording.stamp_monitor import StampMonitor
from geomphys.recording.stamps import NEVER
from geomphys.recording.streams import JointStream, PoseStream
from geomphys.recording.transform_tree import normalized_frame_id, two_parents_message
from geomphys.results import FLAG_BEFORE_FIRST, FLAG_CLAMPED, FLAG_HELD, FLAG_OUTSIDE_LIMITS, Frame

Floats = NDArray[np.float64]

LIMIT_SLACK = 1e-9  # rad or m; tolerance of joint limits


class LogPass:
    """One pass over the log."""

    def __init__(self, source: PreparedLog, *, fits: bool = True) -> None:
        """Without `fits`, joint values are not fitted to points."""
        self.source, self.world, self.config = source, source.world, source.config
        self.times = source.times.fresh_copy()
        delay = round(self.config.max_delay * 1e9)
        self.stamp_monitor = StampMonitor(source.reader.path, delay) if self.config.time != "log" else None
        self._readers = source.prescan.readers
        self._monitored: dict[int, str] = {}  # channel -> its topic, if stamps are monitored there
        if self.stamp_monitor is not None:
            channels = source.reader.channels
            self._monitored = {key: c.topic for key, c in channels.items() if not is_static(c.topic)}
        scene = self.world.scene
        gap = round(self.config.max_gap * 1e9)
        self.gap = gap
        self.clock: FrameClock = TopicClock() if self.config.rate is None else RateClock(self.config.rate)
        routing = build_routing_table(source, gap)
        self.routes, self.poses, self.joints, self.tracks = routing
        self.roots = [p for p in self.poses if not p.input.is_point]
        self.keypoints = [KeypointRoute(k, self.poses, self.world, fits=fits) for k in source.plan.keypoints]
        self.default_roots = np.ascontiguousarray(scene.trees.rest, dtype=np.float64)
        self.default_angles = np.zeros(len(scene.dofs.lower))
        self.prismatic = source.prismatic
        self.earliest_delay = min([0, *(pose.delay for pose in self.poses), *(joints.delay for joints in self.joints)])
        self.lookahead = gap + delay - self.earliest_delay + gap * self.tracks.moving
        self.recorded = np.zeros(len(self.default_angles), dtype=bool)
        for route in self.joints:
            self.recorded[route.columns] = True
            for column, value in route.constants.items():
                self.default_angles[column], self.recorded[column] = value, True
        self.lower = np.where(self.recorded, scene.dofs.lower, -np.inf)
        self.upper = np.where(self.recorded, scene.dofs.upper, np.inf)
        self._least, self._most = self.lower - LIMIT_SLACK, self.upper + LIMIT_SLACK
        self.min_angles, self.max_angles = (
            np.full_like(self.default_angles, np.inf),
            np.full_like(self.default_angles, -np.inf),
        )
        self.outside_frames = np.zeros(len(self.default_angles), dtype=np.int64)
        self.count = self.held_frames = self.bad_messages = self.late = self.lost_frames = 0
        self.first_time = self.last_time = NEVER
        self.last_frame_time = NEVER  # time of the last frame, also of those before `start`

    def first_poses(self) -> Iterator[tuple[tuple[str, str], PoseTuple | None]]:
        """First valid poses in the recorded space of streams in moving frames; None where there is none.

        The log is read until they are known.
        """
        waiting = [pose for pose in self.poses if pose.moving]
        if not waiting:
            return
        watermark, keys = Watermark(), set(self.routes)
        for raw in self.source.reader.read(keys, file_order=self.source.file_order):
            self._process(raw, watermark)
            waiting = list(self._awaiting_first(waiting, watermark.time - self.lookahead))
            if not waiting:
                break
        else:
            waiting = list(self._awaiting_first(waiting, 2**62))
        for pose in self.poses:
            if pose.moving:
                yield (pose.input.topic, pose.input.child), pose.stream.first

    def _awaiting_first(self, roots: list[RootRoute], time: int) -> Iterator[RootRoute]:
        """Roots whose first pose is not known yet when the log has been read up to a time [ns]."""
        for root in roots:
            root.resolve(time, time + self.gap)
            root.stream.first = next((v for v in root.stream.values if v is not None), None)
            if root.stream.first is None:
                root.stream.advance(time + self.gap)
                yield root

    def frames(self) -> Iterator[Frame]:
        """Read the log and yield its frames."""
        if self.source.plan.clock is None:
            self.clock.add(self.source.reader.start_ns)
            self.clock.add(self.source.reader.end_ns)
        watermark, keys, adder = Watermark(), set(self.routes), self._batch_adder()
        runs = self.source.reader.read_runs(keys, file_order=self.source.file_order) if keys else iter(())
        for batch in runs if adder is None else batches(runs, keys):
            if adder is not None and adder.add(batch, watermark):
                yield from self._frames_until(watermark.time - self.lookahead, many=True)
                continue
            for raw in batch:
                self._process(raw, watermark)
                yield from self._frames_until(watermark.time - self.lookahead)
                if self.config.end is not None and self.last_frame_time - self.first_time > self.config.end * 1e9:
                    return
        if self.stamp_monitor is not None:
            self.stamp_monitor.finish()
        yield from self._frames_until(2**63, many=adder is not None)

    def _frames_until(self, limit: int, *, many: bool = False) -> Iterator[Frame]:
        """The frames up to a time [ns] that were not made before; those at samples at once, if `many` may be made so."""
        times: Iterable[int] = self.clock.until(limit)
        if many and isinstance(self.clock, TopicClock):
            times = [*times]
            made = self._frames_at_samples(times)
            yield from made
            times = times[len(made) :]
        for time in times:
            frame = self._frame(time)
            if frame is not None:
                yield frame

    def _frames_at_samples(self, times: Sequence[int]) -> list[Frame]:
        """The frames at the first of these times [ns], as far as each stream has its next good sample there."""
        joints = [(route.target, route.stream) for route in self.joints if route.stream is not None]
        streams: list[PoseStream | JointStream] = [
            *(root.stream for root in self.roots),
            *(stream for _, stream in joints),
        ]
        count = min((stream.samples_at(times) for stream in streams), default=0)
        if count == 0:
            return []
        times = times[:count]
        roots, angles = (np.repeat(one[None], count, axis=0) for one in (self.default_roots, self.default_angles))
        for root in self.roots:
            roots[:, root.input.source.tree] = root.world_from_roots(root.stream.take(count))
        for target, stream in joints:
            angles[:, target] = stream.take(count)
        first, extremes = self.count, np.stack([angles.min(axis=0), angles.max(axis=0)])
        if (extremes[0] < self._least).any() or (extremes[1] > self._most).any():
            flags = [*map(self._limits, angles)]
        else:
            flags = [max(map(self._limits, extremes))] * count
        if self.first_time == NEVER:
            self.first_time = times[0]
        self.count += count
        self.last_frame_time = self.last_time = times[-1]
        self.tracks.discard_before(times[-1])
        return [Frame(first + k, times[k], roots[k], angles[k], False, flags[k]) for k in range(count)]

    def _batch_adder(self) -> BatchAdder | None:
        """What adds many messages at once; None where a frame may depend on which came before it was made."""
        config, delay = self.config, round(self.config.max_delay * 1e9)
        goes_by_stamps = self.stamp_monitor is not None and config.time == "header"
        is_cut = config.start is not None or config.end is not None
        clock_is_early = any(route.clock and route.clock_delay < self.earliest_delay for route in self.routes.values())
        if not goes_by_stamps or is_cut or clock_is_early or self.keypoints or self.tracks.moving:
            return None
        assert self.stamp_monitor is not None
        return BatchAdder(
            self.routes, self._readers, self.times, self.stamp_monitor, self._monitored, self.clock, delay
        )

    def _process(self, raw: RawMessage, watermark: Watermark) -> None:
        """Add a message."""
        key, times = raw.key, self.times
        route, read = self.routes[key], self._readers.get(key)
        if read is None:  # a topic used only as frame clock
            time = times.time_of(key, None, raw.log_time, raw.publish_time)
            watermark.add(time)
            self._add_clock_time(time + route.clock_delay)
            return
        try:
            content = read(raw.data)
        except BadMessageError:
            self.bad_messages += 1
            return
        if isinstance(content, JointSample):
            time = times.time_of(key, content.stamp, raw.log_time, raw.publish_time)
            watermark.add(time)
            if route.joints or route.clock:
                self._check_stamp(key, next(iter(content.names), "") if route.joints else "", content.stamp, time, raw)
            late = False
            for joints in route.joints:
                late |= time + joints.delay <= self.last_frame_time
                joints.add(time + joints.delay, content)
            if route.clock and (not route.clock_child or route.clock_child == content.side):
                late |= time + route.clock_delay <= self.last_frame_time
                self._add_clock_time(time + route.clock_delay)
            self.late += late
            return
        times_seen: set[int] = set()
        last_frame_time: set[int] = set()
        for pose in content:
            if route.expected_parents:
                self._process_transform(raw, route, pose, times_seen)
            roots = route.roots.get(pose.child, ())
            is_clock_message = route.clock and (
                not route.clock_child or route.clock_child == pose.child or pose.child in route.clock_points
            )
            if not roots and not is_clock_message:
                route.unused_poses += 1
                continue
            time = times.time_of(key, pose.stamp, raw.log_time, raw.publish_time)
            times_seen.add(time)
            self._check_stamp(key, pose.child, pose.stamp, time, raw)
            for root in roots:
                if time + root.delay <= self.last_frame_time:
                    last_frame_time.add(time)
                root.add(time + root.delay, pose)
            if is_clock_message:
                if time + route.clock_delay <= self.last_frame_time:
                    last_frame_time.add(time)
                self._add_clock_time(time + route.clock_delay)
        self.late += len(last_frame_time)
        for time in times_seen:
            watermark.add(time)

    def _process_transform(self, raw: RawMessage, route: ChannelRoutes, pose: Pose, times_seen: set[int]) -> None:
        """Add a transform of the log's tree.

        Raises LogError if its frame was given in another before.
        """
        child, parent = normalized_frame_id(pose.child), normalized_frame_id(pose.frame)
        expected = route.expected_parents.get(child)
        if expected is None or not parent:
            return
        source = self.source
        topic = source.reader.channels[raw.key].topic
        if parent != expected:
            raise LogError(f"{source.reader.path}: {two_parents_message(child, expected, topic, parent, topic)}")
        track = route.tracks.get(child)
        if track is None:
            return
        if route.static:  # valid at all times, whatever its stamp
            time = pose.stamp or raw.log_time
        else:
            time = self.times.time_of(raw.key, pose.stamp, raw.log_time, raw.publish_time)
            times_seen.add(time)
        track.add(time, source.space.to_metres(pose.value))

    def _check_stamp(self, key: int, part: str, stamp: int | None, time: int, raw: RawMessage) -> None:
        """Check the stamp of a message against earlier ones; raises LogError where they are inconsistent."""
        topic = self._monitored.get(key)
        if topic is not None and (stamp or self.config.time == "publish"):
            assert self.stamp_monitor is not None
            self.stamp_monitor.add(topic, part, time, raw.log_time)

    def _add_clock_time(self, time: int) -> None:
        """Add a message of the frame clock."""
        if not self.clock.add(time):
            self.lost_frames += 1

    def _frame(self, time: int) -> Frame | None:
        """Make the frame at a time; None if it lies outside of `start` and `end`."""
        config = self.config
        if self.first_time == NEVER:
            self.first_time = time
        self.last_frame_time = time
        elapsed = time - self.first_time
        for pose in self.poses:
            pose.resolve(time, time + self.gap)
        self.tracks.discard_before(time)
        if config.end is not None and elapsed > config.end * 1e9:
            return None
        if config.start is not None and elapsed < config.start * 1e9:
            for pose in self.poses:
                pose.stream.advance(time)
            for joints in self.joints:
                if joints.stream is not None:
                    joints.stream.advance(time)
            return None
        is_held = before_first = False
        roots, angles = self.default_roots.copy(), self.default_angles.copy()
        for root in self.roots:
            value = root.stream.at(time)
            roots[root.input.source.tree] = root.world_from_root(value.value)
            is_held |= value.held
            before_first |= value.before_first
        for joints in self.joints:
            if joints.stream is None:
                continue
            row = joints.stream.at(time)
            angles[joints.target] = np.where(np.isnan(row.value), 0.0, row.value) if row.before_first else row.value
            is_held |= row.held
            before_first |= row.before_first
        for keypoints in self.keypoints:
            is_held |= keypoints.add_posture(time, roots, angles)
        flags = FLAG_HELD * is_held | FLAG_BEFORE_FIRST * before_first | self._limits(angles)
        frame = Frame(self.count, time, roots, angles, is_held, flags)
        self.count += 1
        self.held_frames += is_held
        self.last_time = time
        return frame

    def _limits(self, angles: Floats) -> int:
        """Count angles outside of their limits, and clamp them if configured; returns the frame's flags."""
        np.minimum(self.min_angles, angles, out=self.min_angles)
        np.maximum(self.max_angles, angles, out=self.max_angles)
        outside = (angles < self._least) | (angles > self._most)
        if True not in outside.tolist():
            return 0
        self.outside_frames += outside
        if not self.config.clamp_limits:
            return FLAG_OUTSIDE_LIMITS
        np.clip(angles, self.lower, self.upper, out=angles)
        return FLAG_CLAMPED
