"""Prints names from a log safely: escaped, shortened, listed up to a limit, with the closest known name."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

MAX_LENGTH = 80  # characters of a name
MAX_LISTED = 20  # names of a list
MAX_REMEMBERED = 10_000  # names of a topic that are remembered, but for those of one more message
MAX_COMPARED = 2000  # names that are compared with an unknown one


def printable(name: str) -> str:
    r"""Return a name with line ends and control characters escaped (``\n``, ``\x1b``), truncated to `MAX_LENGTH`."""
    shortened = name if len(name) <= MAX_LENGTH else name[:MAX_LENGTH] + "…"
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "backslashreplace").decode() for c in shortened)


def join_names(names: Sequence[str], count: int = MAX_LISTED) -> str:
    """Names with commas between them, the first `count` of them; "none" if there are none."""
    text = ", ".join(printable(n) for n in names[:count])
    return (text + (f" and {len(names) - count} more" if len(names) > count else "")) or "none"


def add_names(known: set[str], names: Iterable[str]) -> None:
    """Add names to those that are known, unless these are absurdly many already."""
    if len(known) < MAX_REMEMBERED:
        known.update(names)


def closest_name(name: str, names: Iterable[str]) -> str:
    """The closest of some names, "" if none is similar."""
    matches = difflib.get_close_matches(name[:MAX_LENGTH], list(names)[:MAX_COMPARED], n=1, cutoff=0.6)
    return matches[0] if matches else ""


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """Say which known name was probably meant: " (did you mean 'x'?)" or ""."""
    matches = closest_name(name, names)
    return f" (did you mean '{printable(matches)}'?)" if matches else ""
