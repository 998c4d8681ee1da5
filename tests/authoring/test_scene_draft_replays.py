"""What `init` drafts can be replayed as it is: made-up models and logs of many kinds through init, check and replay."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from geomphys_cli.main import run

from tests.authoring.test_scene_draft import HAND, twin
from tests.recording.log_files import glove, joints, pose, transforms, write_log

LIMIT = 'lower="0" upper="1.6"'
MODELS = {
    "hand": HAND,
    "limits of 0": HAND.replace(LIMIT, 'lower="0" upper="0"').replace(
        'lower="-0.5" upper="1.6"', 'lower="0" upper="0"'
    ),
    "continuous": HAND.replace('type="revolute"', 'type="continuous"'),
    "sliding": HAND.replace('type="revolute"', 'type="prismatic"'),
    "mimic": HAND.replace(f"<limit {LIMIT}", f'<mimic joint="index_mcp_flex"/><limit {LIMIT}'),
    "other names": HAND.replace("index_mcp_flex", "FFJ2").replace("index_pip_flex", "FFJ1"),
    "no names": HAND.replace("index_mcp_flex", "alpha").replace("index_pip_flex", "beta"),
    "one link": HAND.split("<link")[0] + "<link" + HAND.split("<link")[1] + "</robot>",
    "tall": HAND.replace("0.07 0 0", "0 0 1.1"),
}
FLEX = ("index_mcp_flex", "index_pip_flex")
Items = Callable[[int, float, float], list[object]]
LOGS: dict[str, Items] = {
    "as they are": lambda k, t, w: [pose("/wrist", t, place(k)), joints("/glove", t, dict.fromkeys(FLEX, w))],
    "degrees": lambda k, t, w: [pose("/wrist", t, place(k)), joints("/glove", t, dict.fromkeys(FLEX, 57.3 * w))],
    "opposite sign": lambda k, t, w: [pose("/wrist", t, place(k)), joints("/glove", t, dict.fromkeys(FLEX, -w))],
    "sensor": lambda k, t, w: [pose("/wrist", t, place(k)), joints("/glove", t, dict.fromkeys(FLEX, 900 * w))],
    "poses only": lambda k, t, w: [pose("/wrist", t, place(k)), pose("/head", t, place(k + 9))],
    "joints only": lambda k, t, w: [joints("/glove", t, {"IndexMCPStretch": w, "PinkyMCPStretch": w})],
    "tf": lambda k, t, w: [transforms("/tf", t, {"palm": place(k)}), joints("/a/b", t, {"q1": w, "q2": w})],
    "gloves": lambda k, t, w: [glove("/manus", t, {"IndexMCPStretch": 50 * w}, side=s) for s in ("Left", "Right")],
    "two hands": lambda k, t, w: [
        *(pose(f"/tracker/{s}", t, place(k)) for s in ("left", "right")),
        joints("/glove", t, {f"{s}_{n}": w for s in "lr" for n in FLEX}),
    ],
    "y up in mm": lambda k, t, w: [
        pose("/optitrack/wrist", t, twin(place(k), "y", "mm")), joints("/glove", t, dict.fromkeys(FLEX, w)),
    ],
    "requests": lambda k, t, w: [pose("/wrist_target", t, place(k)), joints("/joint_commands", t, dict.fromkeys(FLEX, w))],
}  # fmt: skip


def place(k: int) -> tuple[float, ...]:
    return (0.1 + 0.3 * math.sin(k / 6), 0.2 + 0.4 * math.sin(k / 9), 0.9 + 0.1 * math.sin(k / 5), 0.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize("model", MODELS)
def test_what_is_drafted_is_replayed(model, tmp_path, capsys) -> None:
    urdf, scene, out = tmp_path / "model.urdf", tmp_path / "scene.toml", tmp_path / "out.mcap"
    urdf.write_text(MODELS[model])
    for name, items in LOGS.items():
        log = tmp_path / f"{name}.mcap"
        write_log(log, [i for k in range(24) for i in items(k, 1 + k / 50, 0.5 + 0.3 * math.sin(k / 7))])
        for words in (
            ["init", str(log), "--urdf", str(urdf), "-o", str(scene), "--force"],
            ["check", str(log), "--scene", str(scene)],
            ["-q", "replay", str(log), "--scene", str(scene), "-o", str(out), "--force"],
        ):
            code = run(words)
            said = capsys.readouterr()
            assert "Traceback" not in said.err
            if words[0] == "init" and "cannot be replayed yet" in said.out:
                assert run(["check", str(log), "--scene", str(scene)]) == 1, name
                assert not any(line.startswith("topic") for line in scene.read_text().splitlines())
                break
            assert code == 0, (name, words, said.err, scene.read_text())
