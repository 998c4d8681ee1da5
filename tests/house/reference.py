"""Writes the reference of the command line from the help texts: ``python tests/house/reference.py``."""

from __future__ import annotations

import sys
from pathlib import Path

from click.testing import CliRunner

ROOT = Path(__file__).resolve().parents[2]
REFERENCE = ROOT / "assets" / "docs" / "cli.md"

HEAD = """# The command line

Written by `python tests/house/reference.py` from the help texts: this is what `geomphys COMMAND -h` says.

Results go to stdout, everything else to stderr. Exit codes: 0 done, 1 failed (a log or scene that is wrong), 2 wrong usage
(options, a path that does not exist, an output that exists without `--force`), 3 some inputs failed, 4 a threshold was broken,
130 interrupted, 143 terminated. `geomphys diff`: 0 same, 1 different, 2 trouble.
"""


def reference() -> str:
    """The page as it should be."""
    from geomphys_cli.main import COMMANDS, cli

    def help_of(*words: str) -> str:
        done = CliRunner().invoke(cli, [*words, "-h"], prog_name="geomphys", terminal_width=100)
        assert done.exit_code == 0, done.output
        return "\n".join(line.rstrip() for line in done.output.rstrip().splitlines())

    sections = [("geomphys", help_of()), *((f"geomphys {name}", help_of(name)) for name in COMMANDS)]
    return HEAD + "".join(f"\n## {title}\n\n```text\n{text}\n```\n" for title, text in sections)


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    REFERENCE.write_text(reference())
