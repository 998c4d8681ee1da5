"""Times whole processes: a replay from the command line to its files on disk, and batches of short clips.

What a replay spends on frames is in its own ``/timing``. The rest is importing Python's modules, which Python itself times in
another run, and starting: Python, the kernels, the scene, what is known of the log beforehand, opening and closing the files.
"""

from __future__ import annotations

import os
import re
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from geomphys.bench.experiments import ExperimentFiles
from geomphys.bench.report import BatchTime, ProcessTime, Share
from geomphys.errors import GeomphysError
from geomphys.output.input_copy import MessageCopy
from geomphys.output.mcap_writer import McapWriter
from geomphys.output.output_log import open_output
from geomphys.recording.raw_messages import RawMessage
from geomphys.recording.reader import open_log
from geomphys.storage.child_process import ending_with_this_process
from geomphys.storage.temporary_folders import TemporaryFolder

STAGES = {"decode": "reading", "step": "computing", "encode": "writing"}
CLIP_NS = 5 * 10**9


def time_process(files: ExperimentFiles, repeats: int, *, rrd: bool) -> ProcessTime:
    """Time `geomphys replay` of an experiment with its log as the only output, or the viewer's recording too.

    The first run fills the caches and does not count; of the others the quickest does.

    Raises
    ------
    GeomphysError
        A replay failed.
    """
    with TemporaryFolder() as folder:
        out = folder / "out.mcap"
        command = ["replay", str(files.log), "--scene", str(files.scene), "-o", str(out), "--force", "--quiet"]
        command += ["--rrd", str(out.with_suffix(".rrd"))] if rrd else []
        runs = []
        for _ in range(repeats + 1):
            wall, cpu, _ = _run(command)
            runs.append((wall, cpu, _seconds_of_stages(out)))
        wall, cpu, stages = min(runs[1:])
        frames = open_output(out)
        recorded = (frames.time_of(frames.frame_count - 1) - frames.time_of(0)) * 1e-9
        importing = min(_seconds_of_imports(command) for _ in range(repeats))
        shares = [
            Share(name="starting", seconds=wall - importing - sum(stages.values())),
            Share(name="importing", seconds=importing),
        ]
        shares += [Share(name=STAGES[name], seconds=seconds) for name, seconds in stages.items()]
        return ProcessTime(
            name=f"{files.name}, {'MCAP and rerun' if rrd else 'MCAP'}",
            frames=frames.frame_count,
            recorded_s=recorded,
            wall_s=wall,
            cpu_s=cpu,
            shares=tuple(shares),
        )


def time_batches(
    files: ExperimentFiles, clips: int, jobs: Sequence[int], done: Callable[[], None] = lambda: None
) -> list[BatchTime]:
    """Time `geomphys batch` of clips of 5 s that are cut from an experiment's log, with so many jobs each.

    Raises
    ------
    GeomphysError
        A batch failed.
    """
    with TemporaryFolder() as folder:
        logs = folder / "clips"
        recorded = cut_clips(files.log, logs, clips)
        found = []
        for count in jobs:
            out = folder / f"out{count}"
            wall, cpu, _ = _run(
                ["batch", str(logs), "--scene", str(files.scene), "-O", str(out), "--jobs", str(count), "--quiet"]
            )
            shutil.rmtree(out)
            found.append(BatchTime(clips=clips, jobs=count, recorded_s=recorded, wall_s=wall, cpu_s=cpu))
            done()
        return found


def cut_clips(log: Path, folder: Path, count: int) -> float:
    """Cut a log into clips of 5 s, over and over until there are `count`; returns the seconds recorded in all of them."""
    folder.mkdir()
    with open_log(log, recover=False) as reader:
        parts: list[list[RawMessage]] = []
        for message in reader.read():
            number = (message.log_time - reader.start_ns) // CLIP_NS
            while len(parts) <= number:
                parts.append([])
            parts[number].append(message)
        channels = reader.channels
    parts = [part for part in parts if part and _span_ns(part) > CLIP_NS // 2]
    for number, part in enumerate(parts[:count]):
        with (folder / f"clip_{number:05}.mcap").open("wb") as stream:
            writer, messages = McapWriter(stream), MessageCopy(channels)
            writer.start(profile="", library="geomphys bench")
            for message in part:
                messages.add(message, writer)
            writer.finish()
    for number in range(len(parts), count):
        shutil.copyfile(folder / f"clip_{number % len(parts):05}.mcap", folder / f"clip_{number:05}.mcap")
    return sum(_span_ns(parts[number % len(parts)]) * 1e-9 for number in range(count))


def _span_ns(messages: Sequence[RawMessage]) -> int:
    """Time from the first to the last of messages in their order."""
    return messages[-1].log_time - messages[0].log_time


def _run(arguments: Sequence[str], *settings: str) -> tuple[float, float, str]:
    """Wall and processor seconds of a command with all its processes, which may keep the bytecode of modules; what it said.

    `settings` are Python's own.
    """
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    # an installed package has it: without it a start takes twice as long
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        ending_with_this_process([sys.executable, *settings, "-m", "geomphys", *arguments]),
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != 0:
        raise GeomphysError(f"geomphys {arguments[0]} failed: {done.stderr.strip().splitlines()[-1:]}")
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stderr


def _seconds_of_imports(command: Sequence[str]) -> float:
    """Seconds that a command takes to import modules, those of Python's own start included."""
    said = _run(command, "-X", "importtime")[2]
    return sum(map(int, re.findall(r"^import time: +(\d+) \|", said, re.MULTILINE))) * 1e-6


def _seconds_of_stages(out: Path) -> dict[str, float]:
    """Seconds that a replay's frames took to read, compute and write."""
    timing = open_output(out).timing()
    return {name: float(timing[name].ns.sum()) * 1e-9 for name in STAGES}
