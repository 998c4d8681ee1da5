"""Frames of a replay: root poses and joint angles that a log gives for a scene, resampled at the frame clock."""

from __future__ import annotations

from collections.abc import Iterator
from types import TracebackType

from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.recording.keypoint_routes import KeypointRoute
from geomphys.recording.log_pass import LogPass
from geomphys.recording.prepared_log import PreparedLog
from geomphys.recording.report import RecordingReport, make_report
from geomphys.results import Frame
from geomphys.scene.world import World
from geomphys.storage.remote_files import AnyPath


class FrameSource(PreparedLog):
    """The frames of a log in a scene; a context manager and an iterable of `Frame`, in strictly increasing time.

    Parameters
    ----------
    log : Path
        An MCAP file or a ROS 2 bag directory.
    world : World
        Its `roots` and `joints` name the topics; a tree without them is at `scene.trees.rest`, an angle without
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
        super().__init__(log, world, config)
        first_pass = LogPass(self)
        for (topic, child), value in first_pass.first_poses():
            if value is None:
                raise LogError(
                    f"{log}: topic {topic!r} has no good pose{f' of {child!r}' if child else ''} while the transforms to "
                    f"{self.transforms.spaces[0]!r} are there (their times, or NaN in them): try --max-gap, --time log"
                )
            self.first_space_poses[topic, child] = value
        self._pass = LogPass(self) if self.first_space_poses else first_pass
        self._has_begun = False

    def __enter__(self) -> FrameSource:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.reader.close()

    def __iter__(self) -> Iterator[Frame]:
        """Make the frames from the first; resets the report."""
        if self._has_begun:
            self._pass = LogPass(self)
        self._has_begun = True
        return self._pass.frames()

    @property
    def expected_frames(self) -> int | None:
        """Estimated number of frames, from message counts and time spans; None if unknown."""
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
        selected = min(config.end if config.end is not None else span, span) - (config.start or 0.0)
        return max(0, min(count, round(count * selected / span)))

    @property
    def keypoints(self) -> list[KeypointRoute]:
        """The points that joint values are fitted to, as of the last frame made."""
        return self._pass.keypoints

    @property
    def report(self) -> RecordingReport:
        """Report on the frames made so far."""
        return make_report(self, self._pass)
