"""Velocities at the contacts of the coupled solve, and what an impulse there changes: of bodies and of unknowns."""

from __future__ import annotations

from geomphys.engine.coupled_state import Coupled
from geomphys.jit.kernel import kernel
from geomphys.numerics.row_vectors import set_vec, vec_of
from geomphys.numerics.vec3 import Vec, dot
from geomphys.simulated.contact_points import apply_impulses, invert_mass, speed_at
from geomphys.simulated.state import Contact, Simulation


@kernel
def relative_velocity(sim: Simulation, c: Coupled, r: Contact) -> Vec:
    """Relative velocity at a contact along its normal, tangent and binormal [m/s]."""
    v = speed_at(sim.velocity, r, r.a, r.b)
    n = dot(vec_of(r.normal), v) + r.prescribed[0]
    t = dot(vec_of(r.tangent), v) + r.prescribed[1]
    b = dot(vec_of(r.binormal), v) + r.prescribed[2]
    for e in range(r.first_effect, r.end_effect):
        effect = c.effects[e]
        u = c.unknowns[effect.unknown].new_rate
        n, t, b = n + effect.jacobian[0] * u, t + effect.jacobian[1] * u, b + effect.jacobian[2] * u
    return n, t, b


@kernel
def apply(sim: Simulation, c: Coupled, r: Contact, j: Vec) -> None:
    """Apply impulses j [N s] along normal, tangent and binormal of a contact to bodies and unknowns."""
    apply_impulses(sim, r, j)
    for e in range(r.first_effect, r.end_effect):
        effect = c.effects[e]
        c.unknowns[effect.unknown].new_rate += dot(vec_of(effect.response), j)


@kernel
def add_responses(sim: Simulation, c: Coupled, r: Contact) -> None:
    """Add the responses of unknowns to those of a contact, which are of its simulated bodies."""
    nn, nt, nb, tt, tb, bb = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for e in range(r.first_effect, r.end_effect):
        effect = c.effects[e]
        light = c.unknowns[effect.unknown].inverse_mass
        n, t, b = vec_of(effect.jacobian)
        set_vec(effect.response, (n * light, t * light, b * light))
        nn, tt, tb, bb = nn + n * n * light, tt + t * t * light, tb + t * b * light, bb + b * b * light
        nt, nb = nt + n * t * light, nb + n * b * light
    r.inverse_mass_n += nn
    r.inverse_mass_t[0] += tt
    r.inverse_mass_t[1] += tb
    r.inverse_mass_t[2] += bb
    r.inverse_mass_nt[0] += nt
    r.inverse_mass_nt[1] += nb
    invert_mass(r)


@kernel
def set_inequality_response(c: Coupled, k: int) -> None:
    """Set the response of inequality k to a unit impulse."""
    g, total = c.inequalities[k], 0.0
    for e in range(g.first_effect, g.end_effect):
        effect = c.effects[e]
        total += effect.jacobian[0] ** 2 * c.unknowns[effect.unknown].inverse_mass
    g.response = total


@kernel
def add_impulse(c: Coupled, k: int, change: float) -> None:
    """Add to the impulse of inequality k."""
    g = c.inequalities[k]
    if change == 0.0:
        return
    g.impulse += change
    for e in range(g.first_effect, g.end_effect):
        effect = c.effects[e]
        x = c.unknowns[effect.unknown]
        x.new_rate += effect.jacobian[0] * x.inverse_mass * change


@kernel
def inequality_rate(c: Coupled, k: int) -> float:
    """Rate of the clearance of inequality k [m/s or rad/s]."""
    g = c.inequalities[k]
    v = g.prescribed
    for e in range(g.first_effect, g.end_effect):
        effect = c.effects[e]
        v += effect.jacobian[0] * c.unknowns[effect.unknown].new_rate
    return float(v)


@kernel
def impulse_vector(r: Contact) -> Vec:
    """World friction impulse of a contact [N s]."""
    t, b, x, y = vec_of(r.tangent), vec_of(r.binormal), r.tangent_impulse[0], r.tangent_impulse[1]
    return (x * t[0] + y * b[0], x * t[1] + y * b[1], x * t[2] + y * b[2])
