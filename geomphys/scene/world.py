"""The world of a replay: the scene's arrays with their names, input topics and display geometry."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from geomphys.scene.arrays import Floats, Ints, Scene
from geomphys.scene.findings import Findings
from geomphys.scene.scene_facts import SceneFacts

if TYPE_CHECKING:
    from geomphys.scene.scene_file import SceneFile
    from geomphys.scene.topic_sources import JointSource, KeypointSource, PalmOrientation, RootSource
    from geomphys.storage.remote_files import AnyPath


@dataclass(frozen=True, kw_only=True, eq=False)
class World:
    """A scene with its names, input topics and display geometry: everything that a replay needs besides a log.

    Immutable, and equal to itself alone, so that derived values can be cached with it (`functools.lru_cache`).
    """

    facts: SceneFacts
    path: AnyPath
    scene: Scene
    tree_names: tuple[str, ...]  # (T,)
    body_names: tuple[str, ...]  # (B,) `object`, `object/link` or `avatar/link`: names of /contacts
    frame_names: tuple[str, ...]  # (B,) child frame ids of /tf: the link's name alone if there is one avatar
    dof_names: tuple[str, ...]  # (Q,) joint names
    avatar_count: int
    roots: tuple[RootSource, ...]
    joints: tuple[JointSource, ...]
    urdfs: dict[str, AnyPath]  # tree name -> URDF
    zero_pose_overlaps: tuple[
        tuple[str, str], ...
    ]  # body names of pairs excluded because they overlap in the zero pose
    triangles: tuple[
        tuple[Floats, Ints], ...
    ]  # (B,) display mesh of each body: vertices (n, 3), faces (m, 3), body frame
    collision_triangles: tuple[
        tuple[Floats, Ints], ...
    ]  # (B,) original collision geometry, tessellated where it is a primitive
    keypoints: tuple[KeypointSource, ...] = ()
    keypoint_scale: dict[str, dict[str, float]] = field(default_factory=dict)  # avatar -> branch -> factor of lengths
    palm_orientations: dict[str, PalmOrientation] = field(default_factory=dict)  # of avatars that are fitted to points
    findings: Findings = field(default_factory=Findings)  # warnings and notes for the user
    source_files: tuple[AnyPath, ...] = ()  # absolute paths of all files it was loaded from
    parsed_file: SceneFile | None = None  # None: it came from the cache

    @property
    def file(self) -> SceneFile:
        """The scene file; one that came from the cache is read. Raises SceneError."""
        if self.parsed_file is not None:
            return self.parsed_file
        from geomphys.scene.scene_file import load_scene_file  # with the models that check it

        return load_scene_file(self.path)
