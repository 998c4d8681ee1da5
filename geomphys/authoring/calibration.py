"""Calibrates a scene from a log: offset and tilt of a tracker, height and tilt of surfaces, lag between topics.

Only what the log shows is changed: of the translation and rotation of the offset, and of the height and tilt of each surface,
the part that is known to 2 mm and 1 degree whatever the rest may be. What is hidden from the frames of contact is named.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from geomphys.authoring.calibrated_scene import MARK, SceneChange, rpy_degrees, write_changes
from geomphys.authoring.contact_fit import ContactFit, fit_contacts
from geomphys.authoring.contact_frames import Recorded, Stretch, collect
from geomphys.authoring.contact_gaps import SHARE, Unknowns, moved_offset, moved_surface
from geomphys.authoring.finger_lengths import find_fingers, link_factors
from geomphys.authoring.known_changes import component_names, confidence, known_part, name_unknown
from geomphys.authoring.resting_frames import TOUCH_WINDOWS
from geomphys.authoring.time_shift import find_time_shift
from geomphys.config import Config
from geomphys.errors import ConfigError
from geomphys.load import load_world, scaled_to_log
from geomphys.numerics.transforms import matrix_from_pose, pose_from_matrix, rotation_from_quaternion
from geomphys.scene.arrays import FIXED
from geomphys.scene.topic_sources import RootSource
from geomphys.scene.world import World
from geomphys.storage.remote_files import AnyPath, as_path

Floats = NDArray[np.float64]
Part = Literal["offset", "surface", "fingers"]
"""What can be calibrated."""

MIN_CHANGE = 0.1
"""Units of a fit (0.2 mm, 0.1 degrees); a smaller change is none."""
MIN_DELAY = 0.001
"""s; a smaller change of a delay is none."""


@dataclass(frozen=True)
class Surface:
    """A surface after the calibration."""

    height_m: float  # of its top above its position, world z
    tilt_deg: float  # of its own axis that points up from the world's z
    position: tuple[float, ...]  # m, as the scene file has it
    orientation: tuple[float, ...]  # x y z w


@dataclass(frozen=True)
class Calibration:
    """What a log shows of a scene. Values that it does not show are those of the scene file."""

    log: str
    scene: str
    avatar: str
    offset_m: tuple[float, ...] | None  # position of the root link seen from the tracker; None without a tracker
    offset_rpy_deg: tuple[float, ...] | None
    surfaces: dict[str, Surface]
    finger_scale: dict[str, float]  # finger -> factor of its lengths, of those that were sought
    delay_s: dict[str, float]  # topic -> delay
    correlation: dict[str, float]  # topic -> correlation of its motion with that of the root
    frames: int  # of contact
    residual_m: float  # median of the gaps that are left
    residual_p90_m: float
    confidence: dict[str, float]  # value that is known -> half of the interval it is in: m, degrees, share of a length
    unobservable: tuple[str, ...]  # directions that the log does not show
    changes: tuple[SceneChange, ...]  # of the scene file
    written: bool = False

    def as_dict(self) -> dict[str, Any]:
        """All of it as plain values."""
        return dataclasses.asdict(self)

    def write(self) -> Calibration:
        """Write the changes into the scene file; its comments stay. Raises SceneError or OutputError."""
        write_changes(Path(self.scene), self.changes, self.comment)
        return dataclasses.replace(self, written=True)

    @property
    def comment(self) -> str:
        """The comment on values that are written."""
        return f"{MARK}{1000 * self.residual_m:.1f} mm left over in {self.frames} frames"


def calibrate(
    log: AnyPath | str,
    scene: AnyPath | str,
    *,
    flats: Sequence[tuple[float, float]] = (),
    touches: Sequence[tuple[float, str]] = (),
    on: Sequence[str] = (),
    seek: Collection[Part] = ("offset", "surface"),
    avatar: str | None = None,
    config: Config | None = None,
) -> Calibration:
    """Calibrate a scene from a log; nothing is written (see `Calibration.write`).

    Parameters
    ----------
    log, scene
        An MCAP file or ROS 2 bag directory, and a scene file.
    flats
        (begin, end) of stretches in which the hand lay flat, s from the first frame.
    touches
        (time, link) of touches; "" for the lowest link.
    on
        Objects whose height and tilt are sought: one for all stretches, or one for each of `flats`.
    seek
        What is sought; the rest is right as it is: the offset of the tracker, the surfaces, a factor of the lengths of each
        finger that `touches` name a link of, or of all if they name none.
    avatar
        Default: the first.
    config
        How the log is read.

    Raises
    ------
    ConfigError
        An object, avatar or link that is not there, or an object that cannot be moved.
    InputError
        The log or the scene is wrong, or a stretch has no frame.
    """
    log, scene, config = as_path(log), as_path(scene), config or Config()
    world = scaled_to_log(log, load_world(scene, mode=config.mode, seed=config.seed), config)
    tree = _avatar(world, avatar)
    if "fingers" in seek and any(source.tree == tree for source in world.keypoints):
        raise ConfigError(f"fingers: those of {world.tree_names[tree]!r} have the lengths of its points already")
    objects = [_surface(world, name) for name in on]
    movable = tuple(dict.fromkeys(objects)) if "surface" in seek else ()
    recorded = collect(log, world, config, tree, _stretches(world, flats, touches, objects), objects)
    root = next((s for s in world.roots if s.tree == tree), None)
    sought = find_fingers(world, tree, [link for _, link in touches if link]) if "fingers" in seek else ()
    unknowns = Unknowns(root is not None and "offset" in seek, movable, sought)
    fit = _fit(world, tree, root, recorded, unknowns)
    return _result(log, scene, world, tree, root, recorded, unknowns, fit)


def _avatar(world: World, name: str | None) -> int:
    avatars = world.tree_names[: world.avatar_count]
    if not avatars:
        raise ConfigError(f"{world.path}: has no avatar, so nothing can be calibrated")
    if name is not None and name not in avatars:
        raise ConfigError(f"avatar {name!r}: the scene has {', '.join(avatars)}")
    return 0 if name is None else avatars.index(name)


def _surface(world: World, name: str) -> int:
    """Tree of a named object at rest."""
    tables = {table.name: table for table in world.file.object}
    if name not in tables:
        raise ConfigError(f"on {name!r}: the scene has no such object; it has {', '.join(tables) or 'none'}")
    if tables[name].class_ != "fixed" or tables[name].topic is not None:
        raise ConfigError(
            f"on {name!r}: only an object that stands still can be calibrated: class fixed, without a topic"
        )
    return world.tree_names.index(name)


def _stretches(
    world: World, flats: Sequence[tuple[float, float]], touches: Sequence[tuple[float, str]], objects: Sequence[int]
) -> list[tuple[Stretch, int]]:
    """Stretches, each with the surface that is touched."""
    if not flats and not touches:
        return []
    fixed = [t for t in range(world.avatar_count, len(world.tree_names)) if world.scene.trees.role[t] == FIXED]
    surfaces = list(objects) or fixed[:1]
    if not surfaces or (not objects and len(fixed) > 1):
        names = ", ".join(world.tree_names[t] for t in fixed) or "none"
        raise ConfigError(f"which surface is touched? Name it with --on; fixed objects of the scene: {names}")
    if len(surfaces) not in (1, len(flats)):
        raise ConfigError(
            f"{len(surfaces)} objects for {len(flats)} stretches: name one object, or one for each --flat"
        )
    found = [(Stretch(begin, end), surfaces[k if len(surfaces) > 1 else 0]) for k, (begin, end) in enumerate(flats)]
    half = TOUCH_WINDOWS[0]
    return found + [(Stretch(time - half, time + half, link, True), surfaces[0]) for time, link in touches]


def _fit(world: World, tree: int, root: RootSource | None, recorded: Recorded, unknowns: Unknowns) -> ContactFit:
    if not recorded.contacts or unknowns.size == 0:
        pivots = {surface: np.zeros(3) for surface in unknowns.surfaces}
        return ContactFit(np.zeros(unknowns.size), np.diag(unknowns.expected**2), pivots, 0.0, 0.0)
    offset = np.eye(4) if root is None else matrix_from_pose([*root.position, *root.orientation])
    return fit_contacts(world, tree, offset, recorded.contacts, unknowns)


def _result(
    log: AnyPath,
    scene: AnyPath,
    world: World,
    tree: int,
    root: RootSource | None,
    recorded: Recorded,
    unknowns: Unknowns,
    fit: ContactFit,
) -> Calibration:
    shown, names = known_part(fit, unknowns), component_names(world, unknowns)
    changes: list[SceneChange] = []
    avatar = world.tree_names[tree]
    offset = None if root is None else [*root.position, *root.orientation]
    first = 6 * unknowns.offset
    if offset is not None and np.abs(shown[:first]).max(initial=0.0) > MIN_CHANGE:
        offset = list(pose_from_matrix(moved_offset(matrix_from_pose(offset), shown[:6])))
        changes.append(SceneChange("avatar", avatar, "root", tuple(offset[:3]), tuple(offset[3:])))
    surfaces = {}
    for k, surface in enumerate(unknowns.surfaces):
        part = shown[first + 3 * k : first + 3 * k + 3]
        before = world.scene.trees.rest[surface]
        pose = moved_surface(before, part, fit.pivots[surface])
        name = world.tree_names[surface]
        surfaces[name] = _described(world, surface, pose)
        if np.abs(part).max() > MIN_CHANGE:
            rotated = tuple(pose[3:]) if np.abs(part[1:]).max() > MIN_CHANGE else None
            changes.append(SceneChange("object", name, "", tuple(pose[:3]), rotated))
    lengths = dict(
        zip(
            unknowns.fingers, (1.0 + SHARE * float(v) for v in shown[first + 3 * len(unknowns.surfaces) :]), strict=True
        )
    )
    changed = {finger: round(factor, 4) for finger, factor in lengths.items() if abs(factor - 1.0) > SHARE * MIN_CHANGE}
    if changed:
        changes.append(SceneChange("avatar", avatar, "", link_factors=link_factors(world, tree, changed)))
    delays, correlation, hidden_lags = _delays(world, tree, root, recorded)
    changes += [SceneChange("avatar", avatar, key, delay=value) for key, value in delays.values() if value is not None]
    return Calibration(
        log=str(log),
        scene=str(scene),
        avatar=avatar,
        offset_m=None if offset is None else tuple(map(float, offset[:3])),
        offset_rpy_deg=None if offset is None else rpy_degrees(offset[3:]),
        surfaces=surfaces,
        finger_scale={finger.name: changed.get(finger, 1.0) for finger in unknowns.fingers},
        delay_s={topic: value for topic, (_, value) in delays.items() if value is not None},
        correlation=correlation,
        frames=len(recorded.contacts),
        residual_m=fit.residual,
        residual_p90_m=fit.percentile_90,
        confidence=confidence(fit, unknowns, names),
        unobservable=(*name_unknown(names, fit.covariance), *hidden_lags),
        changes=tuple(changes),
    )


def _described(world: World, surface: int, pose: Floats) -> Surface:
    """A surface at a pose (7,)."""
    rotation = rotation_from_quaternion(pose[3:])
    first, last = world.scene.trees.body_start[surface : surface + 2]
    vertices = np.concatenate([world.collision_triangles[b][0] for b in range(first, last)])
    up = rotation[2]  # the world's z seen from the object
    tilt = float(np.degrees(np.arccos(min(float(np.abs(up).max()), 1.0))))
    axis = np.eye(3)[int(np.abs(up).argmax())] * np.sign(up[int(np.abs(up).argmax())])
    top = float((vertices @ axis).max()) * float(np.abs(up).max())
    return Surface(float(pose[2]) + top, tilt, tuple(map(float, pose[:3])), tuple(map(float, pose[3:])))


def _delays(
    world: World, tree: int, root: RootSource | None, recorded: Recorded
) -> tuple[dict[str, tuple[str, float | None]], dict[str, float], list[str]]:
    """Topic -> key of its table and new delay (None: as it is); correlations; lags that the log does not show."""
    delays: dict[str, tuple[str, float | None]] = {}
    correlation: dict[str, float] = {}
    hidden: list[str] = []
    followed = [("joints", s.topic, s.delay) for s in world.joints if s.tree == tree]
    followed += [("keypoints", s.topic, s.delay) for s in world.keypoints if s.tree == tree]
    for key, topic, delay in followed:
        if root is None or topic == root.topic:
            continue
        speeds = recorded.points if key == "keypoints" else recorded.joints
        if len(speeds) != len(recorded.times):
            speeds = recorded.joints
        found = find_time_shift(
            np.array(recorded.times), [np.array(recorded.linear), np.array(recorded.angular)], np.array(speeds)
        )
        correlation[topic] = found.correlation
        if not found.is_shown:
            hidden.append(f"delay of {topic}")
            continue
        delays[topic] = (key, round(delay - found.seconds, 4) if abs(found.seconds) >= MIN_DELAY else delay)
    return delays, correlation, hidden
