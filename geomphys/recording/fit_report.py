"""The report on a fit of joint values to points: how near they come, what has no link, what the points do not show."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geomphys.recording.display_names import join_names, printable
from geomphys.recording.keypoint_routes import KeypointRoute
from geomphys.scene.world import World

REPORTED_SHARE = 0.05
"""Share of the frames from which on it is reported that the points do not show a joint, or lie beyond its limits."""
FAR_M = 0.02
"""m; root mean square distance of a fit from which on it is a warning."""
MAX_NAMES = 8


@dataclass(frozen=True)
class JointShare:
    """A joint to which something happens in part of the frames."""

    joint: str
    share: float  # of the frames


@dataclass(frozen=True)
class FitReport:
    """The fit of one avatar."""

    avatar: str
    topic: str
    points: dict[str, str]  # point -> link
    left_out: tuple[str, ...]  # points without a link
    rms_m: float  # root mean square distance of the points from their links, over all frames
    largest_rms_m: float  # the same of the worst frame
    held_frames: int
    unshown: tuple[JointShare, ...]  # the points do not show them: there they stay near rest, or their last value
    limited: tuple[JointShare, ...]  # they are at a limit of the URDF, and the points lie beyond it
    oriented_by: str = ""  # point whose orientation counts for the pose of the root; "" for none

    def warnings(self) -> Iterator[str]:
        """What a user should know of the fit."""
        if self.rms_m > FAR_M:
            yield (
                f"the links of {printable(self.avatar)} stay {1000 * self.rms_m:.0f} mm (root mean square) from the points of "
                f"topic {printable(self.topic)}: check `layout` and `links`, the side of the hand, and `root`"
            )
        if self.unshown:
            yield (
                "joints that the points do not show in part of the frames, and that stay near rest there: "
                f"{_share_names(self.unshown)}"
            )
        if self.limited:
            yield (
                f"joints of {printable(self.avatar)} that the points take beyond the limits of its URDF in part of the frames: "
                f"links stay off the points there: {_share_names(self.limited)}"
            )


def _share_names(joints: tuple[JointShare, ...]) -> str:
    """Names and shares, the largest first."""
    ordered = sorted(joints, key=lambda joint: -joint.share)
    return join_names([f"{printable(j.joint)} ({100 * j.share:.0f} %)" for j in ordered], MAX_NAMES)


def fit_report(world: World, route: KeypointRoute) -> FitReport:
    """Report on the frames fitted so far."""
    fitter = route.fitter
    assert fitter is not None
    names = world.dof_names[route.columns]

    def shares(counts: NDArray[np.int64]) -> tuple[JointShare, ...]:
        share = counts / max(fitter.probed, 1)
        return tuple(JointShare(names[k], float(share[k])) for k in np.flatnonzero(share > REPORTED_SHARE))

    return FitReport(
        avatar=world.tree_names[route.tree],
        topic=route.input.source.topic,
        points={p.child: link for p, link in zip(route.input.points, route.input.links, strict=True)},
        left_out=route.input.left_out,
        rms_m=math.sqrt(fitter.squares / max(fitter.frames, 1)),
        largest_rms_m=fitter.largest,
        held_frames=route.held_frames,
        unshown=shares(fitter.unshown),
        limited=shares(fitter.limited),
        oriented_by="" if route.orientation is None else route.input.points[route.orientation.point].child,
    )
