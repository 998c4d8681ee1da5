"""Compares two outputs, read in parallel frame by frame, so that memory does not grow with their length."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from typing import NamedTuple

from defusedxml import ElementTree

from geomphys.analysis.binned_curve import BinnedCurve
from geomphys.analysis.diff.channels import Channel, Tolerance
from geomphys.analysis.diff.difference import Curves, Matching, OutputDifference
from geomphys.analysis.diff.measures import Peak, Peaks
from geomphys.analysis.diff.motion_channels import JointChannel, PoseChannel
from geomphys.analysis.diff.result_channels import ContactChannel, LogChannel, MetricsChannel, PenetrationChannel
from geomphys.analysis.diff.scene_words import scene_differences
from geomphys.analysis.metric_values import MetricValues
from geomphys.analysis.output_motion import OutputMotionMeter
from geomphys.errors import ConfigError, LogError
from geomphys.output.decoders import Poses
from geomphys.output.output_log import OutputFrame, OutputLog, open_output
from geomphys.output.provenance import MEASURES
from geomphys.output.worst_moments import WorstMoments
from geomphys.results import Moment
from geomphys.storage.remote_files import AnyPath

CHANNELS = ("/tf", "/recorded/tf", "joint_states", "/contacts", "/penetration", "/metrics", "/log")
"""What can be compared; ``joint_states`` stands for the joint values of every avatar."""

CURVE_POINTS = 1200
"""Maximum number of points of a curve."""
PEAKS = 4
"""Number of frames with the largest differences that are shown."""
MIN_PEAK_DISTANCE_NS = 500_000_000
"""ns; minimum time between two of them."""


class PeakPoses(NamedTuple):
    """Poses of both outputs in a frame of large difference."""

    body: str  # frame id of the body with the largest difference
    a: Poses
    b: Poses


def compare_outputs(
    a: AnyPath | str,
    b: AnyPath | str,
    *,
    tolerance_m: float = 0.0,
    tolerance_rad: float = 0.0,
    channels: Collection[str] = CHANNELS,
    progress: Callable[[int, int | None], None] | None = None,
) -> OutputDifference:
    """Compare two outputs channel by channel. Frames are matched by their times, bodies and joints by their names.

    Parameters
    ----------
    a, b : Path or str
        Output logs.
    tolerance_m, tolerance_rad : float
        Up to where lengths [m] and angles [rad] count as equal. With both 0 everything has to be equal, bit for bit;
        see `Tolerance` for what decides with one above 0.
    channels : collection of str
        Which of `CHANNELS` to compare.
    progress : callable, optional
        Called with the frames compared and their number.

    Raises
    ------
    ConfigError
        A tolerance is negative, or a channel unknown.
    LogError
        A file is no output, is damaged, or has no frame.
    """
    tolerance = Tolerance(m=tolerance_m, rad=tolerance_rad)
    if not (tolerance_m >= 0.0 and tolerance_rad >= 0.0):
        raise ConfigError(f"tolerance = {min(tolerance_m, tolerance_rad)}: must not be negative")
    unknown = set(channels) - set(CHANNELS)
    if unknown or not channels:
        raise ConfigError(f"channel = {', '.join(sorted(unknown))}: choose among {', '.join(CHANNELS)}")
    output_a, output_b = open_output(a), open_output(b)
    requested = [name for name in CHANNELS if name in channels]
    first_a, first_b = _first(output_a, requested), _first(output_b, requested)
    compared: dict[str, Channel] = {}
    for name in requested:
        compared |= _comparers(name, tolerance, output_a, output_b, first_a, first_b)
    trace = _FrameComparison(compared)
    counts = dict.fromkeys(("compared", "only_a", "only_b"), 0)
    first_frames: dict[str, int | None] = {"only_a": None, "only_b": None}
    total = max(output_a.frame_count, output_b.frame_count)
    measured = [_MeasuredFrames(output, requested) for output in (output_a, output_b)]
    for frame_a, frame_b in match_frames(*(side.frames() for side in measured)):
        if frame_a is not None and frame_b is not None:
            counts["compared"] += 1
            trace.add(frame_a, frame_b)
        else:
            frame = frame_a or frame_b
            assert frame is not None
            side = "only_b" if frame_a is None else "only_a"
            counts[side] += 1
            first_frames[side] = frame.index if first_frames[side] is None else first_frames[side]
        if progress is not None:
            progress(sum(counts.values()), total)
    results = {name: comparer.result() for name, comparer in compared.items()}
    if not counts["compared"]:
        results = {name: dataclasses.replace(result, equal=False) for name, result in results.items()}
    files_a, files_b = output_a.attachments(), output_b.attachments()
    return OutputDifference(
        a=str(a),
        b=str(b),
        equal=all(channel.equal for channel in results.values()) and not counts["only_a"] and not counts["only_b"],
        tolerance=tolerance,
        frames=Matching(
            a=output_a.frame_count,
            b=output_b.frame_count,
            **counts,
            first_only_a=first_frames["only_a"],
            first_only_b=first_frames["only_b"],
            offset_s=(first_b.time_ns - first_a.time_ns) / 1e9,
        ),
        channels=results,
        parameters={
            name: (output_a.metadata.get(name), output_b.metadata.get(name))
            for name in dict.fromkeys([*output_a.metadata, *output_b.metadata])
            if name not in MEASURES and output_a.metadata.get(name) != output_b.metadata.get(name)
        },
        attachments=tuple(
            name for name in sorted(files_a.keys() | files_b.keys()) if files_a.get(name) != files_b.get(name)
        ),
        scene=scene_differences(files_a, files_b),
        motion=(measured[0].motion.motion(), measured[1].motion.motion()) if measured[0].has_motion else None,
        values=(measured[0].values.distributions(), measured[1].values.distributions())
        if measured[0].has_metrics
        else None,
        worst=(measured[0].moments(), measured[1].moments()),
        curves=trace.curves(),
        peaks=tuple(trace.peaks.sorted_peaks()),
    )


class _MeasuredFrames:
    """The frames of an output; measures its motion while they are read, if poses and metrics are among its channels."""

    def __init__(self, output: OutputLog, channels: Collection[str]) -> None:
        self._output, self._channels = output, channels
        self.has_motion = {"/tf", "/recorded/tf", "/metrics"} <= set(channels)
        self.has_metrics = "/metrics" in channels
        self.motion, self.values, self._worst = OutputMotionMeter(output), MetricValues(), WorstMoments()

    def frames(self) -> Iterator[OutputFrame]:
        """The frames, each measured before it is handed on."""
        for frame in self._output.frames(self._channels):
            if self.has_metrics:
                self.values.add(frame.metrics)
            if self.has_motion:
                self.motion.add(frame)
                self._worst.add_output(frame)
            yield frame

    def moments(self) -> tuple[Moment, ...]:
        """The moments to look at first."""
        return self._worst.moments(self._output.intersection_volume_m3)


def _first(output: OutputLog, channels: Collection[str]) -> OutputFrame:
    for frame in output.frames(channels):
        return frame
    raise LogError(f"{output.path}: holds no frame")


def _comparers(
    name: str, tolerance: Tolerance, a: OutputLog, b: OutputLog, first_a: OutputFrame, first_b: OutputFrame
) -> dict[str, Channel]:
    """Topic -> its comparer."""
    if name in ("/tf", "/recorded/tf"):
        return {name: PoseChannel(name, tolerance, first_a, first_b)}
    if name == "joint_states":
        sliding = joints_of_type(a, "prismatic") | joints_of_type(b, "prismatic")
        continuous = joints_of_type(a, "continuous") & joints_of_type(b, "continuous")
        topics = dict.fromkeys([*a.joint_topics, *b.joint_topics])
        return {topic: JointChannel(topic, tolerance, sliding, continuous) for topic in topics}
    kinds: dict[str, Callable[[Tolerance], Channel]] = {
        "/contacts": ContactChannel,
        "/penetration": PenetrationChannel,
        "/metrics": MetricsChannel,
        "/log": LogChannel,
    }
    return {name: kinds[name](tolerance)}


def joints_of_type(output: OutputLog, kind: str) -> frozenset[str]:
    """Names of the joints of a type in the URDFs attached to an output, as ``prismatic``: their values are lengths."""
    names: set[str] = set()
    for name, data in output.attachments().items():
        if name.endswith(".urdf"):
            joints = ElementTree.fromstring(data).iter("joint")
            names.update(joint.get("name", "") for joint in joints if joint.get("type") == kind)
    return frozenset(names)


def match_frames(
    a: Iterator[OutputFrame], b: Iterator[OutputFrame]
) -> Iterator[tuple[OutputFrame | None, OutputFrame | None]]:
    """Frames of the same time together, others alone, in the order of their times."""
    frame_a, frame_b = next(a, None), next(b, None)
    while frame_a is not None or frame_b is not None:
        if frame_b is None or (frame_a is not None and frame_a.time_ns < frame_b.time_ns):
            yield frame_a, None
            frame_a = next(a, None)
        elif frame_a is None or frame_b.time_ns < frame_a.time_ns:
            yield None, frame_b
            frame_b = next(b, None)
        else:
            yield frame_a, frame_b
            frame_a, frame_b = next(a, None), next(b, None)


@dataclass
class _FrameComparison:
    """Passes frames to the comparers and collects curves and peaks."""

    channels: dict[str, Channel]

    def __post_init__(self) -> None:
        self.peaks = Peaks(PEAKS, MIN_PEAK_DISTANCE_NS)
        curves = [BinnedCurve(CURVE_POINTS) for _ in range(5)]
        self._position, self._angle, self._joints, self._contacts, self._depth = curves

    def add(self, a: OutputFrame, b: OutputFrame) -> None:
        joints = 0.0
        for name, channel in self.channels.items():
            largest = channel.add(a, b)
            if isinstance(channel, PoseChannel) and name == "/tf":
                self._position.add(a.index, largest)
                self._angle.add(a.index, channel.angle)
                if self.peaks.would_keep(largest, a.time_ns):
                    body = channel.compared[int(channel.differences.argmax())]
                    self.peaks.add(Peak(largest, a.index, a.time_ns, PeakPoses(body, a.tf, b.tf)))
            elif isinstance(channel, JointChannel):
                joints = max(joints, channel.angle)
            elif isinstance(channel, ContactChannel):
                self._contacts.add(a.index, float(channel.changed))
            elif isinstance(channel, PenetrationChannel):
                self._depth.add(a.index, largest)
        self._joints.add(a.index, joints)

    def curves(self) -> Curves:
        return Curves(
            position_m=self._position.maxima(),
            angle_rad=self._angle.maxima(),
            joints_rad=self._joints.maxima(),
            contacts=self._contacts.maxima(),
            penetration_m=self._depth.maxima(),
        )
