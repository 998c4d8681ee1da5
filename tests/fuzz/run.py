"""Fuzzes every loader for some seconds of processor time: ``python -m tests.fuzz.run SECONDS [TARGET…]``, or ``make fuzz``.

Each target runs in a process of its own, driven by coverage (atheris). What raises anything but the errors of the
package, takes more processor time than `seconds_for` its bytes, or more than `MEGABYTES`, is written to ``out/fuzz/``,
once for each place in the code; with findings the exit code is 1. A finding is mended, and its file kept in the corpus,
which the tests replay.
"""

from __future__ import annotations

import hashlib
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from pathlib import Path
from types import FrameType

CORPUS = Path(__file__).with_name("corpus")
FOUND = Path("out/fuzz")
CPU_SECONDS = 1.0
CPU_PER_BYTE = 100e-6
"""s of processor time that an input may take, and for each byte of it more; on an idle machine a twentieth is used."""
MEGABYTES = 512
"""What one input may take beyond what the process has already."""
LONGEST = 1 << 16
"""bytes of an input"""
LIBRARIES = ["geomphys", "mcap", "mcap_ros2", "mcap_protobuf", "tomllib", "yourdfpy", "trimesh", "yaml", "json"]


def seconds_for(size: int) -> float:
    """The processor time that an input of some bytes may take, s."""
    return CPU_SECONDS + CPU_PER_BYTE * size


class TooLongError(BaseException):
    """An input took too long."""


def peak_mb() -> int:
    """The most memory this process has had since `forget_peak`, MiB."""
    found = re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())
    assert found is not None
    return int(found[1]) // 1024


def forget_peak() -> None:
    """Let the peak begin anew."""
    Path("/proc/self/clear_refs").write_text("5")


def too_long(signum: int, frame: FrameType | None) -> None:
    """Answer of the alarm."""
    raise TooLongError("took more time than its bytes allow")


def place_of(error: BaseException) -> str:
    """Kind of an error and the last places of the code it went through, which tell it from others."""
    steps = traceback.extract_tb(error.__traceback__)[-3:]
    return " < ".join([type(error).__name__, *(f"{Path(s.filename).name}:{s.lineno}" for s in reversed(steps))])


def fuzz(name: str, seconds: int) -> None:
    """Fuzz a target in this process; never returns."""
    import atheris  # type: ignore[import-not-found]

    with atheris.instrument_imports(include=LIBRARIES):
        from tests.fuzz.targets import TARGETS

        target = TARGETS[name]
    for path in sorted((CORPUS / name).iterdir()):  # imports all that is imported on use
        with atheris.instrument_imports(include=LIBRARIES), tempfile.TemporaryDirectory() as folder:
            target(path.read_bytes(), Path(folder))
    seen: set[str] = set()
    signal.signal(signal.SIGVTALRM, too_long)
    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    forget_peak()
    before, runs, end = [peak_mb()], [0], time.process_time() + seconds

    def keep(data: bytes, what: str, text: str) -> None:
        if what in seen:
            return
        seen.add(what)
        FOUND.mkdir(parents=True, exist_ok=True)
        file = FOUND / f"{name}-{hashlib.sha256(data).hexdigest()[:8]}"
        file.write_bytes(data)
        file.with_suffix(".txt").write_text(text)
        sys.stdout.write(f"FOUND {file}: {what}\n")
        sys.stdout.flush()

    def one(data: bytes) -> None:
        runs[0] += 1
        if time.process_time() > end:
            sys.stdout.write(f"RUNS {runs[0]}\n")
            sys.stdout.flush()
            os._exit(0)
        signal.setitimer(signal.ITIMER_VIRTUAL, seconds_for(len(data)))
        try:
            target(data, folder)
        except (Exception, TooLongError) as error:
            keep(data, place_of(error), traceback.format_exc())
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        now = peak_mb()
        if now > before[0] + MEGABYTES:
            keep(data, f"{now - before[0]} MiB", "")
        if now > before[0] + 64:
            forget_peak()
            before[0] = peak_mb()

    grown = Path(tempfile.mkdtemp(prefix=f"fuzz-{name}-"))
    options = [f"-max_len={LONGEST}", "-timeout=300", "-rss_limit_mb=2048", "-seed=1",
               f"-artifact_prefix={FOUND.resolve()}/{name}-"]  # fmt: skip
    FOUND.mkdir(parents=True, exist_ok=True)
    atheris.Setup([sys.argv[0], *options, str(grown), str(CORPUS / name)], one)
    atheris.Fuzz()


def main() -> int:
    """Fuzz the targets one after the other."""
    if sys.argv[1] == "--here":
        fuzz(sys.argv[2], int(sys.argv[3]))
    names = sys.argv[2:] or sorted(path.name for path in CORPUS.iterdir())
    each = max(1, int(sys.argv[1]) // len(names))
    bad = 0
    for name in names:
        start = time.monotonic()
        words = [sys.executable, "-m", "tests.fuzz.run", "--here", name, str(each)]
        outcome = subprocess.run(words, capture_output=True, text=True, errors="replace", env={**os.environ})
        found = [line for line in outcome.stdout.splitlines() if line.startswith("FOUND")]
        runs = re.search(r"RUNS (\d+)", outcome.stdout)
        covered = re.findall(r"cov: (\d+)", outcome.stderr)
        said = f"{runs[1]} inputs" if runs else f"ended with {outcome.returncode}: {outcome.stderr[-1500:]}"
        seconds = time.monotonic() - start
        sys.stdout.write(f"{name}: {said} in {seconds:.0f} s, cover {covered[-1] if covered else '?'}\n")
        sys.stdout.write("".join(f"  {line}\n" for line in found))
        sys.stdout.flush()
        bad += len(found) + (runs is None)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
