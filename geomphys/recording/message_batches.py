"""Adds many messages to the streams at once, where all of them are regular.

That is so in the middle of a recording: messages of a known layout with good values and stamps that increase, none of them
late. Then the streams, the stamps' monitor and the frame clock are as if the messages had been added one after another, and
so are the frames that are made after them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.recording.clock import FrameClock
from geomphys.recording.fixed_layout import Columns, FixedLayoutReader, JointShape
from geomphys.recording.message_times import MessageTimes, Watermark
from geomphys.recording.raw_messages import Messages
from geomphys.recording.routes import ChannelRoutes, JointRoute, RootRoute
from geomphys.recording.samples import Content
from geomphys.recording.stamp_monitor import StampMonitor, StampTrack

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


class _Run(NamedTuple):
    """The messages of a channel in a batch, and where their values go."""

    route: ChannelRoutes
    positions: Ints  # in the batch
    times: Ints  # ns, their stamps
    log_times: Ints  # ns
    track: StampTrack
    values: list[tuple[RootRoute | JointRoute, Floats]]
    is_clock: bool


class BatchAdder:
    """Adds batches of messages to the streams of a pass.

    Parameters
    ----------
    routes, readers : dict
        Of the channels, by their keys.
    times : MessageTimes
    monitor : StampMonitor
    topics : dict
        Topics of the channels whose stamps are monitored, by their keys.
    clock : FrameClock
    delay : int
        ns that a message may come late.
    """

    def __init__(
        self,
        routes: dict[int, ChannelRoutes],
        readers: dict[int, Callable[[bytes], Content]],
        times: MessageTimes,
        monitor: StampMonitor,
        topics: dict[int, str],
        clock: FrameClock,
        delay: int,
    ) -> None:
        self._routes, self._readers, self._times = routes, readers, times
        self._monitor, self._topics, self._clock, self._delay = monitor, topics, clock, delay

    def add(self, batch: Messages, watermark: Watermark) -> bool:
        """Add the messages and return True; add none and return False where one is irregular."""
        runs = []
        for key, positions in batch.by_channel().items():
            run = self._run(key, positions, batch)
            if run is None:
                return False
            runs.append(run)
        times = np.empty(len(batch), np.int64)
        for run in runs:
            times[run.positions] = run.times
        latest = np.maximum.accumulate([max(watermark.latest, default=times[0]), *times[:-1]])
        if (times < latest - self._delay).any():
            return False
        for run in runs:
            self._apply(run)
        watermark.add_many(times)
        return True

    def _run(self, key: int, positions: Ints, batch: Messages) -> _Run | None:
        """The messages of a channel, at positions in the batch; None where one is irregular."""
        route, read, topic = self._routes[key], self._readers.get(key), self._topics.get(key)
        if (
            not isinstance(read, FixedLayoutReader)
            or topic is None
            or route.expected_parents
            or key in self._times.zero_stamps
        ):
            return None
        columns = read.columns([batch.data[p] for p in positions.tolist()])
        if columns is None or not columns.stamps.all():
            return None
        part, child = _names(columns, route)
        track = self._monitor.tracks.get((topic, part))
        log_times = batch.log_times[positions]
        if track is None or not track.is_steady(columns.stamps, log_times):
            return None
        values = _values(columns, route)
        if not values:
            return None
        is_clock = route.clock and (not route.clock_child or route.clock_child == child or child in route.clock_points)
        return _Run(route, positions, columns.stamps, log_times, track, values, is_clock)

    def _apply(self, run: _Run) -> None:
        """Add the messages of a channel."""
        run.track.add_steady(run.times, run.log_times)
        for route, values in run.values:
            route.extend((run.times + route.delay).tolist(), values)
        if run.is_clock:
            for time in (run.times + run.route.clock_delay).tolist():
                self._clock.add(time)


def _names(columns: Columns, route: ChannelRoutes) -> tuple[str, str]:
    """By what the stamps of messages are monitored, and what the frame clock knows them by."""
    shape = columns.shape
    if isinstance(shape, JointShape):
        return next(iter(shape.names), "") if route.joints else "", shape.side
    return shape.child, shape.child


def _values(columns: Columns, route: ChannelRoutes) -> list[tuple[RootRoute | JointRoute, Floats]]:
    """The values for each stream of a channel; none where a message is irregular."""
    shape, first, found = columns.shape, int(columns.stamps[0]), list[tuple[RootRoute | JointRoute, Floats]]()
    if isinstance(shape, JointShape):
        for joints in route.joints:
            rows = joints.plain_values(first + joints.delay, shape.names, columns.values)
            if rows is None:
                return []
            found.append((joints, rows))
        return found
    for root in route.roots.get(shape.child, ()):
        poses = root.plain_values(first + root.delay, columns.values, shape.frame)
        if poses is None:
            return []
        found.append((root, poses))
    return found
