"""How names that come from a log are told: in one line, not too long, not too many, with what was probably meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

LENGTH = 80  # characters of a name
COUNT = 20  # names of a list
KEPT = 10_000  # names of a topic that are remembered, but for those of one more message
COMPARED = 2000  # names among which a similar one is looked for


def plain(name: str) -> str:
    r"""Return a name whose line ends and control characters became ``\n``, ``\x1b`` …, cut if it is very long."""
    cut = name if len(name) <= LENGTH else name[:LENGTH] + "…"
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "backslashreplace").decode() for c in cut)


def listed(names: Sequence[str], count: int = COUNT) -> str:
    """Names with commas between them, the first `count` of them; "none" if there are none."""
    told = ", ".join(plain(n) for n in names[:count])
    return (told + (f" and {len(names) - count} more" if len(names) > count else "")) or "none"


def add_names(known: set[str], names: Iterable[str]) -> None:
    """Add names to those that are known, unless these are absurdly many already."""
    if len(known) < KEPT:
        known.update(names)


def closest(name: str, names: Iterable[str]) -> str:
    """The known name that was probably meant, "" if none is like it."""
    near = difflib.get_close_matches(name[:LENGTH], list(names)[:COMPARED], n=1, cutoff=0.6)
    return near[0] if near else ""


def similar(name: str, names: Iterable[str]) -> str:
    """Say which known name was probably meant: " (did you mean 'x'?)" or ""."""
    near = closest(name, names)
    return f" (did you mean '{plain(near)}'?)" if near else ""
