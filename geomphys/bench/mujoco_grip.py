"""Runs an experiment in MuJoCo with hands that yield as ours do: the virtual coupling holds the root and every joint.

The position of a root and every joint follow the recording by  m ẍ = -K x - R ẋ  (6) on the offset x, with the same m, K and R as
in geomphys, so that what is recorded inside an object grips it with the same force. Of n joints in series each has
n K times its lever squared, by which their tip yields by about K. The rotation of a root, which no contact changes in
geomphys, is held by a stiff servo.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from geomphys.bench.measure import PeerFrame
from geomphys.bench.mujoco_peer import MujocoPeer
from geomphys.bench.mujoco_scene import TIMESTEP, body_name
from geomphys.driven.links import links_of
from geomphys.driven.weights import WEIGHTS
from geomphys.results import FrameResult
from geomphys.scene.arrays import DRIVEN
from geomphys.scene.world import World

Floats = NDArray[np.float64]

FRICTION_IMPEDANCE = 10.0  # of that of the normal (MuJoCo's `impratio`): its documentation's advice against slip
ROTATION_FREQUENCY = 150.0  # rad/s, of the critically damped servo that holds a root's rotation


class MujocoGripPeer(MujocoPeer):
    """The world of a replay in MuJoCo, with hands held by the virtual coupling, from the first frame on.

    A frame's time is that of its steps; the targets, which move at constant velocity through a frame, are set between them.

    Raises
    ------
    ConfigError
        MuJoCo is not installed.
    """

    hands = ("yielding", "yielding")
    welded = False

    def __init__(self, world: World, first: FrameResult) -> None:
        super().__init__(world, first, jointed=True)
        scene, links, model = world.scene, links_of(world, WEIGHTS), self.model
        model.opt.impratio = FRICTION_IMPEDANCE
        trees = np.flatnonzero(scene.trees.role == DRIVEN)
        self._roots = scene.trees.body_start[:-1][trees]
        self._root_ids = np.array([model.body(body_name(int(root))).id for root in self._roots], dtype=np.int64)
        self._stiffness, self._damping = scene.trees.stiffness[trees], scene.trees.damping[trees]
        self._inertia = [
            model.dof_M0[model.body_dofadr[k] + 3 : model.body_dofadr[k] + 6].copy() for k in self._root_ids
        ]
        self._lead = np.zeros(len(self._servo_ids))  # s: damping over stiffness
        for k, (body, servo) in enumerate(zip(self._jointed_links, self._servo_ids, strict=True)):
            tree = int(scene.bodies.tree[body])
            share = _joints_in_line(world, int(body)) * links.lever[scene.bodies.dof[body]] ** 2
            stiffness, damping = share * scene.trees.stiffness[tree], share * scene.trees.damping[tree]
            model.dof_armature[model.jnt_dofadr[model.actuator_trnid[servo, 0]]] = share * scene.trees.mass[tree]
            model.actuator_gainprm[servo, 0] = stiffness
            model.actuator_biasprm[servo, 1], model.actuator_biasprm[servo, 2] = -stiffness, -damping
            self._lead[k] = damping / stiffness
        self._last_poses, self._last_control = first.recorded[self._roots], self.data.ctrl[self._servo_ids].copy()
        self._mujoco.mj_setConst(model, self._mujoco.MjData(model))
        self._mujoco.mj_forward(model, self.data)

    def frame(self, result: FrameResult) -> PeerFrame:
        """Step to the frame's time; see `Peer.frame`."""
        self._next_poses = result.recorded[self._roots]
        done = super().frame(result)
        self._last_poses, self._last_control = self._next_poses, self._next_control
        return done

    def _advance(self, steps: int) -> int:
        """Take so many steps with interpolated targets; returns their time [ns]."""
        self._next_control = self.data.ctrl[self._servo_ids].copy()
        if steps == 0:
            return 0
        rate, ns = 1.0 / (steps * TIMESTEP), 0
        lead = self._lead * rate * (self._next_control - self._last_control)
        for step in range(steps):
            at = (step + 1) / steps
            self.data.ctrl[self._servo_ids] = (1 - at) * self._last_control + at * self._next_control + lead
            for k in range(len(self._roots)):
                self._hold_root(k, at, rate)
            start = time.perf_counter_ns()
            self._mujoco.mj_step(self.model, self.data)
            ns += time.perf_counter_ns() - start
        self.data.ctrl[self._servo_ids] = self._next_control
        return ns

    def _hold_root(self, k: int, at: float, rate: float) -> None:
        """Apply the coupling's force to a root, and the servo's torque, at this fraction of the frame; `rate` in 1/s."""
        mujoco, data, body = self._mujoco, self.data, self._root_ids[k]
        first, last, next_ = self.model.body_dofadr[body], self._last_poses[k], self._next_poses[k]
        address = self.model.jnt_qposadr[self.model.body_jntadr[body]]
        x, v = data.qpos[address : address + 3], data.qvel[first : first + 3]
        target, velocity = (1 - at) * last[:3] + at * next_[:3], rate * (next_[:3] - last[:3])
        data.qfrc_applied[first : first + 3] = self._stiffness[k] * (target - x) + self._damping[k] * (velocity - v)
        before, after = np.roll(last[3:], 1), np.roll(next_[3:], 1)
        rotation, omega, local = np.zeros(3), np.zeros(3), np.zeros(3)
        mujoco.mju_subQuat(rotation, after, before)  # in the frame of `before`
        target_rotation = before.copy()
        mujoco.mju_quatIntegrate(target_rotation, rotation, at)
        mujoco.mju_subQuat(local, target_rotation, data.qpos[address + 3 : address + 7])
        omega = rate * rotation
        servo = ROTATION_FREQUENCY * local + 2.0 * (omega - data.qvel[first + 3 : first + 6])
        data.qfrc_applied[first + 3 : first + 6] = self._inertia[k] * ROTATION_FREQUENCY * servo


def _joints_in_line(world: World, body: int) -> int:
    """Joints in series with the one above a body, from the root to the last link."""
    bodies = world.scene.bodies
    above, joint = 0, body
    while joint >= 0:
        above += int(bodies.dof[joint] >= 0 and bodies.multiplier[joint] != 0.0)
        joint = int(bodies.parent[joint])
    deepest, depth = 0, {body: 0}
    for child in range(body + 1, len(bodies.parent)):
        if int(bodies.parent[child]) in depth:
            depth[child] = depth[int(bodies.parent[child])] + int(bodies.dof[child] >= 0)
            deepest = max(deepest, depth[child])
    return above + deepest
