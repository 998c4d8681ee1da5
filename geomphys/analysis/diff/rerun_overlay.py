"""Writes both motions of a comparison as a rerun recording: a solid, b translucent, and their distance as a curve."""

from __future__ import annotations

import hashlib
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from geomphys.analysis.diff.channels import Tolerance
from geomphys.analysis.diff.compare import match_frames
from geomphys.analysis.diff.difference import OutputDifference
from geomphys.analysis.diff.motion_channels import PoseChannel
from geomphys.analysis.diff.peak_pictures import COLOUR_A, COLOUR_B, COLOUR_STATIC
from geomphys.numerics.transforms import rotation_from_quaternion
from geomphys.output.camera import choose_viewpoint
from geomphys.output.decoders import Poses
from geomphys.output.output_log import OutputLog, open_output
from geomphys.output.output_world import world_of_output
from geomphys.output.rerun_stream import UNIX_TIME_START, RerunStream, Times
from geomphys.output.vertex_normals import with_vertex_normals
from geomphys.scene.world import World
from geomphys.storage.output_file import OutputFile
from geomphys.storage.remote_files import AnyPath

if TYPE_CHECKING:
    from rerun.blueprint import Blueprint

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SCENE = ("world",)
CURVE = ("plots", "distance_mm")

BATCH = 1000
"""Frames sent at once."""
EYE_FRAMES = 200
"""Number of frames from which the viewpoint is chosen."""
OPACITY = {"a": 255, "b": 130}


def write_overlay(difference: OutputDifference, out: AnyPath, *, scene: AnyPath | None = None) -> None:
    """Write both motions as a rerun recording: timelines ``frame`` (as a counts) and ``time``.

    Parameters
    ----------
    difference : OutputDifference
        From `compare_outputs`.
    out : Path
        The ``.rrd`` file; replaced if it is there.
    scene : Path, optional
        The scene file; None: what is attached to a.

    Raises
    ------
    InputError
        The scene's files are gone or changed.
    OutputError
        The recording cannot be written.
    """
    a, b = open_output(difference.a), open_output(difference.b)
    world = world_of_output(a, scene)
    identity = hashlib.sha256(repr([sorted(log.metadata.items()) for log in (a, b)]).encode()).hexdigest()
    with OutputFile(out, force=True, inputs=(a.path, b.path, *world.source_files)) as output:
        stream = RerunStream(output.temporary, identity[:32], f"{a.path.stem} against {b.path.stem}")
        view = _send_motions(stream, world, a, b)
        stream.finish({"a": difference.a, "b": difference.b}, view)


def _send_motions(stream: RerunStream, world: World, a: OutputLog, b: OutputLog) -> Blueprint:
    """Send both motions and the curve; returns the blueprint."""
    import rerun as rr

    stream.log_static(SCENE, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    stream.log_static(CURVE, rr.SeriesLines(names="largest distance [mm]", widths=1.5, colors=[217, 118, 27]))
    motions = [_OverlayMotion(stream, name, world, log) for name, log in (("a", a), ("b", b))]
    distance = PoseChannel("/tf", Tolerance(), motions[0].first, motions[1].first)
    unix, index = a.start_ns >= UNIX_TIME_START, 0
    frames: list[int] = []
    times_ns: list[int] = []
    rows: list[int] = []
    values: list[float] = []
    largest = 0.0

    def send() -> None:
        times = Times(np.array(frames, np.int64), np.array(times_ns, np.int64), unix)
        for side in motions:
            side.send(times)
        stream.send(CURVE, times, np.array(rows, np.int64), rr.Scalars.columns(scalars=values))
        for column in (frames, times_ns, rows, values):
            column.clear()

    for one, other in match_frames(a.frames(["/tf"]), b.frames(["/tf"])):
        present = one or other
        assert present is not None
        index = one.index if one is not None else index
        if one is not None and other is not None:
            rows.append(len(frames))
            values.append(1e3 * distance.add(one, other))
            largest = max(largest, values[-1])
        for side, frame in zip(motions, (one, other), strict=True):
            if frame is not None:
                side.take(len(frames), frame.tf)
        frames.append(index)
        times_ns.append(present.time_ns)
        if len(frames) == BATCH:
            send()
    send()
    return _view(world, (a, b), motions[0].first.tf, motions[0].moving, largest)


class _OverlayMotion:
    """One of the two motions: logs its shapes and buffers its poses."""

    def __init__(self, stream: RerunStream, name: str, world: World, log: OutputLog) -> None:
        two = list(islice(log.frames(["/tf"]), 2))
        self.first = two[0]
        self.moving = two[-1].tf.names
        self._stream, self._name = stream, name
        self._rows: list[int] = []
        self._values: list[Floats] = []
        self._layout: tuple[tuple[str, ...], Ints] = ((), np.zeros(0, np.int64))
        self._drawn = [frame for k, frame in enumerate(world.frame_names) if len(world.triangles[k][1])]
        self._send_shapes(world)

    def take(self, row: int, poses: Poses) -> None:
        """Buffer the poses of the frame at a row of the batch."""
        if poses.names != self._layout[0]:
            self._layout = (poses.names, np.array([poses.names.index(n) for n in self.moving], np.int64))
        self._rows.append(row)
        self._values.append(poses.values[self._layout[1]])

    def send(self, times: Times) -> None:
        """Send the buffered poses."""
        import rerun as rr

        if not self._rows:
            return
        rows, values = np.array(self._rows, np.int64), np.stack(self._values)
        for body, name in enumerate(self.moving):
            if name in self._drawn:
                poses = values[:, body]
                columns = rr.Transform3D.columns(translation=poses[:, :3], quaternion=poses[:, 3:])
                self._stream.send((*SCENE, self._name, name), times, rows, columns)
        self._rows, self._values = [], []

    def _send_shapes(self, world: World) -> None:
        """Log the shapes, those of b translucent, and the poses of static bodies."""
        import rerun as rr

        poses_by_name = dict(zip(self.first.tf.names, self.first.tf.values, strict=True))
        for body, frame in enumerate(world.frame_names):
            if frame not in self._drawn or frame not in poses_by_name:
                continue
            points, corners, normals = with_vertex_normals(*world.triangles[body])
            paint = COLOUR_STATIC if frame not in self.moving else COLOUR_A if self._name == "a" else COLOUR_B
            colour = (*(round(255 * part) for part in paint), OPACITY[self._name])
            path = (*SCENE, self._name, frame)
            self._stream.log_static(
                path,
                rr.Mesh3D(
                    vertex_positions=points, triangle_indices=corners, vertex_normals=normals, albedo_factor=colour
                ),
            )
            if frame not in self.moving:
                pose = poses_by_name[frame]
                static_pose = rr.Transform3D(translation=pose[:3], quaternion=rr.Quaternion(xyzw=pose[3:]))
                self._stream.log_static(path, static_pose)


def _view(
    world: World, logs: tuple[OutputLog, OutputLog], static_poses: Poses, moving: tuple[str, ...], largest_mm: float
) -> Blueprint:
    """Blueprint: the scene above, the curve below; the viewpoint minimizes occlusion of the motion."""
    import rerun.blueprint as rrb

    poses_by_name = dict(zip(static_poses.names, static_poses.values, strict=True))
    static_triangles = [np.zeros((0, 3, 3))]
    for body, frame in enumerate(world.frame_names):
        vertices, faces = world.collision_triangles[body]
        if frame not in moving and frame in poses_by_name:
            pose = poses_by_name[frame]
            static_triangles.append((vertices @ rotation_from_quaternion(pose[3:]).T + pose[:3])[faces])
    visited = [np.zeros((0, 3))]
    for poses in logs[0].sample(EYE_FRAMES):
        visited.append(np.array([v[:3] for n, v in zip(poses.names, poses.values, strict=True) if n in moving]))
    eye = choose_viewpoint(np.concatenate([v.reshape(-1, 3) for v in visited]), np.concatenate(static_triangles))
    scene = rrb.Spatial3DView(
        origin="/".join(SCENE),
        name=f"a: {logs[0].path.stem} (blue, solid), b: {logs[1].path.stem} (orange, over it)",
        eye_controls=rrb.EyeControls3D(position=eye.position, look_target=eye.target, eye_up=(0.0, 0.0, 1.0)),
        line_grid=False,
        background=rrb.Background(color=(244, 244, 246)),
    )
    curve = rrb.TimeSeriesView(
        origin="/".join(CURVE[:1]),
        name="Distance of a and b [mm]",
        axis_y=rrb.ScalarAxis(range=(0.0, 1.1 * largest_mm or 1.0), zoom_lock=False),
    )
    layout: Blueprint = rrb.Blueprint(
        rrb.Vertical(scene, curve, row_shares=[4.0, 1.0]),
        rrb.TimePanel(state="collapsed", timeline="frame"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )
    return layout
