"""The table of inputs in assets/docs/your_recording.md: run this file to bring it up to date."""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from geomphys.recording.message_kinds import ENCODINGS, KINDS  # noqa: E402
from geomphys.recording.samples import CONTENT_NAMES, PART_PLACEHOLDERS  # noqa: E402

DOCUMENT = ROOT / "assets/docs/your_recording.md"
TABLE = re.compile(r"(?<=<!-- inputs -->\n).*?(?=<!-- end of inputs -->)", re.DOTALL)
FOLLOWED = {
    "glove": "`topic`, `topic#left`",
    "transform": "`topic`, `topic#CHILD_FRAME`",
    **{content: f"`topic#{part}`" for content, part in PART_PLACEHOLDERS.items()},
}


def table() -> str:
    """One row for each way to be followed and set of encodings, in the order of the table in the code."""
    rows: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for kind in KINDS:
        names = [f"`{name.replace('/msg/', '/')}`" for name in kind.names]
        rows.setdefault((kind.content, kind.encodings), []).extend(names)
    lines = ["| holds | types | read in | followed as |", "|---|---|---|---|"]
    for (content, encodings), names in sorted(rows.items(), key=lambda item: list(CONTENT_NAMES).index(item[0][0])):
        spelled = ", ".join(ENCODINGS[e] for e in encodings)
        lines.append(
            f"| {CONTENT_NAMES[content]} | {', '.join(names)} | {spelled} | {FOLLOWED.get(content, '`topic`')} |"
        )
    return "\n".join(lines) + "\n"


def with_table(text: str) -> str:
    """The document with its table made anew."""
    return TABLE.sub(lambda _: table(), text)


if __name__ == "__main__":
    DOCUMENT.write_text(with_table(DOCUMENT.read_text()))
