"""Kinematic chains of an avatar: those of the scene file, else derived from the tree."""

from __future__ import annotations

from difflib import get_close_matches

from geomphys.errors import SceneError
from geomphys.scene.scene_file import AvatarTable
from geomphys.scene.skeleton import Skeleton
from geomphys.storage.remote_files import AnyPath


def named_chains(avatar: AvatarTable, skeleton: Skeleton, path: AnyPath) -> list[tuple[int, ...]]:
    """Link indices of each `[[avatar.chain]]`, from the child of its base to its tip.

    Raises SceneError (avatar, chain) for unknown links, a tip that is no descendant of the base, a chain without a
    moving joint, and a link in two chains.
    """
    chains: list[tuple[int, ...]] = []
    owner: dict[int, str] = {}
    for chain in avatar.chain:
        where = f"{path}: chain {chain.name!r} of avatar {avatar.name!r}"
        base, tip = (link_index(skeleton, name, where) for name in (chain.base, chain.tip))
        links = [tip]
        while links[-1] != base:
            joint = skeleton.joints[links[-1]]
            if joint is None:
                raise SceneError(f"{where}: the tip {chain.tip!r} is no descendant of the base {chain.base!r}")
            links.append(joint.parent)
        links = links[-2::-1]
        if not any(_moves(skeleton, link) for link in links):
            raise SceneError(f"{where}: no joint moves between {chain.base!r} and {chain.tip!r}")
        for link in links:
            if link in owner:
                name = skeleton.links[link].name
                raise SceneError(f"{where}: the link {name!r} belongs to chain {owner[link]!r} already")
            owner[link] = chain.name
        chains.append(tuple(links))
    return chains


def suggested_chains(skeleton: Skeleton) -> list[tuple[int, ...]]:
    """Chains derived from the tree when the scene file names none; same form as `named_chains`.

    A *limb* is a branch with at least two moving joints, a *fork* a link where two or more limbs begin. A chain runs
    from the last fork above a tip (or the root) down the path with the most moving joints: a hand gets its fingers,
    each attached to the palm, a body its arms, legs and neck. Where exactly two limbs begin at the end of a longer one
    (thumb and fingers at the end of an arm), the chain continues through the longer of the two and the other is
    attached to it. A tree without limbs has one chain for each branch with a joint (fingers of one joint).
    """
    return _branches(skeleton, 2) or _branches(skeleton, 1)


def _branches(skeleton: Skeleton, min_joints: int) -> list[tuple[int, ...]]:
    """`suggested_chains` with limbs of at least `min_joints` moving joints."""
    children = skeleton.children()
    longest = [0] * len(skeleton.links)  # most moving joints on a path down from a link
    for link in reversed(range(len(skeleton.links))):
        longest[link] = max((longest[c] + _moves(skeleton, c) for c in children[link]), default=0)
    chains: list[tuple[int, ...]] = []
    pending: list[int] = [0]  # links that chains may be attached to
    while pending:
        base = pending.pop(0)
        for start in children[base]:
            links, count = [start], int(_moves(skeleton, start))
            ended = False
            while children[links[-1]]:
                branches = children[links[-1]]
                lengths = [longest[c] + _moves(skeleton, c) for c in branches]
                limb_lengths = [length for length in lengths if length >= min_joints]
                if len(limb_lengths) >= 3 or (len(limb_lengths) == 2 and count <= max(limb_lengths)):
                    pending.append(links[-1])
                    ended = True
                    break
                best = lengths.index(max(lengths))
                links.append(branches[best])
                count += _moves(skeleton, branches[best])
            if not ended and count >= min_joints:
                chains.append(tuple(links))
    return chains


def link_index(skeleton: Skeleton, name: str, where: str) -> int:
    """Index of a link by name; SceneError with a suggestion if there is none."""
    found = skeleton.index(name)
    if found is None:
        close = get_close_matches(name, [link.name for link in skeleton.links], n=1)
        hint = f", did you mean {close[0]!r}?" if close else ""
        raise SceneError(f"{where}: no link {name!r} in {skeleton.path}{hint}")
    return found


def _moves(skeleton: Skeleton, link: int) -> bool:
    """Whether the joint above a link is independent: neither fixed nor a mimic joint."""
    joint = skeleton.joints[link]
    return joint is not None and joint.dof >= 0 and joint.mimics is None
