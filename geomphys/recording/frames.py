"""Frames of a recording: the poses and angles that a log has for a scene, on the frame clock.

The log is streamed: a frame is made as soon as no message that could still change it may come, which is when the log
has come `max_gap` + `max_delay` further than the frame's time. Until then its samples are kept; nothing else is.
"""

from __future__ import annotations

from collections.abc import Iterator
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.recording.channels import Joints, Pose, kind_of, make_reader
from geomphys.recording.clock import FrameClock, RateClock, TopicClock
from geomphys.recording.decoders import BadMessageError
from geomphys.recording.facts import learn, log_times_agree, stream_problems
from geomphys.recording.frame_plan import plan_frames
from geomphys.recording.frame_tree import plain_frame, two_parents
from geomphys.recording.plan import Plan, is_static, make_plan
from geomphys.recording.poses import Seven
from geomphys.recording.reader import LogReader, RawMessage, open_log
from geomphys.recording.report import RecordingReport, report_of
from geomphys.recording.routes import RootRoute, Route
from geomphys.recording.space import RecordedSpace
from geomphys.recording.stamp_watch import StampWatch
from geomphys.recording.times import MessageTimes, Watermark
from geomphys.recording.wiring import wire
from geomphys.results import FLAG_BEFORE_FIRST, FLAG_CLAMPED, FLAG_HELD, FLAG_OUTSIDE_LIMITS, Frame
from geomphys.scene.arrays import JOINT_PRISMATIC, World
from geomphys.storage.remote_files import AnyPath

Floats = NDArray[np.float64]

LIMIT_SLACK = 1e-9  # rad or m by which an angle may leave its limits before it counts as outside
NEVER = -(2**62)


class FrameSource:
    """The frames of a log in a scene; a context manager and an iterable of `Frame`, in strictly increasing time.

    Parameters
    ----------
    log : Path
        An MCAP file or a ROS 2 bag directory.
    world : World
        Its `roots` and `joints` name the topics; a tree without them stands at `scene.trees.rest`, an angle without
        them is 0.
    config : Config
        `time`, `clock`, `rate`, `start`, `end`, `max_gap`, `max_delay`, `clamp_limits` and `recover` are used.

    Raises
    ------
    LogError
        The log cannot be read, lacks a topic that the scene follows, or has no good sample of a pose.
    DamagedLogError
        The log is damaged and `config.recover` is off.
    """

    def __init__(self, log: AnyPath, world: World, config: Config) -> None:
        self.world, self.config = world, config
        self.reader: LogReader = open_log(log, recover=config.recover)
        self.plan: Plan = make_plan(self.reader, world, config)
        if self.plan.problems:
            more = len(self.plan.problems) - 1
            also = f" (and {more} more; `geomphys check` lists them)" if more else ""
            raise LogError(self.plan.problems[0] + also)
        self.times = MessageTimes(config.time, self.reader.channels, self.reader.path)
        self.known = learn(self.reader, self.plan, config, self.times)
        problem = next(stream_problems(self.reader, self.plan, self.known), None)
        if problem is not None:
            raise LogError(problem)
        recorded = world.file.recording
        self.space = RecordedSpace.of(recorded)
        self.frames = plan_frames(self.reader, self.plan, self.known, recorded.frame)
        for key in self.frames.keys - set(self.known.readers):
            channel = self.reader.channels[key]
            if (kind := kind_of(channel)) is not None:
                self.known.readers[key] = make_reader(channel, kind)
        self.firsts: dict[tuple[str, str], Seven] = {}  # of poses in frames that move: the first in the recorded space
        self.file_order = not log_times_agree(self.known, round(config.max_delay * 1e9))
        self.prismatic = prismatic_columns(world)
        for (topic, child), value in Run(self).first_poses():
            if value is None:
                raise LogError(
                    f"{log}: topic {topic!r} has no good pose{f' of {child!r}' if child else ''} while the transforms to "
                    f"{self.frames.spaces[0]!r} are there (their times, or NaN in them): try --max-gap, --time log"
                )
            self.firsts[topic, child] = value
        self._run = Run(self)

    def __enter__(self) -> FrameSource:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.reader.close()

    def __iter__(self) -> Iterator[Frame]:
        """Make the frames, from the first; the report begins anew."""
        self._run = Run(self)
        return self._run.frames()

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics that are used, sorted."""
        return tuple(sorted({self.reader.channels[k].topic for k in self.plan.keys | self.frames.keys}))

    @property
    def expected_frames(self) -> int | None:
        """How many frames there will be, as an estimate: duplicates and `start`/`end` are not looked into."""
        config, clock = self.config, self.plan.clock
        channels = clock.channels if clock is not None else tuple(self.reader.channels.values())
        channels = tuple(c for c in channels if c.messages)
        if not channels:
            return 0
        span = (max(c.last_ns for c in channels) - min(c.first_ns for c in channels)) / 1e9
        count = sum(c.messages for c in channels) if config.rate is None else int(span * config.rate) + 1
        if config.start is None and config.end is None:
            return count
        if span <= 0:
            return None
        kept = min(config.end if config.end is not None else span, span) - (config.start or 0.0)
        return max(0, min(count, round(count * kept / span)))

    @property
    def report(self) -> RecordingReport:
        """Figures of the frames made so far."""
        return self._run.report()


class Run:
    """One pass over the log."""

    def __init__(self, source: FrameSource) -> None:
        self.source, self.world, self.config = source, source.world, source.config
        self.times = source.times.anew()
        delay = round(self.config.max_delay * 1e9)
        self.watch = StampWatch(source.reader.path, delay) if self.config.time != "log" else None
        scene = self.world.scene
        gap = round(self.config.max_gap * 1e9)
        self.gap = gap
        self.clock: FrameClock = TopicClock() if self.config.rate is None else RateClock(self.config.rate)
        wiring = wire(source, gap)
        self.routes, self.roots, self.joints, self.tracks = wiring
        self.still_roots = np.ascontiguousarray(scene.trees.rest, dtype=np.float64)
        self.still_angles = np.zeros(len(scene.dofs.lower))
        self.prismatic = source.prismatic
        early = min([0, *(root.delay for root in self.roots), *(joints.delay for joints in self.joints)])
        self.lookahead = gap + delay - early + gap * self.tracks.moving
        self.recorded = np.zeros(len(self.still_angles), dtype=bool)
        for route in self.joints:
            self.recorded[route.columns] = True
            for column, value in route.constants.items():
                self.still_angles[column], self.recorded[column] = value, True
        self.lower = np.where(self.recorded, scene.dofs.lower, -np.inf)
        self.upper = np.where(self.recorded, scene.dofs.upper, np.inf)
        self.least, self.most = np.full_like(self.still_angles, np.inf), np.full_like(self.still_angles, -np.inf)
        self.outside_frames = np.zeros(len(self.still_angles), dtype=np.int64)
        self.count = self.held = self.bad_messages = self.late = self.lost_frames = 0
        self.first_time = self.last_time = NEVER
        self.passed = NEVER  # time of the last frame, also of those before `start`

    def first_poses(self) -> Iterator[tuple[tuple[str, str], Seven | None]]:
        """First good poses in the recorded space of the streams that are given in frames that move; None if there is none.

        The log is read until they are known.
        """
        waiting = [root for root in self.roots if root.moving]
        if not waiting:
            return
        watermark, keys = Watermark(), set(self.routes)
        for raw in self.source.reader.read(keys, file_order=self.source.file_order):
            self._take(raw, watermark)
            waiting = list(self._without_first(waiting, watermark.time - self.lookahead))
            if not waiting:
                break
        else:
            waiting = list(self._without_first(waiting, 2**62))
        for root in self.roots:
            if root.moving:
                yield (root.input.topic, root.input.child), root.stream.first

    def _without_first(self, roots: list[RootRoute], time: int) -> Iterator[RootRoute]:
        """Those whose first pose is still not known when the log has come to a time."""
        for root in roots:
            root.settle(time, time + self.gap)
            root.stream.first = next((v for v in root.stream.values if v is not None), None)
            if root.stream.first is None:
                root.stream.advance(time + self.gap)
                yield root

    def frames(self) -> Iterator[Frame]:
        """Stream the log."""
        if self.source.plan.clock is None:
            self.clock.add(self.source.reader.start_ns)
            self.clock.add(self.source.reader.end_ns)
        watermark, clock, lookahead = Watermark(), self.clock, self.lookahead
        keys = set(self.routes)
        for raw in self.source.reader.read(keys, file_order=self.source.file_order) if keys else ():
            self._take(raw, watermark)
            for time in clock.until(watermark.time - lookahead):
                frame = self._frame(time)
                if frame is not None:
                    yield frame
                elif self.config.end is not None and time > self.first_time + self.config.end * 1e9:
                    return
        if self.watch is not None:
            self.watch.finish()
        for time in clock.until(2**63):
            frame = self._frame(time)
            if frame is not None:
                yield frame

    def _take(self, raw: RawMessage, watermark: Watermark) -> None:
        """Take in a message."""
        key, times = raw.key, self.times
        route, read = self.routes[key], self.source.known.readers.get(key)
        if read is None:  # a topic that only gives the clock
            time = times.of(key, None, raw.log_time, raw.publish_time)
            watermark.add(time)
            self._beat(time + route.clock_delay)
            return
        try:
            content = read(raw.data)
        except BadMessageError:
            self.bad_messages += 1
            return
        if isinstance(content, Joints):
            time = times.of(key, content.stamp, raw.log_time, raw.publish_time)
            watermark.add(time)
            if route.joints or route.clock:
                self._watch(key, next(iter(content.names), "") if route.joints else "", content.stamp, time, raw)
            late = False
            for joints in route.joints:
                late |= time + joints.delay <= self.passed
                joints.add(time + joints.delay, content)
            if route.clock and (not route.clock_child or route.clock_child == content.side):
                late |= time + route.clock_delay <= self.passed
                self._beat(time + route.clock_delay)
            self.late += late
            return
        moments: set[int] = set()
        passed: set[int] = set()
        for pose in content:
            if route.parents:
                self._take_transform(raw, route, pose, moments)
            roots = route.roots.get(pose.child, ())
            beats = route.clock and (not route.clock_child or route.clock_child == pose.child)
            if not roots and not beats:
                route.others += 1
                continue
            time = times.of(key, pose.stamp, raw.log_time, raw.publish_time)
            moments.add(time)
            self._watch(key, pose.child, pose.stamp, time, raw)
            for root in roots:
                if time + root.delay <= self.passed:
                    passed.add(time)
                root.add(time + root.delay, pose)
            if beats:
                if time + route.clock_delay <= self.passed:
                    passed.add(time)
                self._beat(time + route.clock_delay)
        self.late += len(passed)
        for time in moments:
            watermark.add(time)

    def _take_transform(self, raw: RawMessage, route: Route, pose: Pose, moments: set[int]) -> None:
        """Take in a transform of the log's tree.

        Raises LogError if its frame was given in another before.
        """
        child, parent = plain_frame(pose.child), plain_frame(pose.frame)
        known = route.parents.get(child)
        if known is None or not parent:
            return
        source = self.source
        topic = source.reader.channels[raw.key].topic
        if parent != known:
            raise LogError(f"{source.reader.path}: {two_parents(child, known, topic, parent, topic)}")
        track = route.tracks.get(child)
        if track is None:
            return
        if route.static:  # stamped as its writer likes: it is valid at all times
            time = pose.stamp or raw.log_time
        else:
            time = self.times.of(raw.key, pose.stamp, raw.log_time, raw.publish_time)
            moments.add(time)
        track.add(time, source.space.metres(pose.value))

    def _watch(self, key: int, part: str, stamp: int | None, time: int, raw: RawMessage) -> None:
        """Compare the time of a message with those before it; raises LogError where they cannot be right."""
        topic = self.source.reader.channels[key].topic
        if self.watch is not None and (stamp or self.config.time == "publish") and not is_static(topic):
            self.watch.add(topic, part, time, raw.log_time)

    def _beat(self, time: int) -> None:
        """Take in a message of the frame clock."""
        if not self.clock.add(time):
            self.lost_frames += 1

    def _frame(self, time: int) -> Frame | None:
        """Make the frame at a time; None if it lies outside of `start` and `end`."""
        config = self.config
        if self.first_time == NEVER:
            self.first_time = time
        self.passed = time
        since = time - self.first_time
        for root in self.roots:
            root.settle(time, time + self.gap)
        self.tracks.forget(time)
        if config.end is not None and since > config.end * 1e9:
            return None
        if config.start is not None and since < config.start * 1e9:
            for root in self.roots:
                root.stream.advance(time)
            for joints in self.joints:
                if joints.stream is not None:
                    joints.stream.advance(time)
            return None
        held = before = False
        roots, angles = self.still_roots.copy(), self.still_angles.copy()
        for root in self.roots:
            pose = root.stream.at(time)
            roots[root.input.source.tree] = root.world_from_root(pose.value)
            held |= pose.held
            before |= pose.before
        for joints in self.joints:
            if joints.stream is None:
                continue
            row = joints.stream.at(time)
            angles[joints.columns] = np.where(np.isnan(row.value), 0.0, row.value) if row.before else row.value
            held |= row.held
            before |= row.before
        flags = FLAG_HELD * held | FLAG_BEFORE_FIRST * before | self._limits(angles)
        frame = Frame(self.count, time, roots, angles, held, flags)
        self.count += 1
        self.held += held
        self.last_time = time
        return frame

    def _limits(self, angles: Floats) -> int:
        """Count angles outside of their limits, clamp them if that is asked for; the frame's flags."""
        np.minimum(self.least, angles, out=self.least)
        np.maximum(self.most, angles, out=self.most)
        outside = (angles < self.lower - LIMIT_SLACK) | (angles > self.upper + LIMIT_SLACK)
        if not outside.any():
            return 0
        self.outside_frames += outside
        if not self.config.clamp_limits:
            return FLAG_OUTSIDE_LIMITS
        np.clip(angles, self.lower, self.upper, out=angles)
        return FLAG_CLAMPED

    def report(self) -> RecordingReport:
        """Figures so far."""
        return report_of(self.source, self)


def prismatic_columns(world: World) -> NDArray[np.bool_]:
    """(Q,) which degrees of freedom are lengths."""
    bodies = world.scene.bodies
    prismatic = np.zeros(len(world.scene.dofs.lower), dtype=bool)
    own = (bodies.dof >= 0) & (bodies.multiplier == 1) & (bodies.offset == 0)
    for dof in range(len(prismatic)):
        candidates = np.flatnonzero(own & (bodies.dof == dof))
        if len(candidates) == 0:
            candidates = np.flatnonzero(bodies.dof == dof)
        if len(candidates):
            prismatic[dof] = bodies.joint[candidates[0]] == JOINT_PRISMATIC
    return prismatic
