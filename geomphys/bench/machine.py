"""Describes the computer a benchmark runs on and measures the time to compile the kernels."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from geomphys.errors import GeomphysError
from geomphys.jit.kernel import are_compiled
from geomphys.storage.child_process import available_cores, ending_with_this_process
from geomphys.storage.temporary_folders import TemporaryFolder

PACKAGES = ("numpy", "numba", "llvmlite", "mujoco", "coal", "python-fcl")
"""Packages whose versions are reported; those that are not installed are left out."""


@dataclass(frozen=True, kw_only=True)
class Machine:
    """The machine and the software of a run."""

    processor: str
    cores: int  # that this process may use
    memory_gib: float
    system: str
    python: str
    versions: dict[str, str]
    load: tuple[float, float, float]  # load averages over 1, 5 and 15 minutes at the start

    @property
    def is_busy(self) -> bool:
        """Whether other processes keep it busy, so that absolute times are too long."""
        return self.load[0] > 0.75 * self.cores


def describe_machine() -> Machine:
    """Describe this computer."""
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    pages, size = os.sysconf("SC_PHYS_PAGES"), os.sysconf("SC_PAGE_SIZE")
    return Machine(
        processor=_processor(),
        cores=available_cores(),
        memory_gib=round(pages * size / 2**30, 1),
        system=f"{platform.system()} {platform.release()} {platform.machine()}",
        python=platform.python_version(),
        versions=versions,
        load=os.getloadavg(),
    )


def _processor() -> str:
    """Name of the processor; of its architecture where the system does not report it."""
    listed = Path("/proc/cpuinfo")
    if listed.is_file():
        for line in listed.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def kernels_are_compiled() -> bool:
    """Whether the compiled frame step is in the cache already."""
    return are_compiled()


def compile_seconds() -> float:
    """Seconds until the first frame of a process that finds no compiled kernels: in a process and a cache of its own.

    Raises
    ------
    GeomphysError
        The process failed.
    """
    code = "from geomphys.bench.scaling import warm_up; print(warm_up())"
    with TemporaryFolder() as folder:
        environment = {**os.environ, "XDG_CACHE_HOME": str(folder)}
        done = subprocess.run(
            ending_with_this_process([sys.executable, "-c", code]),
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode != 0:
        raise GeomphysError(f"compiling in a process of its own failed: {done.stderr.strip().splitlines()[-1:]}")
    return float(done.stdout)
