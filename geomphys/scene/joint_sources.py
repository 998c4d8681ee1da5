"""Makes the input sources of joint values and of tracked points from the tables of the trees, checked against their URDFs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import SceneError
from geomphys.scene.chains import link_index
from geomphys.scene.recording_tables import JointsTable
from geomphys.scene.scene_file import AvatarTable
from geomphys.scene.topic_sources import JointSource, KeypointSource
from geomphys.scene.trees import Tree
from geomphys.storage.remote_files import AnyPath


def joint_sources(trees: Sequence[Tree], dof_start: NDArray[np.int64], path: AnyPath) -> Iterator[JointSource]:
    """Sources of recorded joint values; `dof_start` (T + 1,) is the first column of the angles of each tree.

    Raises SceneError for a joint that a tree does not have.
    """
    for t, tree in enumerate(trees):
        table: JointsTable | None = tree.table.joints
        if table is None or tree.skeleton is None:
            continue
        mimics = tuple(j.name for j in tree.skeleton.joints if j is not None and j.dof >= 0 and j.mimics is not None)
        names = [*tree.skeleton.dof_names, *mimics]
        for recorded, joint in table.rename.items():
            _check_joint(joint, names, f"joints.rename.{recorded} = {joint!r}", tree, path)
        for key in ("sign", "scale", "offset"):
            for joint, value in getattr(table, key).items():
                what = f"joints.{key}.{joint} = {value}"
                _check_joint(joint, names, what, tree, path)
                if joint in mimics:
                    raise SceneError(
                        f"{path}: {tree.name!r}: {what}: this joint follows another by the URDF, its recorded values "
                        "are not used: leave it out"
                    )
        factors = {joint: float(value) for joint, value in table.scale.items()}
        for joint, value in table.sign.items():
            factors[joint] = value * factors.get(joint, 1.0)
        yield JointSource(
            tree=t,
            topic=table.topic,
            unit=table.unit,
            rename=dict(table.rename),
            dofs={name: int(dof_start[t]) + k for k, name in enumerate(tree.skeleton.dof_names)},
            mimics=mimics,
            ignore=table.ignore,
            factors=factors,
            offsets=dict(table.offset),
            delay=table.delay,
            continuous=tuple(
                j.name
                for j in tree.skeleton.joints
                if j is not None and j.type == "continuous" and j.dof >= 0 and j.mimics is None
            ),
        )


def keypoint_sources(trees: Sequence[Tree], path: AnyPath) -> Iterator[KeypointSource]:
    """Sources of tracked points. Raises SceneError for a link that a tree does not have."""
    for t, tree in enumerate(trees):
        table = tree.table.keypoints if isinstance(tree.table, AvatarTable) else None
        if table is None or tree.skeleton is None:
            continue
        for point, link in table.links.items():
            link_index(tree.skeleton, link, f"{path}: avatar {tree.name!r}: keypoints.links.{point}")
        yield KeypointSource(
            tree=t,
            topic=table.topic,
            layout=table.layout,
            links=dict(table.links),
            scale=table.scale,
            fits_root="root" not in tree.table.model_fields_set,
            delay=table.delay,
        )


def _check_joint(joint: str, names: Sequence[str], what: str, tree: Tree, path: AnyPath) -> None:
    """Raise SceneError unless `joint` is a moving joint of the tree."""
    if joint in names or tree.skeleton is None:
        return
    close = get_close_matches(joint, names, n=1)
    hint = f"did you mean {close[0]!r}?" if close else f"it has {', '.join(names[:8])}"
    raise SceneError(f"{path}: {tree.name!r}: {what}: no moving joint of this name in {tree.skeleton.path}, {hint}")
