"""Builds a MuJoCo model of a world: the same pieces; welds and position servos follow the recorded bodies."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import ConfigError
from geomphys.numerics.transforms import (
    compose,
    matrix_from_frame,
    matrix_from_pose,
    pose_from_matrix,
)
from geomphys.scene.arrays import BOX, CAPSULE, CYLINDER, DRIVEN, FIXED, HULL, JOINT_FIXED, JOINT_PRISMATIC, SPHERE
from geomphys.scene.world import World

Floats = NDArray[np.float64]

TIMESTEP = 0.002  # s
SERVO_FREQUENCY = 500.0  # rad/s; natural frequency of the critically damped servos that hold the joints as recorded
ROTOR_RATIO = (
    10.0  # of a servo's rotor to the inertia it moves: without one, stiff servos in a chain of light links are unstable
)
WELD_GAINS = (-0.5 / TIMESTEP**2, -1.0 / TIMESTEP)  # 1/s², 1/s: each step closes half of the remaining distance
WELD_IMPEDANCE = (0.99, 0.999, 1e-4, 0.5, 2.0)  # MuJoCo's `solimp`: it hardly yields
MIN_MASS_RATIO = 1e-3  # of an avatar's mass: lower bound of a link's mass, as MuJoCo takes no massless one
MIN_INERTIA = 1e-8  # kg m²
ALL_BITS = 0x7FFFFFFF


def load_mujoco() -> Any:
    """The module; raises ConfigError if it is not installed."""
    try:
        import mujoco
    except ImportError:
        raise ConfigError("peers need MuJoCo and coal: pip install 'geomphys[bench]'") from None
    return mujoco


def body_name(body: int) -> str:
    """Name of a body in the model."""
    return f"b{body}"


def mocap_name(body: int) -> str:
    """Name of the mocap body that a tree's root is welded to, or of a moving fixed link."""
    return f"m{body}"


def build_model(world: World, poses: Floats, jointed: bool, welded: bool = True) -> Any:
    """A compiled MuJoCo model of a world.

    Spheres, capsules, boxes and cylinders are the primitives of that name, hulls are meshes, of which MuJoCo takes the
    convex hull. Fixed objects are geoms of the world, those with a topic mocap bodies; simulated ones are free bodies
    with the same mass and inertia. A driven tree is free and its root welded to a mocap body that goes where the root
    was recorded. Its links are parts of one body, which the peer puts where they were recorded; or it is `jointed`, and
    position servos hold its joints at the recorded angles. Weld and servos are so stiff that a hand without obstacles
    follows within 2 mm, and gravity does not act on it. Friction cones are elliptic. In chains mode, links collide
    but for the pairs the world leaves out. MuJoCo has no restitution and combines friction by geom: a geom has that of its
    material against itself.

    Parameters
    ----------
    poses
        (B, 7) of all bodies at the start.
    jointed
        Whether driven trees have joints.
    welded
        Whether the roots of driven trees are welded to mocap bodies.

    Raises
    ------
    ConfigError
        MuJoCo is not installed.
    """
    mujoco = load_mujoco()
    spec = mujoco.MjSpec()
    spec.option.timestep = TIMESTEP
    spec.option.gravity = world.scene.gravity
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.compiler.balanceinertia = True
    spec.memory = 1 << 28
    bodies: dict[int, Any] = {}
    for tree in range(len(world.scene.trees.role)):
        _add_tree(mujoco, spec, world, poses, tree, jointed, bodies)
    if welded:
        for root in world.scene.trees.body_start[:-1][world.scene.trees.role == DRIVEN]:
            _add_weld(mujoco, spec, int(root), poses[root])
    _exclude(spec, world)
    model = spec.compile()
    _tune_servos(mujoco, model)
    return model


def _add_tree(
    mujoco: Any, spec: Any, world: World, poses: Floats, tree: int, jointed: bool, made_bodies: dict[int, Any]
) -> None:
    """Add a tree's bodies, geoms, joints, servos and welds."""
    scene = world.scene
    bodies, role, bits = scene.bodies, int(scene.trees.role[tree]), _collision_bits(world, tree)
    first, last = int(scene.trees.body_start[tree]), int(scene.trees.body_start[tree + 1])
    masses = bodies.mass[first:last]
    total = float(np.sum(masses))
    scale = float(scene.trees.mass[tree]) / total if role == DRIVEN and total > 0 else 1.0
    for body in range(first, last):
        pose = poses[body]
        if role == FIXED and scene.trees.moving[tree] == 0:
            _add_geoms(mujoco, spec, spec.worldbody, world, body, matrix_from_pose(pose), bits)
            continue
        if role == FIXED:
            owner = spec.worldbody.add_body(name=mocap_name(body), mocap=True, pos=pose[:3], quat=_wxyz(pose[3:]))
            _add_geoms(mujoco, spec, owner, world, body, np.eye(4), bits)
            continue
        if body == first:
            owner = spec.worldbody.add_body(name=body_name(body), pos=pose[:3], quat=_wxyz(pose[3:]))
            owner.add_freejoint()
        else:
            origin = pose_from_matrix(matrix_from_frame(bodies.origin[body]))
            parent = made_bodies[int(bodies.parent[body])]
            owner = parent.add_body(name=body_name(body), pos=origin[:3], quat=_wxyz(origin[3:]))
            if jointed:
                _add_joint(mujoco, spec, owner, world, body)
        made_bodies[body] = owner
        min_mass = MIN_MASS_RATIO * float(scene.trees.mass[tree]) if role == DRIVEN else 0.0
        owner.gravcomp = 1.0 if role == DRIVEN else 0.0
        owner.explicitinertial = True
        owner.mass = max(scale * float(bodies.mass[body]), min_mass)
        owner.ipos = bodies.com[body]
        owner.iquat = _wxyz(bodies.principal[body])
        owner.inertia = np.maximum(scale * bodies.inertia[body], MIN_INERTIA if role == DRIVEN else 0.0)
        _add_geoms(mujoco, spec, owner, world, body, np.eye(4), bits)


def _add_weld(mujoco: Any, spec: Any, body: int, pose: Floats) -> None:
    """Add the mocap body that a root follows, and the weld between them."""
    spec.worldbody.add_body(name=mocap_name(body), mocap=True, pos=pose[:3], quat=_wxyz(pose[3:]))
    weld = spec.add_equality(
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1=mocap_name(body),
        name2=body_name(body),
    )
    anchor, position, orientation, torque_scale = [0.0] * 3, [0.0] * 3, [1.0, 0.0, 0.0, 0.0], [1.0]
    weld.data[:11] = anchor + position + orientation + torque_scale
    weld.solref, weld.solimp = WELD_GAINS, WELD_IMPEDANCE


def _add_joint(mujoco: Any, spec: Any, owner: Any, world: World, body: int) -> None:
    """Add the joint above a body and the servo that drives it."""
    bodies = world.scene.bodies
    if bodies.joint[body] == JOINT_FIXED:
        return
    sliding = bodies.joint[body] == JOINT_PRISMATIC
    kind = mujoco.mjtJoint.mjJNT_SLIDE if sliding else mujoco.mjtJoint.mjJNT_HINGE
    owner.add_joint(name=body_name(body), type=kind, axis=bodies.axis[body])
    servo = spec.add_actuator(name=body_name(body), target=body_name(body), trntype=mujoco.mjtTrn.mjTRN_JOINT)
    servo.gaintype, servo.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE


def _tune_servos(mujoco: Any, model: Any) -> None:
    """Give the joints rotors, and the servos the stiffness and damping that suit the inertia they move."""
    for k in range(model.nu):
        dof = model.jnt_dofadr[model.actuator_trnid[k, 0]]
        model.dof_armature[dof] = ROTOR_RATIO * model.dof_M0[dof]
        inertia = (1.0 + ROTOR_RATIO) * model.dof_M0[dof]
        model.actuator_gainprm[k, 0] = SERVO_FREQUENCY**2 * inertia
        model.actuator_biasprm[k, 1], model.actuator_biasprm[k, 2] = (
            -(SERVO_FREQUENCY**2) * inertia,
            -2.0 * SERVO_FREQUENCY * inertia,
        )


def _collision_bits(world: World, tree: int) -> tuple[int, int]:
    """Contype and conaffinity of a tree's geoms: two collide where one's type matches the other's affinity."""
    if tree >= world.avatar_count:
        return 1, ALL_BITS
    own_type = 1 << (1 + tree % 30)
    collides_with_itself = world.scene.trees.chains[tree] == 1 and world.scene.trees.self_collision[tree] == 1
    return own_type, ALL_BITS if collides_with_itself else ALL_BITS & ~own_type


def _exclude(spec: Any, world: World) -> None:
    """Leave out the pairs of links the world leaves out."""
    excluded, scene = world.scene.excluded, world.scene
    for a in range(len(excluded)):
        for b in range(a + 1, len(excluded)):
            if excluded[a, b] == 1 and scene.bodies.tree[a] == scene.bodies.tree[b]:
                spec.add_exclude(bodyname1=body_name(a), bodyname2=body_name(b))


def _add_geoms(
    mujoco: Any, spec: Any, owner: Any, world: World, body: int, owner_from_body: Floats, bits: tuple[int, int]
) -> None:
    """Add the pieces of a body to a MuJoCo body."""
    pieces, kinds = world.scene.pieces, mujoco.mjtGeom
    types = {SPHERE: kinds.mjGEOM_SPHERE, CAPSULE: kinds.mjGEOM_CAPSULE, BOX: kinds.mjGEOM_BOX}
    types |= {CYLINDER: kinds.mjGEOM_CYLINDER, HULL: kinds.mjGEOM_MESH}
    material = int(world.scene.bodies.material[body])
    friction = float(world.scene.materials.friction[material, material])
    for k in range(world.scene.bodies.piece_start[body], world.scene.bodies.piece_start[body + 1]):
        position = pose_from_matrix(compose(owner_from_body, matrix_from_frame(pieces.local[k])))
        kind = int(pieces.kind[k])
        geom = owner.add_geom(type=types[kind], pos=position[:3], quat=_wxyz(position[3:]))
        geom.contype, geom.conaffinity = bits
        if math.isfinite(friction):
            geom.friction[0] = friction
        if kind == HULL:
            corners = pieces.vertices[pieces.vertex_start[k] : pieces.vertex_start[k + 1]]
            mesh = spec.add_mesh(name=f"p{k}", uservert=corners.ravel())
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
            geom.meshname = f"p{k}"
        else:
            geom.size = pieces.size[k]


def _wxyz(quaternion: Floats) -> Floats:
    """Quaternions (…, 4) w x y z of x y z w."""
    return np.roll(quaternion, 1, axis=-1)
