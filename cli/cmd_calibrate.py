"""``geomphys calibrate``: finds tracker offset, heights of surfaces and lags from a log."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from geomphys.config import MAX_SECONDS

from .command import command, current_terminal
from .options import INPUT, json_option, scene_option
from .terminal import fields, heading

if TYPE_CHECKING:
    from geomphys.authoring.calibration import Calibration, Part

    from .terminal import Terminal


class StretchType(click.ParamType[tuple[float, float]]):
    """``T0:T1``, seconds."""

    name = "T0:T1"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        """Parse a stretch."""
        try:
            begin, end = (float(part) for part in str(value).split(":"))
        except ValueError:
            self.fail(f"{value!r} is not T0:T1 in seconds, as 2.5:4", param, ctx)
        if not 0 <= begin < end <= MAX_SECONDS:
            self.fail(f"{value!r}: is no stretch from 0 s on that ends after it begins", param, ctx)
        return begin, end


class TouchType(click.ParamType[tuple[float, str]]):
    """``T`` or ``T=LINK``."""

    name = "T[=LINK]"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, str]:
        """Parse a touch."""
        time, _, link = str(value).partition("=")
        try:
            seconds = float(time)
        except ValueError:
            self.fail(f"{value!r} is not a time in seconds, with or without a link: 3.2 or 3.2=index_tip", param, ctx)
        if not 0 <= seconds <= MAX_SECONDS:
            self.fail(f"{value!r}: is no time from the first frame on, in seconds", param, ctx)
        return seconds, link


@command(
    "calibrate",
    examples="""
    geomphys calibrate hand.mcap --scene desk.toml --flat 2:4 --flat 6:8 --on table
    geomphys calibrate hand.mcap --scene desk.toml --flat 2:4 --on table --only surface --write
    geomphys calibrate hand.mcap --scene desk.toml --touch 3.2=index_tip --touch 5=thumb_tip --on table --json
    """,
)
@click.argument("log", type=INPUT)
@scene_option
@click.option(
    "--flat",
    "flats",
    type=StretchType(),
    multiple=True,
    help="From when to when the hand lay flat, s from the first frame.",
)
@click.option(
    "--touch", "touches", type=TouchType(), multiple=True, help="When a link touched; default the lowest one."
)
@click.option(
    "--on", multiple=True, metavar="OBJECT", help="The object that was touched: its height and tilt are sought too."
)
@click.option(
    "--only",
    type=click.Choice(["offset", "surface", "fingers"]),
    help="Seek only this: the others are right in the scene file.",
)
@click.option(
    "--fingers", is_flag=True, help="Seek also the length of each finger that --touch names a link of; of all without."
)
@click.option("--avatar", metavar="NAME", help="The avatar. Default: the first.")
@click.option("--write", is_flag=True, help="Write what the log shows into SCENE; its comments stay.")
@json_option
def calibrate(
    log: Path,
    scene: Path,
    flats: tuple[tuple[float, float], ...],
    touches: tuple[tuple[float, str], ...],
    on: tuple[str, ...],
    only: Part | None,
    fingers: bool,
    avatar: str | None,
    write: bool,
    as_json: bool,
) -> None:
    """Find where the tracker sits on the hand, how high and tilted a surface is, and the lag between topics.

    The hand lay flat, or a link touched, at the times that you name; without any, slow moments near a surface count.
    Penetration and float are made zero alike. What the log does not show is named and left as it is.
    """
    import geomphys

    terminal = current_terminal()
    seek: set[Part] = {only} if only is not None else {"offset", "surface"}
    if fingers:
        seek.add("fingers")
    found = geomphys.calibrate(log, scene, flats=flats, touches=touches, on=on, seek=seek, avatar=avatar)
    if write and found.changes:
        found = found.write()
    if as_json:
        terminal.json(found.as_dict())
    else:
        _show(terminal, found, only, write)


def _show(terminal: Terminal, found: Calibration, only: Part | None, write: bool) -> None:
    """Print what was found, where it is from, what is left over and what the log does not show."""
    rows: list[tuple[str, list[str]]] = []
    changed = {(change.kind, change.name, change.key) for change in found.changes}

    def origin(*table: str) -> str:
        return "" if table in changed else ", as the scene has it"

    def within(text: str) -> float:
        return max((value for name, value in found.confidence.items() if name.startswith(text)), default=0.0)

    if found.offset_m is not None and found.offset_rpy_deg is not None:
        at = ", ".join(f"{1000 * v:.1f}" for v in found.offset_m)
        rpy = ", ".join(f"{round(v, 2) + 0.0:.2f}" for v in found.offset_rpy_deg)
        rows.append(("Offset", [f"[{at}] mm, rpy [{rpy}] degrees{origin('avatar', found.avatar, 'root')}"]))
        length, angle = within("offset along"), within("rotation of the offset")
        if length or angle:
            known = [f"{1000 * length:.1f} mm"] * bool(length) + [f"{angle:.2f} degrees"] * bool(angle)
            rows.append(("", [f"what of it is shown is known to {' and '.join(known)}"]))
    for name, surface in found.surfaces.items():
        length, angle = (within(f"{part} of {name!r}") for part in ("height", "tilt"))
        height = f"{1000 * surface.height_m:.1f} mm high{f' ± {1000 * length:.1f}' if length else ''}"
        height += f", tilted by {surface.tilt_deg:.2f}{f' ± {angle:.2f}' if angle else ''} degrees"
        rows.append((name, [height + origin("object", name, "")]))
    for finger, factor in found.finger_scale.items():
        length = within(f"length of {finger!r}")
        rows.append((finger, [f"{factor:.3f}{f' ± {length:.3f}' if length else ''} times as long"]))
    for topic, delay in found.delay_s.items():
        rows.append(("Delay", [f"{topic}: {1000 * delay:.1f} ms (correlation {found.correlation[topic]:.2f})"]))
    left = f"{1000 * found.residual_m:.2f} mm, {1000 * found.residual_p90_m:.2f} mm at the 90th percentile"
    if found.frames:
        rows.append(("Left over", [f"{left}, in {found.frames} frames of contact"]))
    else:
        rows.append(
            ("Contact", ["none: nowhere is the hand slow near a surface; say when it touches by --flat or --touch"])
        )
    if found.unobservable:
        rows.append(("Not shown", list(found.unobservable)))
    if found.written:
        rows.append(("Written", [found.scene]))
    elif not found.changes:
        rows.append(("Nothing", ["of this log changes the scene"]))
        if found.frames and found.offset_m is not None and found.surfaces and only is None:
            rows.append(
                (
                    "Next",
                    [
                        "--only surface, if the offset is right in the scene; --only offset, if the surface is",
                        "for both: touches of a hand that is turned in different ways",
                    ],
                )
            )
    elif not write:
        rows.append(("Next", ["--write puts this into the scene file"]))
    terminal.result(heading(Path(found.log).name, f" in {Path(found.scene).name}"), fields(rows))
