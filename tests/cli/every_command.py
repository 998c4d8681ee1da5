"""Words for every command, on small inputs: for tests that hold of all of them."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from geomphys_cli.main import COMMANDS

from tests.cli.press import Case
from tests.made import Results


class Call(NamedTuple):
    """A command that is run."""

    words: list[str]
    writes: str = ""  # name of its output in the folder, if it has one
    codes: tuple[int, ...] = (0,)  # how it may end: `diff` of two that differ, and where there is no graphics driver


def every_command(furnished: Case, pressed: Results, landed: Results, root: Path, folder: Path) -> dict[str, Call]:
    """One call of each command by its name, and of those that write more than one kind of file by other names.

    Outputs go below `folder`, which must be there; ``calibrate`` writes into a copy of its scene there.
    """
    hand, cup, cube = root / "recordings/webxr_hand.mcap", furnished.folder / "cup.urdf", furnished.folder / "cube.obj"
    scene = folder / "hand.toml"
    scene.write_text((root / "assets/scenes/webxr_hand.toml").read_text().replace('"../', f'"{root}/assets/'))
    replay: list[object] = ["replay", furnished.log, "-s", furnished.scene, "--force", "-q", "-o", folder / "a.mcap"]
    flat = ["--flat", "1:2", "--on", "table", "--only", "surface", "--write", "-q"]
    small = ["--size", 64, 64, "--force", "-q"]
    bench = ["--only", "wall_slide", "--no-depths", "--no-scaling", "--repeats", 1]
    calls: dict[str, tuple[list[object], str]] = {
        "demo": (["demo", "-O", folder / "demo", "--force"], "demo/gallery_hand.mcap"),
        "init": (["init", furnished.log, "--urdf", cup, "-o", folder / "a.toml", "--force", "-q"], "a.toml"),
        "calibrate": (["calibrate", hand, "-s", scene, *flat], "hand.toml"),
        "replay": ([*replay, "--rrd", folder / "a.rrd"], "a.mcap"),
        "ros2": ([*replay, "--ros2"], "a.mcap"),
        "batch": (["batch", furnished.log, "-s", furnished.scene, "-O", folder, "--force", "-q"], "press.mcap"),
        "diff": (["diff", pressed.out, pressed.raised, "--html", folder / "a.html", "--rrd", folder / "d.rrd", "--force",
                  "-q"], "a.html"),
        "stats": (["stats", pressed.out], ""),
        "plot": (["plot", pressed.out, "-o", folder / "a.png", "--force", "-q"], "a.png"),
        "audit": (["audit", pressed.out, "--max-penetration", 5, "--junit", folder / "a.xml", "--force", "-q"], "a.xml"),
        "check": (["check", furnished.log, "-s", furnished.scene], ""),
        "info": (["info", furnished.log], ""),
        "view": (["view", pressed.out, "--web"], ""),
        "snapshot": (["snapshot", pressed.out, "-o", folder / "b.png", *small], "b.png"),
        "video": (["video", pressed.out, "-o", folder / "a.gif", "--to", "0.1", "-j", 1, *small], "a.gif"),
        "export": (["export", pressed.out, "-o", folder, "--force", "-q"], "poses.parquet"),
        "lerobot": (["export", landed.out, "--lerobot", folder / "set", "-q"], "set/meta/info.json"),
        "foxglove": (["export", pressed.out, "--foxglove", folder / "a.json", "--force", "-q"], "a.json"),
        "decompose": (["decompose", cube, "-o", folder / "a.glb", "--force", "-q"], "a.glb"),
        "bench": (["bench", *bench], ""),
        "schema": (["schema"], ""),
        "completion": (["completion", "bash"], ""),
    }  # fmt: skip
    assert {str(words[0]) for words, _ in calls.values()} == set(COMMANDS), "a command has no call here"
    codes = {"diff": (1,)}
    return {
        name: Call([str(word) for word in words], writes, codes.get(name, (0,)))
        for name, (words, writes) in calls.items()
    }
