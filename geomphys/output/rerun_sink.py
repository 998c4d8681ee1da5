"""Writes a rerun recording: scene, corrected and recorded motion, contacts and plots."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from geomphys.config import Config
from geomphys.errors import OutputError
from geomphys.output import colours, frame_columns
from geomphys.output.finite_check import first_non_finite
from geomphys.output.provenance import Provenance
from geomphys.output.rerun_blueprint import (
    CONTACTS,
    CORRECTED_BODIES,
    DEPTHS,
    FLAGS,
    JOINTS,
    LEGEND,
    LINES,
    LOG,
    METRICS,
    MOMENTS,
    PLOTS,
    RECORDED_BODIES,
    RECORDED_JOINTS,
    SCENE,
    blueprint,
    legend,
)
from geomphys.output.rerun_stream import UNIX_TIME_START, RerunStream, Times
from geomphys.output.result_buffer import ResultBuffer
from geomphys.output.sink import ContextManaged
from geomphys.output.summary import FLAG_NAMES
from geomphys.output.vertex_normals import with_vertex_normals
from geomphys.output.view_statistics import ViewStatistics
from geomphys.output.worst_moments import WorstMoments, document_text, log_text
from geomphys.results import FrameResult, ResultColumns
from geomphys.scene.arrays import DRIVEN, FIXED
from geomphys.scene.world import World
from geomphys.storage.output_file import OutputFile
from geomphys.storage.remote_files import AnyPath

if TYPE_CHECKING:
    from rerun.blueprint import Blueprint

Floats = NDArray[np.float64]

BATCH_FRAMES = 2000
"""Frames that are buffered and sent together: half as many take 0.08 s more for a minute of a hand."""
STAGE_DEPTH = 2
"""Stages are plotted down to this many parts of their names."""

AXIS_HEADROOM = 1.5
"""The axis of the stage times ends at this much above the 97th percentile of the slowest batch."""

_FREE, _CORRECTED, _IN_CONTACT = range(3)
_LEVELS = {"info": "INFO", "warning": "WARN", "error": "ERROR"}


class RerunSink(ContextManaged):
    """Writes a recording for the rerun viewer, with the blueprint it opens with.

    Driven bodies are drawn at their corrected poses, in the colour of their state: free, corrected (moved from where
    they were recorded), in contact. The recorded pose is drawn as a translucent ghost while it differs. Poses
    and colours are sent where they change.

    Parameters
    ----------
    path : Path
        The ``.rrd`` file; it appears when complete, as ``STEM.partial.rrd`` if closed before.
    force : bool
        Whether a file that is there may be replaced.
    timing : bool
        Whether stage times are plotted.

    Raises
    ------
    OutputError
        From `open`: the file exists, its folder does not. From `write`: a number is not finite. From `close`: the
        file could not be written to its end.
    """

    def __init__(self, path: AnyPath, *, force: bool = False, timing: bool = True) -> None:
        self._path = path
        self._force = force
        self._timing = timing
        self._output: OutputFile | None = None

    def open(self, world: World, config: Config, provenance: Provenance) -> None:
        """Begin the recording; see `Sink.open`."""
        output = OutputFile(self._path, force=self._force, inputs=provenance.files, partial=True)
        identity = hashlib.sha256(json.dumps(provenance.record(complete=True)).encode()).hexdigest()
        try:
            self._stream = RerunStream(output.temporary, identity[:32], world.facts.name)
        except OSError as problem:
            raise output.error(problem) from problem
        self._output = output
        self._world, self._provenance = world, provenance
        bodies = world.scene.bodies
        self._is_moving = (bodies.role != FIXED) | (world.scene.trees.moving[bodies.tree] != 0)
        self._moving = np.flatnonzero(self._is_moving)
        self._drawn_driven = [b for b in np.flatnonzero(bodies.role == DRIVEN) if len(world.triangles[b][1])]
        self._names = [tuple(name.split("/")) for name in world.body_names]
        dofs = world.scene.dofs
        self._joints = [
            ((world.tree_names[tree], name), name) for tree, name in zip(dofs.tree, world.dof_names, strict=True)
        ]
        self._buffer = ResultBuffer(BATCH_FRAMES)
        self._last_result: FrameResult | None = None
        self._last_states: NDArray[np.int64] | None = None
        self._static: Floats | None = None  # (B, 7) poses of the first frame
        self._uses_unix_time = True
        self._sent_frames = self._first_ns = 0
        self._first_frame = 0
        self._has_log_lines = False
        self._stages_us = 0.0  # where their axis ends
        self._view_statistics = ViewStatistics(world)
        self._worst = WorstMoments(world.body_names)
        self._plotted: set[str] = set()
        self._send_shapes()

    def write(self, result: FrameResult) -> None:
        """Add a frame; see `Sink.write`."""
        self.write_columns(ResultColumns.of(result))

    def write_columns(self, columns: ResultColumns) -> None:
        """Add frames; see `ColumnSink.write_columns`."""
        if self._output is None:
            raise OutputError(f"{self._path}: a frame was written before the output was opened")
        good, error = first_non_finite(columns, self._world.body_names) or (len(columns), None)
        if good:
            columns = columns.rows(0, good)
            self._worst.add_columns(columns)
            for batch in self._buffer.add(columns):
                self._send_batch(batch)
        if error is not None:
            raise error

    def close(self, complete: bool) -> None:
        """Finish the recording and give it its name; see `Sink.close`."""
        if self._output is None:
            return
        import rerun as rr

        output, self._output = self._output, None
        if not output.is_of_this_process:  # where the SDK's thread that writes is missing
            output.publish(complete)
            return
        try:
            for batch in self._buffer.rest():
                self._send_batch(batch)
            if moments := self._worst.moments():
                self._stream.log_static(MOMENTS, rr.TextDocument(document_text(moments), media_type="text/markdown"))
            self._stream.finish(self._provenance.record(complete=complete), self._view())
        except OSError as problem:
            output.discard()
            raise output.error(problem) from problem
        output.publish(complete)

    def _send_shapes(self) -> None:
        """Log the meshes of all bodies, and the colours and sizes of contacts and vectors."""
        import rerun as rr

        world = self._world
        self._stream.log_static(SCENE, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        self._stream.log_static(LEGEND, rr.TextDocument(legend(), media_type="text/markdown"))
        for joint, name in self._joints:
            for root in (JOINTS, RECORDED_JOINTS):
                self._stream.log_static((*root, *joint), rr.SeriesLines(names=name, widths=1.5))
        palette = colours.colours_of_trees(world.facts)
        self._own_colours = [palette[world.tree_names[tree]] for tree in world.scene.bodies.tree]
        for body, (vertices, faces) in enumerate(world.triangles):
            if len(faces) == 0:
                continue
            points, corners, normals = with_vertex_normals(vertices, faces)
            mesh = rr.Mesh3D(vertex_positions=points, triangle_indices=corners, vertex_normals=normals)
            self._stream.log_static(CORRECTED_BODIES + self._names[body], mesh)
            if world.scene.bodies.role[body] == DRIVEN:  # its colour varies
                self._stream.log_static(RECORDED_BODIES + self._names[body], mesh)
            else:
                colour = rr.Mesh3D.from_fields(albedo_factor=self._own_colours[body])
                self._stream.log_static(CORRECTED_BODIES + self._names[body], colour)
        points3d = rr.Points3D.from_fields(colors=[colours.CONTACT], radii=[0.002])
        self._stream.log_static((*CONTACTS, "points"), points3d)
        for path, paint in (((*CONTACTS, "normals"), colours.CONTACT), (DEPTHS, colours.DEPTH)):
            self._stream.log_static(path, rr.Arrows3D.from_fields(colors=[paint], radii=[0.001]))

    def _send_batch(self, results: ResultColumns) -> None:
        """Send frames."""
        recorded, corrected = results.recorded, results.corrected
        if self._static is None:
            self._static = corrected[0].copy()
            self._first_ns, self._first_frame = results.frames[0].time_ns, results.frames[0].index
            self._uses_unix_time = self._first_ns >= UNIX_TIME_START
            self._send_static(corrected[0])
        times = Times(results.indices, results.times_ns, self._uses_unix_time)
        self._send_poses(times, corrected)
        self._send_states(times, recorded, corrected, frame_columns.in_contact(results, len(self._names)))
        self._send_contacts(times, results)
        self._send_plots(times, results)
        self._send_columns(times, results)
        self._send_log(times, results)
        self._view_statistics.add(results)
        self._last_result = results.result(len(results) - 1)
        self._sent_frames += len(results)

    def _send_static(self, poses: Floats) -> None:
        import rerun as rr

        for body in np.flatnonzero(~self._is_moving):
            pose = rr.Transform3D(translation=poses[body, :3], quaternion=rr.Quaternion(xyzw=poses[body, 3:]))
            self._stream.log_static(CORRECTED_BODIES + self._names[body], pose)

    def _send_poses(self, times: Times, corrected: Floats) -> None:
        for body in self._moving:
            before = None if self._last_result is None else self._last_result.corrected[body]
            rows = np.flatnonzero(frame_columns.changed_rows(corrected[:, body], before))
            self._stream.send(CORRECTED_BODIES + self._names[body], times, rows, _transforms(corrected[rows, body]))

    def _send_states(self, times: Times, recorded: Floats, corrected: Floats, in_contact: NDArray[np.bool_]) -> None:
        """Send the colours of driven bodies where they change, and the recorded poses (ghosts) where they are visible."""
        import rerun as rr

        is_corrected = frame_columns.is_corrected(recorded, corrected)
        states = np.where(in_contact, _IN_CONTACT, np.where(is_corrected, _CORRECTED, _FREE)) + 4 * is_corrected
        for body in self._drawn_driven:
            before = None if self._last_states is None else self._last_states[body : body + 1]
            rows = np.flatnonzero(frame_columns.changed_rows(states[:, body : body + 1], before))
            palette = np.array([self._own_colours[body], colours.CORRECTED, colours.IN_CONTACT], np.uint8)
            shown = palette[states[rows, body] % 4]
            ghosts = np.array([colours.HIDDEN, colours.GHOST], np.uint8)[states[rows, body] // 4]
            shown_path, ghost_path = CORRECTED_BODIES + self._names[body], RECORDED_BODIES + self._names[body]
            self._stream.send(shown_path, times, rows, rr.Mesh3D.columns(albedo_factor=shown))
            self._stream.send(ghost_path, times, rows, rr.Mesh3D.columns(albedo_factor=ghosts))
            rows = np.flatnonzero(is_corrected[:, body])
            self._stream.send(ghost_path, times, rows, _transforms(recorded[rows, body]))
        self._last_states = states[-1]

    def _send_contacts(self, times: Times, results: ResultColumns) -> None:
        import rerun as rr

        last = self._last_result
        before = 1 if last is None else len(last.contacts.depth)  # the first frame says that there are none
        rows, counts = frame_columns.rows_with_content(results.contact_counts, before)
        if len(rows):
            points, arrows = frame_columns.contact_arrows(results, None if last is None else last.frame.time_ns)
            self._stream.send(
                (*CONTACTS, "points"), times, rows, rr.Points3D.columns(positions=points).partition(counts)
            )
            columns = rr.Arrows3D.columns(origins=points, vectors=arrows).partition(counts)
            self._stream.send((*CONTACTS, "normals"), times, rows, columns)
        before = 1 if last is None else len(last.penetrations.largest)
        rows, counts = frame_columns.rows_with_content(results.penetration_counts, before)
        if len(rows):
            origins, arrows = frame_columns.depth_arrows(results)
            columns = rr.Arrows3D.columns(origins=origins, vectors=arrows).partition(counts)
            self._stream.send(DEPTHS, times, rows, columns)

    def _send_plots(self, times: Times, results: ResultColumns) -> None:
        import rerun as rr

        every = np.arange(len(results))
        plots = frame_columns.plot_values(results)
        if self._timing:
            stages = frame_columns.stage_times(results, STAGE_DEPTH)
            if "step" in stages:
                usual = float(np.percentile(stages["step"], 97))
                self._stages_us = max(self._stages_us, AXIS_HEADROOM * usual)
            plots |= {f"stages_us/{name}": values for name, values in stages.items()}
        for name, values in plots.items():
            path = PLOTS + tuple(name.split("/"))
            if name not in self._plotted:
                self._plotted.add(name)
                self._stream.log_static(
                    path, rr.SeriesLines(names=path[-1].removeprefix("step."), widths=1.5, colors=LINES.get(name))
                )
            self._stream.send(path, times, every, rr.Scalars.columns(scalars=values))

    def _send_columns(self, times: Times, results: ResultColumns) -> None:
        """Send corrected and recorded joint values (rad or m), the fields of the metrics and the flags, as columns to query."""
        import rerun as rr

        every = np.arange(len(results))
        angles = np.stack([frame.angles for frame in results.frames])
        for joint, (path, _) in enumerate(self._joints):
            corrected, recorded = np.ascontiguousarray(results.angles[:, joint]), np.ascontiguousarray(angles[:, joint])
            self._stream.send((*JOINTS, *path), times, every, rr.Scalars.columns(scalars=corrected))
            self._stream.send((*RECORDED_JOINTS, *path), times, every, rr.Scalars.columns(scalars=recorded))
        fields = dict(results.metrics)
        flags = {name: (fields["flags"] & bit) != 0 for bit, name in FLAG_NAMES.items()}
        for entity, values in ((METRICS, fields), (FLAGS, flags)):
            columns = {name: _one_a_row(column) for name, column in values.items()}
            self._stream.send(entity, times, every, rr.AnyValues.columns(**columns))

    def _send_log(self, times: Times, results: ResultColumns) -> None:
        import rerun as rr

        lines = [
            (row, _LEVELS[level], text)
            for row, messages in sorted(results.messages.items())
            for level, text in messages
        ]
        if lines:
            self._has_log_lines = True
            rows, levels, texts = zip(*lines, strict=True)
            self._stream.send(LOG, times, np.array(rows), rr.TextLog.columns(text=texts, level=levels))
        if moments := sorted((m for of_frame in results.moments.values() for m in of_frame), key=lambda m: m.frame):
            self._has_log_lines = True
            at = Times(
                np.array([m.frame for m in moments]), np.array([m.time_ns for m in moments]), self._uses_unix_time
            )
            columns = rr.TextLog.columns(text=[log_text(m) for m in moments], level=["INFO"] * len(moments))
            self._stream.send(LOG, at, np.arange(len(moments)), columns)

    def _view(self) -> Blueprint:
        """The blueprint, with a viewpoint chosen for the whole recording."""
        elapsed = self._last_result.frame.time_ns - self._first_ns if self._last_result is not None else 0
        rate = 1e9 * (self._sent_frames - 1) / elapsed if elapsed > 0 else 60.0
        last = self._last_result.frame.index if self._last_result is not None else 0
        return blueprint(
            self._view_statistics.viewpoint(),
            rate=rate,
            frames=(self._first_frame, last),
            stages_us=self._stages_us,
            log=self._has_log_lines,
            joints=bool(self._joints),
            moments=bool(self._worst.moments()),
        )


def _transforms(poses: Floats) -> Any:
    """Columns of poses (n, 7)."""
    import rerun as rr

    return rr.Transform3D.columns(translation=poses[:, :3], quaternion=poses[:, 3:])


def _one_a_row(values: NDArray[np.generic]) -> Any:
    """A column of numbers (n,) as the SDK makes it of a list of lists, in a hundredth of the time."""
    import pyarrow as pa

    return pa.ListArray.from_arrays(pa.array(np.arange(len(values) + 1, dtype=np.int32)), pa.array(values))
