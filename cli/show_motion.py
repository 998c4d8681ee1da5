"""Shows measures of a whole motion, and the moments at which to look first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from .terminal import counted, printable

if TYPE_CHECKING:
    from rich.text import Text

    from geomphys.analysis.output_motion import OutputMotion
    from geomphys.results import Moment


def motion_rows(motion: OutputMotion) -> Iterator[tuple[str, str]]:
    """Yield label and text of the measures of a whole motion."""
    if motion.contacts_recorded:
        share = motion.contacts_kept / motion.contacts_recorded
        text = f"{share:.1%} kept of {motion.contacts_recorded:,} recorded contacts of fingertips"
        if motion.grasps_recorded:
            share = motion.grasps_kept / motion.grasps_recorded
            text += f"; {share:.1%} of {motion.grasps_recorded:,} grasps (thumb and a finger)"
        yield "Contacts", text
    if motion.deep_share:
        yield "Deep", f"{100.0 * motion.deep_share:.1f} % of the frames recorded more than 2 mm deep"
    if motion.intersection_volume_m3:
        yield (
            "Volume",
            f"{1e6 * motion.intersection_volume_m3:.3g} cm³ common to the bodies of the deepest recorded overlap",
        )
    spikes = "none"
    if motion.spikes:
        spikes = counted(motion.spikes, "frame")
        spikes += f", the largest of {1e3 * motion.spike_max_m:.3g} mm in frame {motion.spike_frame:,}"
    yield "Spikes", f"{spikes} (the correction steps by over 3 mm and three times the motion)"
    ratios = [
        f"{name} {rms:.2f} (RMS) and {p99:.2f} (p99)"
        for name, rms, p99 in (
            ("links", motion.jerk_rms_ratio, motion.jerk_p99_ratio),
            ("joints", motion.joint_jerk_rms_ratio, motion.joint_jerk_p99_ratio),
        )
        if rms is not None and p99 is not None
    ]
    if ratios:
        yield "Jerk", f"times the recorded one: {', '.join(ratios)}"


def moment_lines(moments: Sequence[Moment], output: str | None) -> list[str | Text]:
    """Return a line for each moment, and below those of a frame the command that shows it if there is an output."""
    from geomphys.output.worst_moments import command_text, figure_text

    lines: list[str | Text] = []
    frames = dict.fromkeys(moment.frame for moment in moments)
    for frame in frames:
        of_frame = [moment for moment in moments if moment.frame == frame]
        lines += [
            printable(f"{figure_text(moment)}, frame {moment.frame:,} ({moment.time_s:.2f} s)") for moment in of_frame
        ]
        if output is not None:
            lines.append(printable(f"  {command_text(of_frame[0], output)}"))
    return lines
