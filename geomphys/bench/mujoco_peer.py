"""MuJoCo as a peer: the recording's targets go in, a frame's steps are timed, and what overlaps is measured."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from geomphys.bench.measure import PeerFrame
from geomphys.bench.mujoco_scene import TIMESTEP, body_name, build_model, load_mujoco, mocap_name
from geomphys.numerics.transforms import compose, invert, matrix_from_pose, pose_from_matrix
from geomphys.results import FrameResult
from geomphys.scene.arrays import DRIVEN, FIXED, JOINT_FIXED, SIMULATED, World

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class MujocoPeer:
    """The world of a replay in MuJoCo, from the first frame on.

    A frame's time is that of the one call that takes the steps of 2 ms up to the frame's time, with warm starts, the
    default solver and one thread. A hand is one rigid body, which costs MuJoCo least, or `jointed`. Setting the targets
    and measuring what is left are not in the time.

    Raises
    ------
    ConfigError
        MuJoCo is not installed.
    """

    def __init__(self, world: World, first: FrameResult, jointed: bool) -> None:
        self._mujoco = load_mujoco()
        self.name = f"mujoco {self._mujoco.__version__}, {'jointed' if jointed else 'rigid'}"
        self.model = build_model(world, first.recorded, jointed)
        self.data = self._mujoco.MjData(self.model)
        self._start_ns = first.frame.time_ns
        self._steps = 0
        bodies, trees = world.scene.bodies, world.scene.trees
        roots = trees.body_start[:-1][trees.role == DRIVEN]
        tracked = np.flatnonzero((bodies.role == FIXED) & (trees.moving[bodies.tree] == 1))
        self._targets: Ints = np.concatenate([roots, tracked]).astype(np.int64)
        self._mocaps = self._rows(self.model.body_mocapid, [mocap_name(int(b)) for b in self._targets])
        links: Ints = np.flatnonzero((bodies.role == DRIVEN) & (bodies.joint != JOINT_FIXED))
        self._jointed: Ints = links if jointed else links[:0]
        self._transforms_of: Ints = links[:0] if jointed else links
        self._parents = bodies.parent[self._transforms_of]
        self._links = np.array([self.model.body(body_name(int(b))).id for b in self._transforms_of], dtype=np.int64)
        self._dofs, self._multiplier = bodies.dof[self._jointed], bodies.multiplier[self._jointed]
        self._offset = bodies.offset[self._jointed]
        self._servos = np.array([self.model.actuator(body_name(int(b))).id for b in self._jointed], dtype=np.int64)
        self._is_driven = self._geoms_of_driven_bodies(world)
        self._begin(world, first)

    @classmethod
    def rigid(cls, world: World, first: FrameResult) -> MujocoPeer:
        """The peer with hands of one body."""
        return cls(world, first, jointed=False)

    @classmethod
    def jointed(cls, world: World, first: FrameResult) -> MujocoPeer:
        """The peer with servos in the hands' joints."""
        return cls(world, first, jointed=True)

    @property
    def warnings(self) -> int:
        """How often MuJoCo warned: of bad numbers, or of contacts that did not fit in its memory."""
        return int(sum(warning.number for warning in self.data.warning))

    def frame(self, result: FrameResult) -> PeerFrame:
        """Go on to the frame's time."""
        self._set_targets(result)
        steps = max(round((result.frame.time_ns - self._start_ns) * 1e-9 / TIMESTEP) - self._steps, 0)
        start = time.perf_counter_ns()
        self._mujoco.mj_step(self.model, self.data, nstep=steps)
        ns = time.perf_counter_ns() - start
        self._steps += steps
        return PeerFrame(float(ns), steps, self._residual())

    def _rows(self, column: Ints, names: list[str]) -> Ints:
        return np.array([column[self.model.body(name).id] for name in names], dtype=np.int64)

    def _set_targets(self, result: FrameResult) -> None:
        """Set targets of roots, moving fixed links and joints; put the links of rigid hands in place."""
        poses = result.recorded[self._targets]
        self.data.mocap_pos[self._mocaps] = poses[:, :3]
        self.data.mocap_quat[self._mocaps] = np.roll(poses[:, 3:], 1, axis=1)
        experiment_files = pose_from_matrix(
            compose(
                invert(matrix_from_pose(result.recorded[self._parents])),
                matrix_from_pose(result.recorded[self._transforms_of]),
            )
        )
        self.model.body_pos[self._links] = experiment_files[:, :3]
        self.model.body_quat[self._links] = np.roll(experiment_files[:, 3:], 1, axis=1)
        self.data.ctrl[self._servos] = self._multiplier * result.frame.angles[self._dofs] + self._offset

    def _begin(self, world: World, first: FrameResult) -> None:
        """Put joints where they were recorded, and simulated bodies in motion."""
        bodies = world.scene.bodies
        self._set_targets(first)
        for body, angle in zip(self._jointed, self.data.ctrl[self._servos], strict=True):
            self.data.joint(body_name(int(body))).qpos[0] = angle
        for body in np.flatnonzero(bodies.role == SIMULATED):
            address = self.model.body_dofadr[self.model.body(body_name(int(body))).id]
            speed, angular_velocity = np.split(world.scene.initial_velocity[body], 2)
            x, y, z, w = first.recorded[body, 3:]
            body_from_world = np.zeros(9)
            self._mujoco.mju_quat2Mat(body_from_world, np.array([w, -x, -y, -z]))
            arm = body_from_world.reshape(3, 3).T @ bodies.com[body]
            self.data.qvel[address : address + 3] = speed - np.cross(angular_velocity, arm)
            self.data.qvel[address + 3 : address + 6] = body_from_world.reshape(3, 3) @ angular_velocity
        self._mujoco.mj_forward(self.model, self.data)

    def _geoms_of_driven_bodies(self, world: World) -> NDArray[np.bool_]:
        driven = [self.model.body(body_name(int(b))).id for b in np.flatnonzero(world.scene.bodies.role == DRIVEN)]
        return np.isin(self.model.geom_bodyid, driven)

    def _residual(self) -> float:
        """Deepest overlap of a driven body on the poses as they are now [m], by MuJoCo's own narrow phase."""
        self._mujoco.mj_kinematics(self.model, self.data)
        self._mujoco.mj_comPos(self.model, self.data)
        self._mujoco.mj_collision(self.model, self.data)
        if self.data.ncon == 0:
            return 0.0
        involves_driven = np.any(self._is_driven[self.data.contact.geom], axis=1)
        return max(0.0, -float(np.min(self.data.contact.dist[involves_driven], initial=0.0)))
