"""Driven bodies as they want to move: with the mass of their coupling, and pushed back by what they hit.

Where a driven body goes in the frame is settled before simulated bodies move: its path. What it wants is another
thing: a hand that a ball holds back stands still and wants to go on. Collisions are with the wish; the recoil is taken
off it at once, off all links of the tree, which move together, and given to the coupling by the caller.
"""

from __future__ import annotations

from geomphys.jit.addresses import float_at, int_at, set_float
from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import Vec, add, cross, quat_rotate, sub
from geomphys.scene.arrays import DRIVEN
from geomphys.simulated.cells import add_vec, set_vec, vec_at
from geomphys.simulated.contact_points import invert_mass
from geomphys.simulated.motion import load_velocities, turn_at
from geomphys.simulated.state import (
    AT_RECOIL,
    AT_TOLD,
    AT_VELOCITY,
    LIGHTNESS,
    MASS,
    MASS_N,
    MASS_T,
    N_ROWS,
    RATE,
    ROLE,
    ROW_A,
    ROW_B,
    SPEED,
    TREE,
    WISH_ARM,
    entry,
    has_changed,
    how_many,
    kind_of,
    motion_of,
    owner,
    row,
    velocity_of,
)


@kernel
def wish(sim: int, body: int, t: float) -> Vec:
    """Velocity that a driven body's origin wants to have [m/s], less what recoil has taken."""
    m, told = motion_of(sim, body), velocity_of(entry(sim, AT_TOLD), body)
    arm = quat_rotate(turn_at(m, t), vec_at(m, WISH_ARM))
    v = sub(vec_at(told, 0), cross(vec_at(told, 3), arm))
    return add(v, vec_at(entry(sim, AT_RECOIL), 3 * int_at(kind_of(sim, body), TREE)))


@kernel
def meets_driven(sim: int, k: int) -> bool:
    """Whether row k is one of a changed body with a driven one."""
    o = owner(sim, k)
    return has_changed(sim, int_at(o, ROW_A)) and int_at(kind_of(sim, int_at(o, ROW_B)), ROLE) == DRIVEN


@kernel
def lighten(sim: int, k: int, by: float) -> None:
    """Add an inverse mass [1/kg] to what impulses do at row k."""
    r = row(sim, k)
    set_float(r, MASS_N, float_at(r, MASS_N) + by)
    set_float(r, MASS_T, float_at(r, MASS_T) + by)
    set_float(r, MASS_T + 2, float_at(r, MASS_T + 2) + by)
    invert_mass(r)


@kernel
def follow_wishes(sim: int, t: float) -> bool:
    """Give the driven bodies that changed bodies touch their mass and the velocities they want at time `t`.

    Returns whether there are any. `follow_paths` undoes it.
    """
    found = False
    for k in range(how_many(sim, N_ROWS)):
        if meets_driven(sim, k):
            found = True
            b = int_at(owner(sim, k), ROW_B)
            light = 1.0 / float_at(motion_of(sim, b), MASS)
            set_float(motion_of(sim, b), LIGHTNESS, light)
            lighten(sim, k, light)
    if found:
        load_wishes(sim, t)
    return found


@kernel
def load_wishes(sim: int, t: float) -> None:
    """Write what the driven bodies that changed bodies touch want to the velocities being solved for."""
    for k in range(how_many(sim, N_ROWS)):
        if meets_driven(sim, k):
            b = int_at(owner(sim, k), ROW_B)
            v = velocity_of(entry(sim, AT_VELOCITY), b)
            set_vec(v, 0, wish(sim, b, t))
            set_vec(v, 3, vec_at(velocity_of(entry(sim, AT_TOLD), b), 3))


@kernel
def reload(sim: int, t: float, wishes: bool) -> None:
    """Write the velocities that bodies have before what is being solved."""
    load_velocities(sim)
    if wishes:
        load_wishes(sim, t)


@kernel
def is_first_of(sim: int, k: int) -> bool:
    """Whether row k is the first with its body b among those with driven ones."""
    for i in range(k):  # noqa: SIM110
        if meets_driven(sim, i) and int_at(owner(sim, i), ROW_B) == int_at(owner(sim, k), ROW_B):
            return False
    return True


@kernel
def take_recoil(sim: int, t: float) -> None:
    """Take from the wishes what the velocities being solved for have lost, each body's from those of its whole tree."""
    for k in range(how_many(sim, N_ROWS)):
        if meets_driven(sim, k) and is_first_of(sim, k):
            b = int_at(owner(sim, k), ROW_B)
            v = velocity_of(entry(sim, AT_VELOCITY), b)
            set_vec(v, 0, sub(vec_at(v, 0), wish(sim, b, t)))
    for k in range(how_many(sim, N_ROWS)):
        if meets_driven(sim, k) and is_first_of(sim, k):
            b = int_at(owner(sim, k), ROW_B)
            lost = vec_at(velocity_of(entry(sim, AT_VELOCITY), b), 0)
            add_vec(entry(sim, AT_RECOIL), 3 * int_at(kind_of(sim, b), TREE), lost, 1.0)
    load_wishes(sim, t)


@kernel
def follow_paths(sim: int) -> None:
    """Let driven bodies follow their paths again, whatever pushes them."""
    for k in range(how_many(sim, N_ROWS)):
        if meets_driven(sim, k):
            b = int_at(owner(sim, k), ROW_B)
            m, v = motion_of(sim, b), velocity_of(entry(sim, AT_VELOCITY), b)
            lighten(sim, k, -1.0 / float_at(m, MASS))
            set_float(m, LIGHTNESS, 0.0)
            set_vec(v, 0, vec_at(m, SPEED))
            set_vec(v, 3, vec_at(m, RATE))
