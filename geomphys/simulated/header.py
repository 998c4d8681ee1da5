"""Filling the header that the kernels of the simulated loop are handed."""

from __future__ import annotations

from geomphys.collision.scratch import Scratch, room_of
from geomphys.collision.support import shapes_of
from geomphys.jit.addresses import address, set_float, set_int
from geomphys.jit.kernel import inlined, kernel
from geomphys.scene.arrays import Floats, Pieces
from geomphys.simulated.cells import set_vec
from geomphys.simulated.state import (
    AT_ARM,
    AT_BALLS,
    AT_BODY_BOXES,
    AT_BOXES,
    AT_COUNT,
    AT_COUNTS,
    AT_DRIVEN_IMPULSE,
    AT_DT,
    AT_END,
    AT_ENERGY,
    AT_FACES,
    AT_FOUND,
    AT_FRAMES,
    AT_FREE,
    AT_GAP,
    AT_HEAP,
    AT_HEFT,
    AT_KEPT,
    AT_KINDS,
    AT_LOCAL,
    AT_LOCAL_BOXES,
    AT_MATERIAL_COUNT,
    AT_MATERIALS,
    AT_MOTION,
    AT_OLD_KEPT,
    AT_OLD_PAIRS,
    AT_OLD_SLOTS,
    AT_OTHER_COUNT,
    AT_OTHERS,
    AT_PAIR_ROOM,
    AT_PAIRS,
    AT_PATH_COUNT,
    AT_PATHS,
    AT_POINTS,
    AT_RECOIL,
    AT_ROOM,
    AT_ROW_OF,
    AT_ROW_ROOM,
    AT_ROWS,
    AT_SHAPES,
    AT_SHOVE,
    AT_START,
    AT_STILL,
    AT_STILL_COUNT,
    AT_STILL_LOW,
    AT_TOLD,
    AT_TREE_COUNT,
    AT_VELOCITY,
    AT_WIDEST,
    GRAVITY,
    SimulatedState,
)


@inlined
def header_of_state(state: SimulatedState) -> int:
    """Write what stands in the state itself to its header; returns the header's address."""
    sim = address(state.header)
    set_int(sim, AT_MOTION, address(state.motion))
    set_int(sim, AT_KINDS, address(state.kinds))
    set_int(sim, AT_ROWS, address(state.rows))
    set_int(sim, AT_ROW_OF, address(state.row_of))
    set_int(sim, AT_PAIRS, address(state.pairs))
    set_int(sim, AT_KEPT, address(state.kept))
    set_int(sim, AT_COUNTS, address(state.counts))
    set_int(sim, AT_VELOCITY, address(state.velocity))
    set_int(sim, AT_FREE, address(state.free))
    set_int(sim, AT_COUNT, len(state.free))
    set_int(sim, AT_PATHS, address(state.paths))
    set_int(sim, AT_PATH_COUNT, len(state.paths))
    set_int(sim, AT_STILL, address(state.still))
    set_int(sim, AT_STILL_LOW, address(state.still_low))
    set_int(sim, AT_STILL_COUNT, len(state.still))
    set_int(sim, AT_OTHERS, address(state.others))
    set_int(sim, AT_OTHER_COUNT, len(state.others))
    set_int(sim, AT_ARM, address(state.arm))
    set_int(sim, AT_BOXES, address(state.boxes))
    set_int(sim, AT_BODY_BOXES, address(state.body_boxes))
    set_int(sim, AT_LOCAL_BOXES, address(state.local_boxes))
    set_int(sim, AT_BALLS, address(state.balls))
    set_int(sim, AT_MATERIALS, address(state.materials))
    set_int(sim, AT_MATERIAL_COUNT, state.materials.shape[1])
    set_int(sim, AT_OLD_PAIRS, address(state.old_pairs))
    set_int(sim, AT_OLD_KEPT, address(state.old_kept))
    set_int(sim, AT_PAIR_ROOM, len(state.pairs))
    set_int(sim, AT_ROW_ROOM, len(state.rows))
    set_int(sim, AT_SHOVE, address(state.shove))
    set_int(sim, AT_HEFT, address(state.heft))
    set_int(sim, AT_ENERGY, address(state.energy))
    set_int(sim, AT_RECOIL, address(state.recoil))
    set_int(sim, AT_TREE_COUNT, len(state.recoil))
    set_int(sim, AT_HEAP, address(state.heap))
    set_int(sim, AT_FOUND, address(state.found))
    set_int(sim, AT_POINTS, address(state.points))
    set_int(sim, AT_OLD_SLOTS, address(state.old_slots))
    set_float(sim, AT_WIDEST, state.widest)
    set_vec(sim, GRAVITY, (state.gravity[0], state.gravity[1], state.gravity[2]))
    return sim


@inlined
def header_of(
    pieces: Pieces, state: SimulatedState, start: Floats, end: Floats, told: Floats, driven_impulse: Floats,
    frames: Floats, dt: float, gap: float, scratch: Scratch,
) -> int:  # fmt: skip
    """Fill the header for a frame; returns its address, good for as long as all the arrays are."""
    sim = header_of_state(state)
    set_int(sim, AT_START, address(start))
    set_int(sim, AT_END, address(end))
    set_int(sim, AT_TOLD, address(told))
    set_int(sim, AT_DRIVEN_IMPULSE, address(driven_impulse))
    set_int(sim, AT_LOCAL, address(pieces.local))
    set_int(sim, AT_FRAMES, address(frames))
    set_float(sim, AT_DT, dt)
    set_float(sim, AT_GAP, gap)
    s = shapes_of(pieces, frames)
    set_ints(sim, AT_SHAPES, s.kind, s.size, s.centre, s.reach)
    set_ints(sim, AT_SHAPES + 4, s.vertex_start, s.vertices, s.neighbour_start, s.neighbours)
    set_int(sim, AT_SHAPES + 8, s.cell_start)
    set_int(sim, AT_SHAPES + 9, s.cells)
    set_int(sim, AT_SHAPES + 10, s.frames)
    set_ints(
        sim, AT_FACES, address(pieces.face_start), address(pieces.planes), address(pieces.loop_start),
        address(pieces.loops),
    )  # fmt: skip
    r = room_of(scratch)
    set_ints(sim, AT_ROOM, r.simplex, r.points, r.planes, r.polygons)
    set_int(sim, AT_ROOM + 4, r.faces)
    set_int(sim, AT_ROOM + 5, r.queue)
    set_int(sim, AT_ROOM + 6, r.stack)
    return sim


@kernel
def set_ints(sim: int, i: int, a: int, b: int, c: int, d: int) -> None:
    """Write four entries."""
    set_int(sim, i, a)
    set_int(sim, i + 1, b)
    set_int(sim, i + 2, c)
    set_int(sim, i + 3, d)
