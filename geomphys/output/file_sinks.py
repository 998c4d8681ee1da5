"""Registry of the sinks that write a file, by the suffix of the file's name.

A new file format is one sink class and one function here, decorated with `file_sink`. The class is imported inside the
function, so that a replay loads only the libraries of the formats it writes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from geomphys.output.sink import Sink
from geomphys.storage.remote_files import AnyPath


class FileSinkOptions(NamedTuple):
    """Options of a replay that concern the files it writes; a sink takes those that apply to its format."""

    force: bool = False  # replace a file that exists
    timing: bool = True  # write stage times, the only content that differs between two runs
    copied_log: AnyPath | None = None  # log whose channels are copied into the output
    ros2: bool = False  # write MCAP that ROS 2 tools read


SinkFactory = Callable[[AnyPath, FileSinkOptions], Sink]

FILE_SINKS: dict[str, SinkFactory] = {}
"""Suffix with its dot, in lower case -> function that makes the sink of a path."""


def file_sink(suffix: str) -> Callable[[SinkFactory], SinkFactory]:
    """Register the decorated function as the factory of sinks that write files named ``*SUFFIX``."""

    def register(factory: SinkFactory) -> SinkFactory:
        FILE_SINKS[suffix] = factory
        return factory

    return register


def make_file_sink(path: AnyPath, options: FileSinkOptions, *, default: str) -> Sink:
    """Make the sink that writes `path`, by its suffix; a suffix that is not registered is written as `default`."""
    return FILE_SINKS.get(path.suffix.lower(), FILE_SINKS[default])(path, options)


@file_sink(".mcap")
def _mcap(path: AnyPath, options: FileSinkOptions) -> Sink:
    if options.ros2:
        from geomphys.output.ros2_sink import Ros2Sink

        return Ros2Sink(path, force=options.force)
    from geomphys.output.mcap_sink import McapSink

    return McapSink(path, force=options.force, timing=options.timing, copy_input=options.copied_log)


@file_sink(".rrd")
def _rerun(path: AnyPath, options: FileSinkOptions) -> Sink:
    from geomphys.output.rerun_sink import RerunSink

    return RerunSink(path, force=options.force, timing=options.timing)
