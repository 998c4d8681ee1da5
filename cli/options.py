"""Options shared by commands, and checks of outputs before any work begins."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, TypeVar

import click

from geomphys.config import MAX_SECONDS, MAX_SEED, RATES_HZ

from .command import current_terminal

if TYPE_CHECKING:
    from geomphys.config import Config
    from geomphys.storage.remote_files import AnyPath

F = TypeVar("F", bound=Callable[..., Any])


class Number(click.FloatRange):
    """Parameter type of a number from `min` to `max`; NaN is in no range, though click lets it through."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number; usage error for one out of range."""
        number = float(super().convert(value, param, ctx))
        if math.isnan(number):
            self.fail(f"{value!r} is not in the range {self._describe_range()}.", param, ctx)
        return number


FILE_SUFFIXES = (".bag", ".csv", ".gz", ".json", ".mcap", ".parquet", ".rrd", ".xlsx", ".zip")
"""Suffixes (lower case) of files; no new folder is given such a name."""


class PathOrUrl(click.Path):
    """Parameter type of a local path or URL; inputs must exist, as with `click.Path`."""

    unchecked_suffix: str | None = None
    """Suffix of URLs whose existence is not checked."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path or URL as a path object; usage error where it does not exist."""
        if str(value) == "-" and not self.file_okay:
            self.fail("standard output is no folder; name one", param, ctx)
        suffix = PurePath(str(value)).suffix
        if not self.file_okay and suffix.lower() in FILE_SUFFIXES and not Path(str(value)).is_dir():
            self.fail(
                f"{value}: a folder is written there, and this is the name of a file; leave out {suffix}", param, ctx
            )
        if "://" not in str(value):
            return super().convert(value, param, ctx)
        from geomphys.errors import InputError
        from geomphys.storage.remote_files import as_path, is_remote

        try:
            path_like = as_path(value)
            if not is_remote(path_like):
                return super().convert(str(path_like), param, ctx)
            if self.exists and path_like.suffix != self.unchecked_suffix and not path_like.exists():
                self.fail(f"{path_like}: there is no such file", param, ctx)
            if not self.exists and not path_like.lists:
                self.fail(
                    f"{path_like}: a web server takes no files; write to a local path or a store such as s3://",
                    param,
                    ctx,
                )
        except InputError as problem:
            self.fail(str(problem), param, ctx)
        except OSError as problem:
            self.fail(f"{path_like}: cannot be reached ({problem.strerror})", param, ctx)
        return path_like


INPUT = PathOrUrl(exists=True, readable=True, path_type=Path)
INPUTS = PathOrUrl(exists=True, readable=True, path_type=Path)
INPUTS.unchecked_suffix = ".mcap"  # a missing log does not stop a batch
INPUT_FILE = PathOrUrl(exists=True, dir_okay=False, readable=True, path_type=Path)
LOCAL_FILE = click.Path(exists=True, dir_okay=False, readable=True, path_type=Path)
OUTPUT_FILE = PathOrUrl(dir_okay=False, path_type=Path)
OUTPUT_FOLDER = PathOrUrl(file_okay=False, path_type=Path)
SECONDS = Number(0.0, MAX_SECONDS)
HZ = Number(*RATES_HZ)
SEED = click.IntRange(0, MAX_SEED)
THRESHOLD = Number(0.0, 1e9)
COUNT = click.IntRange(1, 10_000)


def _combine_options(*options: Callable[[Any], Any]) -> Callable[[F], F]:
    """Return a decorator that adds the options in the order they are given."""

    def decorate(function: F) -> F:
        for option in reversed(options):
            function = option(function)
        return function

    return decorate


class _RequiredOption(click.Option):
    """A required option with its own message where it is missing."""

    def __init__(self, *args: Any, missing_message: str, **settings: Any) -> None:
        super().__init__(*args, required=True, **settings)
        self.missing_message = missing_message

    def process_value(self, ctx: click.Context, value: Any) -> Any:
        """Take the value; raises UsageError without one."""
        try:
            return super().process_value(ctx, value)
        except click.MissingParameter as error:
            raise click.UsageError(self.missing_message, ctx) from error


scene_option = click.option(
    "--scene",
    "-s",
    cls=_RequiredOption,
    missing_message="no scene: name its file with --scene; geomphys init LOG --urdf URDF writes a first one",
    type=INPUT_FILE,
    metavar="SCENE",
    help="The scene file (TOML).",
)

urdf_option = click.option(
    "--urdf",
    "urdfs",
    cls=_RequiredOption,
    missing_message="no avatar: name the URDF of the recorded hand or body with --urdf",
    type=LOCAL_FILE,
    multiple=True,
    metavar="URDF",
    help="An avatar; one option each.",
)

json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON, numbers in SI units.")

force_option = click.option("--force", "-f", is_flag=True, help="Overwrite outputs that exist.")


def picture_options(
    metavar: str, text: str, *, size: tuple[int, int], size_limit: int, size_text: str
) -> Callable[[F], F]:
    """Return what a command that draws an output takes: the output, the file to write, ``--focus`` and ``--size``."""
    return _combine_options(
        click.argument("result", metavar="OUT", type=INPUT_FILE),
        click.option("--output", "-o", "out", type=OUTPUT_FILE, required=True, metavar=metavar, help=text),
        click.option(
            "--focus", metavar="BODY", help="Body, avatar or object to look at. Default: what touches or was moved."
        ),
        click.option(
            "--size",
            type=click.IntRange(64, size_limit),
            nargs=2,
            default=size,
            show_default=True,
            metavar="W H",
            help=size_text,
        ),
    )


config_options = _combine_options(
    click.option(
        "--mode",
        type=click.Choice(["auto", "rigid", "chains"]),
        help="How avatars yield: as one rigid shape, or limb by limb; auto: limb by limb where joints move links that "
        "collide. Default: as the scene says, which by default is auto.",
    ),
    click.option(
        "--method",
        type=click.Choice(["exact", "paper"]),
        default="exact",
        show_default=True,
        help="exact: free of overlap, nothing is passed through; paper: the published method, a baseline that may miss "
        "collisions and leave overlap.",
    ),
    click.option(
        "--time",
        type=click.Choice(["header", "log", "publish"]),
        default="header",
        show_default=True,
        help="Which time of a message counts.",
    ),
    click.option("--clock", metavar="TOPIC", help="Topic whose messages are the frames. Default: the first avatar's."),
    click.option("--rate", type=HZ, metavar="HZ", help="Frames at a fixed rate."),
    click.option("--start", type=SECONDS, metavar="S", help="Begin S seconds after the first frame."),
    click.option("--end", type=SECONDS, metavar="S", help="End S seconds after the first frame."),
    click.option("--seed", type=SEED, default=0, show_default=True, help="Seed of everything random."),
    click.option(
        "--max-gap",
        type=SECONDS,
        default=0.1,
        show_default=True,
        metavar="S",
        help="Gaps of a stream up to this are interpolated, longer ones held.",
    ),
    click.option("--recover", is_flag=True, help="Replay what is readable of a damaged log."),
    click.option("--clamp-limits", is_flag=True, help="Clamp recorded angles to the limits of their joints."),
)
"""The options that make up a `Config`; hand them to `config_of`."""

written_options = _combine_options(
    click.option(
        "--no-timing", is_flag=True, help="No /timing channel, nor its plots: equal inputs then give equal bytes."
    ),
    click.option("--copy-input", is_flag=True, help="Copy the channels of the log into the output, below /input."),
    click.option("--ros2", is_flag=True, help="Write a ROS 2 bag: TFMessage, MarkerArray; for ros2 bag play and RViz."),
    click.option(
        "--fail-on-penetration",
        type=THRESHOLD,
        metavar="MM",
        help="End with exit code 4 if more than this overlap (mm) remains in any frame.",
    ),
)
"""Options of outputs, and of the overlap at which a replay fails."""


def config_of(options: dict[str, Any]) -> Config:
    """Take the options of `config_options` out of a command's options and return the `Config` they make."""
    from geomphys.config import Config

    names = ("mode", "method", "time", "clock", "rate", "start", "end", "seed", "max_gap", "recover", "clamp_limits")
    return Config(**{name: options.pop(name) for name in names})


def check_ending(path: Path | None, *endings: str) -> None:
    """Refuse, as wrong usage, an output whose name ends in none of `endings` (lower case, with a dot); ``-`` is no name."""
    if path is not None and str(path) != "-" and path.suffix.lower() not in endings:
        found = path.suffix or "no suffix"
        raise click.UsageError(
            f"{path}: ends in {found}; what is written there ends in {' or '.join(endings)}; choose another ending"
        )


def check_outputs(
    *paths: Path | None, force: bool, inputs: tuple[AnyPath | None, ...] = (), partial: bool = False
) -> None:
    """Refuse, as wrong usage, outputs that exist (without `force`), have no folder, are inputs, or one another.

    `partial`: the finished part of one may be left beside it.
    """
    outputs = [path for path in paths if path is not None]
    if not outputs:
        return
    from geomphys.errors import OutputError
    from geomphys.storage.output_file import check_targets, is_standard_output

    try:
        check_targets(outputs, force=force, inputs=[path for path in inputs if path is not None], partial=partial)
    except OutputError as problem:
        raise click.UsageError(str(problem)) from problem
    if any(map(is_standard_output, outputs)):
        current_terminal().results_to_stderr()


@contextmanager
def note_partial_outputs(*outputs: Path | None) -> Iterator[None]:
    """Add a note with the path of a partial output, if one was left, to an error raised in the block."""
    from geomphys.storage.output_file import partial_path

    partial_paths = [partial_path(path) for path in outputs if path is not None]
    states_before = [_state(path) for path in partial_paths]
    try:
        yield
    except BaseException as error:
        for path, state in zip(partial_paths, states_before, strict=True):
            if _state(path) not in (None, state):
                error.add_note(f"the finished part is in {path}")
        raise


def _state(path: AnyPath) -> tuple[int, int, int] | None:
    """Return inode, size and time of a file; None if it does not exist."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return None
    return status.st_ino, status.st_size, status.st_mtime_ns
