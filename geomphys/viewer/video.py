"""Makes a video of a result in software: the recorded motion beside the corrected one, as MP4 or GIF."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from subprocess import DEVNULL, PIPE, Popen
from tempfile import TemporaryFile
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.config import MAX_SECONDS
from geomphys.errors import ConfigError, LogError, OutputError
from geomphys.output.camera import Viewpoint
from geomphys.output.output_log import OutputLog, open_output
from geomphys.output.output_results import results_of_output
from geomphys.output.output_world import world_of_output
from geomphys.recording.display_names import printable
from geomphys.results import FrameResult
from geomphys.scene.world import World
from geomphys.storage.child_process import ending_with_this_process
from geomphys.storage.output_file import OutputFile, check_target, is_standard_output
from geomphys.storage.process_pool import ProcessPool
from geomphys.storage.remote_files import AnyPath
from geomphys.viewer.frame_picture import FramePainter, sample_of, viewpoint_of

Pixels = NDArray[np.uint8]

SUFFIXES = (".mp4", ".gif")
WORST_S = 4.0
"""s; length of the stretch about the worst frame."""
PENDING = 8
"""Pictures per process that may wait to be written."""
PALETTE_PICTURES = 6
"""Pictures that the colours of a GIF are taken from."""
_TEXT_PX, _MARGIN_PX = 20, 14
_INK = (60, 60, 66)


@dataclass(frozen=True, kw_only=True)
class VideoConfig:
    """What a video shows and how; lengths in s, sizes in px."""

    start: float | None = None
    """s after the first frame; None: from the first."""
    end: float | None = None
    """s after the first frame; None: to the last."""
    focus: str | None = None
    """Body, avatar or object that the camera looks at; None: what is in contact or was corrected."""
    worst: bool = False
    """Only `WORST_S` about the frame with the largest correction, or recorded depth where nothing was corrected."""
    rate: float | None = None
    """Pictures a second; None: 30 in an MP4, 15 in a GIF, and never more than frames."""
    size: tuple[int, int] = (640, 480)
    """Width and height of each of the two halves; even numbers."""
    processes: int = 1
    """Processes that draw; they do not change the result."""

    def __post_init__(self) -> None:
        """Raise ConfigError for a value out of its range."""
        if self.worst and (self.start is not None or self.end is not None):
            raise ConfigError("worst chooses the stretch: leave out its start and end")
        for name, time in (("start", self.start), ("end", self.end)):
            if time is not None and not 0.0 <= time <= MAX_SECONDS:
                raise ConfigError(f"{name} = {time:g} s: must be from 0 to {MAX_SECONDS:g} s")
        if self.start is not None and self.end is not None and self.end <= self.start:
            raise ConfigError(f"end = {self.end:g} s: must be after start = {self.start:g} s")
        if self.rate is not None and not 0.1 <= self.rate <= 240.0:
            raise ConfigError(f"rate = {self.rate:g}: must be from 0.1 to 240 pictures a second")
        if any(side % 2 or not 64 <= side <= 4096 for side in self.size):
            raise ConfigError(f"size = {self.size}: must be even numbers from 64 to 4096")
        if self.processes < 1:
            raise ConfigError(f"processes = {self.processes}: must be at least 1")


class Video(NamedTuple):
    """What was written."""

    pictures: int
    rate: float  # Hz
    first_frame: int
    last_frame: int


def make_video(
    result: AnyPath,
    out: AnyPath,
    config: VideoConfig | None = None,
    *,
    force: bool = False,
    progress: Callable[[int, int | None], None] | None = None,
) -> Video:
    """Write a video of an output log.

    Parameters
    ----------
    result : Path
        The output log (``.mcap``).
    out : Path
        The video; its suffix, ``.mp4`` or ``.gif``, is its format; ``-``: a GIF on standard output.
    config : VideoConfig, optional
    force : bool
        Whether a file that is there may be replaced.
    progress : callable, optional
        Called with the pictures drawn and their number.

    Raises
    ------
    LogError, InputError
        The file is no output, or has no frames in that stretch.
    ConfigError
        The body in focus is not there.
    OutputError
        The video cannot be written.
    """
    config = config or VideoConfig()
    suffix = ".gif" if is_standard_output(out) else out.suffix.lower()
    if suffix not in SUFFIXES:
        raise OutputError(f"{out}: ends in {out.suffix!r}; a video is {' or '.join(SUFFIXES)}")
    check_target(out, force=force, inputs=(result,))
    output = open_output(result)
    world = world_of_output(output)
    frames, rate = _frames_to_show(output, config, 30.0 if suffix == ".mp4" else 15.0)
    span = {"first": int(frames[0]), "last": int(frames[-1])}
    sample = sample_of(results_of_output(output, world, **span))
    eye = viewpoint_of(world, sample, config.focus, config.size)
    start_ns = output.start_ns
    with OutputFile(out, force=force, inputs=(result,)) as file:
        chosen = (r for r, times in _repeated(results_of_output(output, world, **span), frames) for _ in range(times))
        pictures = _counted(_pictures(world, eye, config, chosen, start_ns), len(frames), progress)
        if suffix == ".mp4":
            _write_mp4(file, pictures, rate, (2 * config.size[0], config.size[1]))
        else:
            few = iter(sample[:: max(1, len(sample) // PALETTE_PICTURES)])
            _write_gif(file, pictures, rate, list(_pictures(world, eye, config, few, start_ns)))
    return Video(len(frames), rate, span["first"], span["last"])


def _frames_to_show(output: OutputLog, config: VideoConfig, rate: float) -> tuple[NDArray[np.int64], float]:
    """Numbers of the frames to draw, one for each picture, and the pictures a second."""
    columns = output.metrics()
    numbers, seconds = columns["frame"].astype(np.int64), (columns["time_ns"] - columns["time_ns"][:1]) / 1e9
    if len(numbers) == 0:
        raise LogError(f"{output.path}: holds no frame")
    start, end = config.start or 0.0, seconds[-1] if config.end is None else config.end
    if config.worst:
        measure = columns["correction_m"] if columns["correction_m"].any() else columns["recorded_penetration_m"]
        middle = float(seconds[int(np.argmax(measure))])
        start, end = middle - WORST_S / 2, middle + WORST_S / 2
    inside = np.flatnonzero((seconds >= start) & (seconds <= end))
    if len(inside) == 0:
        raise LogError(f"{output.path}: has no frame from {start:g} to {end:g} s; it is {seconds[-1]:.6g} s long")
    seconds, numbers = seconds[inside], numbers[inside]
    length = float(seconds[-1] - seconds[0])
    own = (len(seconds) - 1) / length if length > 0.0 else rate
    rate = config.rate or min(rate, own)
    times = seconds[0] + np.arange(int(length * rate + 1e-9) + 1) / rate
    return numbers[np.searchsorted(seconds, times + 1e-9, side="right") - 1], rate


def _repeated(results: Iterator[FrameResult], frames: NDArray[np.int64]) -> Iterator[tuple[FrameResult, int]]:
    """The results among `frames` (ascending, with repetitions), and how often each is there."""
    counts = dict(zip(*np.unique(frames, return_counts=True), strict=True))
    for result in results:
        if result.frame.index in counts:
            yield result, int(counts[result.frame.index])


def _counted(
    pictures: Iterator[Pixels], total: int, progress: Callable[[int, int | None], None] | None
) -> Iterator[Pixels]:
    for number, picture in enumerate(pictures, 1):
        yield picture
        if progress is not None:
            progress(number, total)


_painter: FramePainter | None = None  # of a drawing process


def _begin(world: World) -> None:
    global _painter
    _painter = FramePainter(world)


def _pictures(
    world: World, eye: Viewpoint, config: VideoConfig, results: Iterator[FrameResult], start_ns: int
) -> Iterator[Pixels]:
    """The pictures, in order; drawn by several processes where `config` says so."""
    if config.processes == 1:
        painter = FramePainter(world)
        for result in results:
            yield _side_by_side(painter, result, eye, config.size, start_ns)
        return
    with ProcessPool(config.processes, _begin, world) as pool:
        pending: list[Future[Pixels]] = []
        for result in results:
            pending.append(pool.submit(_draw, result, eye, config.size, start_ns))
            if len(pending) >= PENDING * config.processes:
                yield pending.pop(0).result()
        for future in pending:
            yield future.result()


def _draw(result: FrameResult, eye: Viewpoint, size: tuple[int, int], start_ns: int) -> Pixels:
    assert _painter is not None
    return _side_by_side(_painter, result, eye, size, start_ns)


def _side_by_side(
    painter: FramePainter, result: FrameResult, eye: Viewpoint, size: tuple[int, int], start_ns: int
) -> Pixels:
    """Pixels (h, 2 w, 3): the recorded motion left, the corrected one right, with captions."""
    from PIL import Image, ImageDraw, ImageFont

    halves = [painter.picture(result, eye, size, motion) for motion in ("recorded", "corrected")]
    image = Image.fromarray(np.concatenate(halves, axis=1))
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(_TEXT_PX * size[1] / 480)
    margin = _MARGIN_PX * size[1] / 480
    seconds = (result.frame.time_ns - start_ns) / 1e9
    depth, moved = 1e3 * result.metrics.recorded_penetration_m, 1e3 * result.metrics.correction_m
    captions = (
        f"recorded   {depth:.1f} mm inside" if depth > 0.05 else "recorded",
        f"corrected   moved by {moved:.1f} mm" if moved > 0.05 else "corrected",
    )
    for half, caption in enumerate(captions):
        draw.text((half * size[0] + margin, margin), caption, fill=_INK, font=font)
    draw.text((2 * size[0] - margin, margin), f"{seconds:.2f} s", fill=_INK, font=font, anchor="ra")
    draw.line([(size[0], 0), (size[0], size[1])], fill=(255, 255, 255), width=3)
    return np.asarray(image)


def _write_gif(file: OutputFile, pictures: Iterator[Pixels], rate: float, typical: Sequence[Pixels]) -> None:
    """Animated GIF that repeats for ever, with one palette, made from `typical` pictures."""
    from PIL import Image

    colours = Image.fromarray(np.concatenate(typical)).quantize(255, method=Image.Quantize.MAXCOVERAGE)
    images = [Image.fromarray(p).quantize(palette=colours, dither=Image.Dither.NONE) for p in pictures]
    duration = max(20, round(100.0 / rate) * 10)  # ms; the format counts hundredths of a second
    images[0].save(
        file.stream, "GIF", save_all=True, append_images=images[1:], duration=duration, loop=0, optimize=False
    )


def _write_mp4(file: OutputFile, pictures: Iterator[Pixels], rate: float, size: tuple[int, int]) -> None:
    """H.264 in MP4, by the ffmpeg that imageio-ffmpeg brings."""
    try:
        from imageio_ffmpeg import get_ffmpeg_exe
    except ImportError as problem:
        raise OutputError(
            f"{file.path}: an MP4 needs imageio-ffmpeg; pip install 'geomphys[video]', or write a .gif"
        ) from problem
    source = ["-f", "rawvideo", "-vcodec", "rawvideo", "-s", f"{size[0]}x{size[1]}", "-pix_fmt", "rgb24",
              "-r", str(Fraction(rate).limit_denominator()), "-i", "-"]  # fmt: skip
    result = ["-an", "-vcodec", "libx264", "-pix_fmt", "yuv420p", "-f", "mp4", "-crf", "20", "-preset", "medium",
              "-threads", "1", "-fflags", "+bitexact", "-flags:v", "+bitexact", "-movflags", "+faststart"]  # fmt: skip
    command = [get_ffmpeg_exe(), "-y", "-v", "error", *source, *result, str(file.temporary)]
    with TemporaryFile() as said:
        with Popen(ending_with_this_process(command), stdin=PIPE, stdout=DEVNULL, stderr=said) as process:
            try:
                assert process.stdin is not None
                with suppress(BrokenPipeError), process.stdin:  # it says why it reads no more
                    for pixels in pictures:
                        process.stdin.write(pixels.tobytes())
            except BaseException:
                process.kill()
                raise
        if process.returncode != 0:
            said.seek(0)
            reason = re.sub(r"^\[.*?\] ", "", said.read().decode(errors="replace").partition("\n")[0])
            raise OutputError(f"{file.path}: ffmpeg could not write it ({printable(reason)}); is the disk full?")
