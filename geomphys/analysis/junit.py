"""Writes claims on logs and whether they hold as JUnit XML, which CI systems show."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple
from xml.etree import ElementTree

from geomphys.storage.output_file import write_file
from geomphys.storage.remote_files import AnyPath


class Claim(NamedTuple):
    """A claim on a log."""

    log: str
    text: str  # such as "penetration at most 2 mm"
    failure: str  # what was found instead; "" where it holds


def write_junit(path: AnyPath, claims: Sequence[Claim], *, force: bool = False, inputs: Sequence[AnyPath] = ()) -> None:
    """Write one test case for each claim; raises OutputError."""
    failures = sum(bool(claim.failure) for claim in claims)
    suites = ElementTree.Element("testsuites")
    numbers = {"name": "geomphys audit", "tests": str(len(claims)), "failures": str(failures), "errors": "0"}
    suite = ElementTree.SubElement(suites, "testsuite", numbers)
    for claim in claims:
        case = ElementTree.SubElement(suite, "testcase", classname=_printable(claim.log), name=_printable(claim.text))
        if claim.failure:
            ElementTree.SubElement(case, "failure", message=_printable(claim.failure))
    ElementTree.indent(suites)
    data = ElementTree.tostring(suites, encoding="utf-8", xml_declaration=True) + b"\n"
    write_file(path, data, force=force, inputs=inputs)


def _printable(text: str) -> str:
    """Text without what XML cannot hold."""
    return "".join(c if c.isprintable() else "?" for c in text)
