"""The entry points `replay` (an iterator of frame results) and `run` (files in, files and a summary out)."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from itertools import chain

from geomphys.config import Callbacks, Config, OutputOptions
from geomphys.engine.frame_buffer import FRAMES
from geomphys.engine.log_messages import Message
from geomphys.engine.pipeline import Pipeline, compile_ahead
from geomphys.errors import LogError
from geomphys.jit.kernel import are_compiled
from geomphys.jit.work import progress_to
from geomphys.load import load_world, scaled_to_log
from geomphys.output.file_sinks import FILE_SINKS, FileSinkOptions, make_file_sink
from geomphys.output.provenance import provenance_of
from geomphys.output.sink import Sink, write_columns
from geomphys.output.summary import Summarizer, Summary
from geomphys.output.worst_moments import WorstMoments
from geomphys.recording.frames import FrameSource
from geomphys.recording.report import RecordingReport
from geomphys.results import Frame, FrameResult, ResultColumns
from geomphys.scene.world import World
from geomphys.storage.output_file import check_targets
from geomphys.storage.overlapped_call import can_overlap
from geomphys.storage.remote_files import AnyPath, as_path


def replay(
    log: AnyPath | str,
    scene: AnyPath | str | World,
    *,
    config: Config | None = None,
    sinks: Sequence[Sink] = (),
    progress: Callable[[int, int | None], None] | None = None,
) -> Iterator[FrameResult]:
    """Replay a log in a scene; yields one result a frame.

    Parameters
    ----------
    log
        An MCAP file or a ROS 2 bag directory.
    scene
        A scene file or the world it was loaded into.
    config
        All parameters; None: the defaults.
    sinks
        Opened before the first frame, given the frames that were yielded, many at a time, closed after the last; closed as
        incomplete if the replay ends early (an error, or the caller stops iterating). Without a frame they are not opened.
    progress
        Called for each frame with the number of frames done and, if known, of all.

    Yields
    ------
    FrameResult
        In order of time. The stage `encode` of a frame is the time the sinks took for a frame of those before.

    Raises
    ------
    InputError
        The log, the scene or a model is wrong.
    OutputError
        A sink cannot write.
    """
    with closing(_parts(as_path(log), scene, config or Config(), sinks, Callbacks(progress=progress))) as parts:
        for part in parts:
            for row in part.take():
                yield part.columns.result(row)


def run(
    log: AnyPath | str,
    scene: AnyPath | str | World,
    *,
    out: AnyPath | str | None = None,
    rrd: AnyPath | str | None = None,
    config: Config | None = None,
    force: bool = False,
    options: OutputOptions | None = None,
    callbacks: Callbacks | None = None,
) -> Summary:
    """Replay a log to its end, write the requested outputs and return a summary.

    Parameters
    ----------
    log : Path or str
        An MCAP file or a ROS 2 bag directory.
    scene : Path, str or World
        The scene file, or the world it was loaded into.
    out : Path or str, optional
        The file to write. Its suffix chooses the format among `geomphys.output.file_sinks.FILE_SINKS`; MCAP for others.
    rrd : Path or str, optional
        The rerun recording to write. With neither, only the figures are returned.
    config : Config, optional
        All parameters; None: the defaults.
    force : bool
        Whether outputs that exist are replaced.
    options : OutputOptions, optional
        What the files hold; None: the defaults.
    callbacks : Callbacks, optional
        Called while it is at work.

    Returns
    -------
    Summary
        In SI units.

    Raises
    ------
    InputError
        The log, the scene or a model is wrong.
    OutputError
        An output exists without `force`, is an input, or cannot be written.
    """
    log, config = as_path(log), config or Config()
    options, callbacks = options or OutputOptions(), callbacks or Callbacks()
    out, rrd = (None if path is None else as_path(path) for path in (out, rrd))
    check_targets([path for path in (out, rrd) if path is not None], force=force, inputs=(log,), partial=True)
    compiled = are_compiled(config.method)
    with progress_to(callbacks.compiling):
        world = (
            scene
            if isinstance(scene, World)
            else load_world(
                scene,
                mode=config.mode,
                seed=config.seed,
                progress=callbacks.loading,
                assembled=lambda world: compile_ahead(world, config),
            )
        )
        world = scaled_to_log(log, world, config, progress=callbacks.loading)
        summarizer = Summarizer(world.body_names, world.findings, config.method)
        copied_log = log if options.copy_input else None
        of_sinks = FileSinkOptions(force=force, timing=options.timing, copied_log=copied_log, ros2=options.ros2)
        sinks = [] if out is None else [make_file_sink(out, of_sinks, default=".mcap")]
        sinks += [] if rrd is None else [FILE_SINKS[".rrd"](rrd, of_sinks)]
        start = time.perf_counter()
        with closing(_parts(log, world, config, sinks, callbacks)) as parts:
            for part in parts:
                if not compiled:
                    start, compiled = time.perf_counter(), True
                for _ in part.take():
                    pass
                summarizer.add_columns(part.columns)
        elapsed = time.perf_counter() - start
    if summarizer.frames == 0:
        time_limits = [
            f"{name} = {value:g} s"
            for name, value in (("start", config.start), ("end", config.end))
            if value is not None
        ]
        reason = (
            f"with {' and '.join(time_limits)} it has no frames" if time_limits else "`geomphys check` shows the reason"
        )
        raise LogError(f"{log}: gave no frame in the scene {world.path}; {reason}")
    return summarizer.summary(log=log, scene=world.path, out=out, rrd=rrd, elapsed_s=elapsed)


@dataclass
class _Part:
    """Frames of a replay that were computed together. Sinks are given those that were taken."""

    columns: ResultColumns
    first: int
    expected: int | None
    progress: Callable[[int, int | None], None] | None
    taken: int = 0

    def take(self) -> Iterator[int]:
        """Take the frames one after another; yields their rows."""
        for row in range(len(self.columns)):
            self.taken = row + 1
            if self.progress is not None:
                self.progress(self.first + self.taken, self.expected)
            yield row


def _parts(
    log: AnyPath,
    scene: AnyPath | str | World,
    config: Config,
    sinks: Sequence[Sink],
    callbacks: Callbacks,
) -> Generator[_Part, None, None]:
    """The frames of a replay, see `replay`; to be closed."""
    world = scene if isinstance(scene, World) else load_world(scene, mode=config.mode, seed=config.seed)
    world = scaled_to_log(log, world, config)
    opened: list[Sink] = []
    complete = False
    try:
        with FrameSource(log, world, config) as source:
            batches = _batches(source)
            first = next(batches, None)
            if first is None:  # nothing to write
                return
            if sinks:
                provenance = provenance_of(log, world, config)
                if callbacks.hashed is not None:
                    callbacks.hashed(provenance.input_sha256, provenance.scene_sha256)
                for sink in sinks:
                    sink.open(world, config, provenance)
                    opened.append(sink)
            done, encode_ns = 0, 0
            with closing(Pipeline(world, config, overlaps=can_overlap())) as pipeline:
                for columns in _results(source, chain([first], batches), pipeline):
                    columns.stage_ns[:, -1] = encode_ns
                    part = _Part(columns, done, source.expected_frames, callbacks.progress)
                    try:
                        yield part
                    finally:
                        start = time.perf_counter_ns()
                        if part.taken:
                            write_columns(sinks, columns.rows(0, part.taken))
                        encode_ns = (time.perf_counter_ns() - start) // len(columns)
                    done += len(columns)
        complete = True
    finally:
        with ExitStack() as stack:  # every sink is closed even if another fails to close
            for sink in reversed(opened):
                stack.callback(sink.close, complete)


def _batches(source: FrameSource) -> Iterator[tuple[list[Frame], int]]:
    frames = iter(source)
    while True:
        start = time.perf_counter_ns()
        batch = [frame for _, frame in zip(range(FRAMES), frames, strict=False)]
        if not batch:
            return
        yield batch, (time.perf_counter_ns() - start) // len(batch)


def _recording_messages(report: RecordingReport) -> Iterator[tuple[str, str]]:
    """Level and text of the messages on the recording, reported with the last frame."""
    yield from (("info", str(use)) for use in report.transforms)
    yield from (("warning", text) for text in report.warnings)


def _scene_messages(world: World) -> tuple[Message, ...]:
    """Level and text of the messages on the scene, reported with the first frame."""
    findings = world.findings
    return (*(("warning", text) for text in findings.warnings), *(("info", text) for text in findings.notes))


def _results(
    source: FrameSource, batches: Iterator[tuple[list[Frame], int]], pipeline: Pipeline
) -> Iterator[ResultColumns]:
    """The results of the frames, with all messages."""
    worst, is_first = WorstMoments(pipeline.world.body_names), True
    for chunk in pipeline.chunks(batches):
        columns, last = pipeline.results(chunk), len(chunk.frames) - 1
        messages = dict(columns.messages)
        if is_first and (of_scene := _scene_messages(pipeline.world)):
            messages[0] = messages.get(0, ()) + of_scene
        is_first = False
        worst.add_columns(columns)
        if chunk.is_last:
            if of_log := tuple(_recording_messages(source.report)):
                messages[last] = messages.get(last, ()) + of_log
            moments = worst.moments(worst.intersection_volume(pipeline.world))
            columns = replace(columns, moments={last: moments}, grasps={last: pipeline.grasps()})
        yield replace(columns, messages=messages)
