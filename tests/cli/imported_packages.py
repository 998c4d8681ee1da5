"""Packages that a command imports."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence

from tests.house.sources import ROOT

CODE = (
    "import sys; from geomphys_cli.main import run; code = run(sys.argv[1:]); "
    "print(*{m.split('.')[0] for m in sys.modules}, file=sys.stderr); sys.exit(code)"
)


def imported_packages(words: Sequence[str]) -> set[str]:
    """Packages that a command line (without `geomphys`) imports in a process of its own. Its exit code has to be 0."""
    command = [sys.executable, "-c", CODE, *words]
    return set(subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stderr.split())
