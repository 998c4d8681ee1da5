"""Runs an experiment in MuJoCo: sets the recorded targets, times the steps of a frame and measures the residual overlap."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from geomphys.bench.fingertip_meter import FingertipMeter
from geomphys.bench.measure import PeerFrame
from geomphys.bench.mujoco_scene import TIMESTEP, body_name, build_model, load_mujoco, mocap_name
from geomphys.numerics.transforms import compose, invert, matrix_from_pose, pose_from_matrix
from geomphys.results import FrameResult
from geomphys.scene.arrays import DRIVEN, FIXED, JOINT_FIXED, SIMULATED
from geomphys.scene.world import World

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

    hands = ("rigid", "jointed")
    welded = True

    def __init__(self, world: World, first: FrameResult, jointed: bool) -> None:
        self._mujoco = load_mujoco()
        self.name = f"mujoco {self._mujoco.__version__}, {self.hands[jointed]}"
        self.model = build_model(world, first.recorded, jointed, self.welded)
        self.data = self._mujoco.MjData(self.model)
        self._start_ns = first.frame.time_ns
        self._steps = 0
        bodies, trees = world.scene.bodies, world.scene.trees
        roots = trees.body_start[:-1][trees.role == DRIVEN]
        tracked = np.flatnonzero((bodies.role == FIXED) & (trees.moving[bodies.tree] == 1))
        self._targets: Ints = np.concatenate([roots[: len(roots) * self.welded], tracked]).astype(np.int64)
        self._mocap_ids = self._ids(self.model.body_mocapid, [mocap_name(int(b)) for b in self._targets])
        links: Ints = np.flatnonzero((bodies.role == DRIVEN) & (bodies.joint != JOINT_FIXED))
        self._jointed_links: Ints = links if jointed else links[:0]
        self._rigid_links: Ints = links[:0] if jointed else links
        self._parents = bodies.parent[self._rigid_links]
        self._rigid_link_ids = np.array(
            [self.model.body(body_name(int(b))).id for b in self._rigid_links], dtype=np.int64
        )
        self._dofs, self._multiplier = bodies.dof[self._jointed_links], bodies.multiplier[self._jointed_links]
        self._offset = bodies.offset[self._jointed_links]
        self._servo_ids = np.array(
            [self.model.actuator(body_name(int(b))).id for b in self._jointed_links], dtype=np.int64
        )
        self._is_driven = self._geoms_of_driven_bodies(world)
        self._free: Ints = np.flatnonzero(bodies.role != FIXED)
        self._free_ids = np.array([self.model.body(body_name(int(b))).id for b in self._free], dtype=np.int64)
        self._tips = FingertipMeter(world)
        self._set_initial_state(world, first)

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
        """Step to the frame's time; see `Peer.frame`."""
        self._set_targets(result)
        steps = max(round((result.frame.time_ns - self._start_ns) * 1e-9 / TIMESTEP) - self._steps, 0)
        ns = self._advance(steps)
        self._steps += steps
        residual = self._residual()
        return PeerFrame(float(ns), steps, residual, self._tips.figures(result.recorded, self._poses(result)))

    def _advance(self, steps: int) -> int:
        """Take so many steps; returns their time [ns]."""
        start = time.perf_counter_ns()
        self._mujoco.mj_step(self.model, self.data, nstep=steps)
        return time.perf_counter_ns() - start

    def poses(self, result: FrameResult) -> Floats:
        """(B, 7) of all bodies, at the frame's time; those of `result` where they are fixed."""
        self._mujoco.mj_kinematics(self.model, self.data)
        return self._poses(result)

    def _poses(self, result: FrameResult) -> Floats:
        """(B, 7) of all bodies, once kinematics are done."""
        poses = result.recorded.copy()
        poses[self._free, :3] = self.data.xpos[self._free_ids]
        poses[self._free, 3:] = np.roll(self.data.xquat[self._free_ids], -1, axis=1)
        return poses

    def _ids(self, column: Ints, names: list[str]) -> Ints:
        return np.array([column[self.model.body(name).id] for name in names], dtype=np.int64)

    def _set_targets(self, result: FrameResult) -> None:
        """Set the targets of roots, moving fixed links and joints, and the poses of the links of rigid hands."""
        poses = result.recorded[self._targets]
        self.data.mocap_pos[self._mocap_ids] = poses[:, :3]
        self.data.mocap_quat[self._mocap_ids] = np.roll(poses[:, 3:], 1, axis=1)
        relative_poses = pose_from_matrix(
            compose(
                invert(matrix_from_pose(result.recorded[self._parents])),
                matrix_from_pose(result.recorded[self._rigid_links]),
            )
        )
        self.model.body_pos[self._rigid_link_ids] = relative_poses[:, :3]
        self.model.body_quat[self._rigid_link_ids] = np.roll(relative_poses[:, 3:], 1, axis=1)
        self.data.ctrl[self._servo_ids] = self._multiplier * result.frame.angles[self._dofs] + self._offset

    def _set_initial_state(self, world: World, first: FrameResult) -> None:
        """Set joints to their recorded values and simulated bodies to their initial velocities."""
        bodies = world.scene.bodies
        self._set_targets(first)
        for body, angle in zip(self._jointed_links, self.data.ctrl[self._servo_ids], strict=True):
            self.data.joint(body_name(int(body))).qpos[0] = angle
        for body in np.flatnonzero(bodies.role == SIMULATED):
            address = self.model.body_dofadr[self.model.body(body_name(int(body))).id]
            speed, angular_velocity = np.split(world.scene.initial_velocity[body], 2)
            x, y, z, w = first.recorded[body, 3:]
            body_from_world = np.zeros(9)
            self._mujoco.mju_quat2Mat(body_from_world, np.array([w, -x, -y, -z]))
            lever_arm = body_from_world.reshape(3, 3).T @ bodies.com[body]
            self.data.qvel[address : address + 3] = speed - np.cross(angular_velocity, lever_arm)
            self.data.qvel[address + 3 : address + 6] = body_from_world.reshape(3, 3) @ angular_velocity
        self._mujoco.mj_forward(self.model, self.data)

    def _geoms_of_driven_bodies(self, world: World) -> NDArray[np.bool_]:
        driven = [self.model.body(body_name(int(b))).id for b in np.flatnonzero(world.scene.bodies.role == DRIVEN)]
        return np.isin(self.model.geom_bodyid, driven)

    def _residual(self) -> float:
        """Deepest overlap of a driven body at the current poses [m], by MuJoCo's own narrow phase."""
        self._mujoco.mj_kinematics(self.model, self.data)
        self._mujoco.mj_comPos(self.model, self.data)
        self._mujoco.mj_collision(self.model, self.data)
        if self.data.ncon == 0:
            return 0.0
        involves_driven = np.any(self._is_driven[self.data.contact.geom], axis=1)
        return max(0.0, -float(np.min(self.data.contact.dist[involves_driven], initial=0.0)))
