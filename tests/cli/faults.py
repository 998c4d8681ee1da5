"""Replays that are killed: ``python faults.py LOG SCENE FOLDER TIMES SEED no|rrd``; forked from one that has loaded everything.

Prints a JSON line for each: the signal, the exit code, what was said, what lay in the folder before and lies there after.
"""

from __future__ import annotations

import json
import os
import random
import resource
import signal
import sys
import time
from pathlib import Path

from geomphys_cli.main import run


class Child:
    """A forked replay whose stderr is kept; files it writes can be limited to some bytes."""

    def __init__(self, words: list[str], limit: int | None = None) -> None:
        self._reading, writing = os.pipe()
        self.pid = os.fork()
        if self.pid:
            os.close(writing)
            return
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(writing, 2)
        if limit is not None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        code = 99
        try:
            code = run(words)
        finally:
            sys.stderr.flush()
            os._exit(code)

    def end(self) -> tuple[int, str]:
        """Wait; exit code (negative: the signal that killed it) and what was said."""
        with open(self._reading) as stream:
            said = stream.read()
        return os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1]), said


def main() -> None:
    """Kill `TIMES` replays at random moments, then run some against a full disk."""
    log, scene, folder, times, seed, rrd = sys.argv[1:]
    chance, out = random.Random(int(seed)), Path(folder, "out.mcap")
    kept = Path(folder, "kept")
    kept.mkdir()
    words = ["replay", log, "-s", scene, "-o", str(out), "--no-timing", "--quiet"]
    assert run(words) == 0  # loads all that the children need
    out.unlink()
    if rrd == "rrd":
        os.environ.setdefault("RUST_LOG", "off")
        import rerun  # only loaded: what it starts at the first recording is not there in a fork

        assert rerun
        words += ["--rrd", str(out.with_suffix(".rrd"))]
    begin = time.monotonic()
    assert Child(words).end() == (0, "")
    whole = time.monotonic() - begin
    for path in Path(folder).glob("out.*"):
        path.rename(kept / f"0.{path.name}")  # what a whole replay gives
    kinds = (signal.SIGINT, signal.SIGKILL, signal.SIGTERM)
    jobs: list[tuple[int | None, int | None]] = [(kinds[k % 3], None) for k in range(int(times))]
    # one moment in each of as many equal parts of a whole replay and a little more, in any order
    moments = [1.1 * (k + chance.random()) / int(times) for k in range(int(times))]
    chance.shuffle(moments)
    parts = iter(moments)
    jobs += [(None, size) for size in (0, 1, 4096, 60_000)] if rrd == "no" else []
    for number, limit in jobs:
        for path in Path(folder).glob("*out*"):
            if not path.name.startswith("."):  # what a kill left hidden is there at the next run
                path.unlink()
        before = sorted(path.name for path in Path(folder).glob("*out*"))
        child = Child(words, limit)
        if number is not None:
            part = next(parts)
            time.sleep(part * whole)
            os.kill(child.pid, number)
        code, said = child.end()
        left = {path.name: path.stat().st_size for path in Path(folder).glob("*out*")}
        fate = {"signal": number, "limit": limit, "code": code, "said": said, "before": before, "left": left}
        sys.stdout.write(json.dumps(fate) + "\n")
        sys.stdout.flush()
        for name in ("out.mcap", "out.partial.mcap", "out.rrd", "out.partial.rrd"):
            if name in left:
                Path(folder, name).rename(kept / f"{len(list(kept.iterdir()))}.{name}")


if __name__ == "__main__":
    main()
