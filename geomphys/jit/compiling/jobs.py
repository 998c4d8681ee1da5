"""The two jobs of compiling: sketch a kernel, and make a unit of sketches. Any process can do them, in any order."""

from __future__ import annotations

from typing import NamedTuple

from geomphys.jit.compiling.keys import Key, symbol_of
from geomphys.jit.compiling.parts import Part
from geomphys.jit.compiling.sketches import kernel_of
from geomphys.jit.compiling.units import Unit, find_unit, make_unit


class Sketch(NamedTuple):
    """Sketch a kernel."""

    key: Key

    def find(self) -> Part | Unit | None:
        """The sketch, if there is one; for an outlined kernel that has been compiled already the unit will do."""
        kernel = kernel_of(self.key)
        return (find_unit(self.key) if kernel.outlined else None) or kernel.find_part(self.key.types)

    def make(self) -> Part | Unit:
        """Do it."""
        return kernel_of(self.key).part(self.key.types)


class Compile(NamedTuple):
    """Make a unit of an outlined kernel, once everything it needs is sketched."""

    key: Key

    def find(self) -> Part | Unit | None:
        """The unit, if there is one."""
        return find_unit(self.key)

    def make(self) -> Part | Unit:
        """Do it."""
        return make_unit(self.key)


Job = Sketch | Compile


def next_sketches(product: Part | Unit) -> list[Job]:
    """What has to be sketched for the units a sketch or a unit needs."""
    return [Sketch(key) for key in (product.callees() if isinstance(product, Unit) else product.parts + product.units)]


def name_of(job: Job) -> str:
    """What tells jobs of a kind apart."""
    return symbol_of(job.key)
