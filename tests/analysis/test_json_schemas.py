"""What commands print with ``--json`` is what their JSON Schema says."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
import pytest
import trimesh
from geomphys_cli.cmd_schema import OUTPUTS
from geomphys_cli.main import COMMANDS, cli, run
from jsonschema import Draft202012Validator, ValidationError

import geomphys
from geomphys.analysis.json_schemas import JSON_OUTPUTS
from tests.made import Results

Printed = dict[str, list[Any]]


@pytest.fixture(scope="module")
def printed(pressed: Results, landed: Results, root: Path, tmp_path_factory: pytest.TempPathFactory) -> Printed:
    """Name of a schema -> what was really printed."""
    folder = tmp_path_factory.mktemp("printed")

    def call(*words: object, code: int = 0) -> Any:
        out = folder / "stdout"
        with out.open("w") as stream, pytest.MonkeyPatch.context() as patched:
            patched.setattr("sys.stdout", stream)
            assert run([*map(str, words), "--json", "-q"]) == code
        return json.loads(out.read_text())

    log, scene = pressed.log, pressed.scene
    block = folder / "block.obj"
    block.write_text(trimesh.creation.box((0.1, 0.2, 0.3)).export(file_type="obj"))
    hand = ["--urdf", root / "assets/hand/hand.urdf"]
    batch = call("batch", log, "--scene", scene, "-O", folder / "batch", "--jobs", 1)
    return {
        "replay": [call("replay", log, "--scene", scene, "-o", folder / "out.mcap")],
        "batch": [batch],
        "manifest": [json.loads(Path(batch["manifest"]).read_text())],
        "stats": [call("stats", pressed.out, landed.out)],
        "diff": [
            call("diff", landed.out, landed.raised, code=1),
            call("diff", landed.out, landed.out),
            call("diff", pressed.out, landed.out, code=1),
        ],
        "audit": [call("audit", landed.out), call("audit", landed.log, "--scene", landed.scene)],
        "check": [call("check", log, "--scene", scene), call("check", landed.log, "--scene", landed.scene)],
        "info": [call("info", log), call("info", landed.log)],
        "init": [
            call("init", root / f"recordings/{name}.mcap", *hand, "-o", folder / f"{name}.toml")
            for name in ("gallery_hand", "webxr_hand")
        ],
        "decompose": [call("decompose", block)],
    }


@pytest.mark.parametrize(
    "name", [name for name in OUTPUTS if name not in ("calibrate", "bench")]
)  # see below, and cli/test_bench.py
def test_what_is_printed_is_what_the_schema_says(name: str, printed: Printed) -> None:
    schema = geomphys.json_schema(name)
    Draft202012Validator.check_schema(schema)
    validator = Draft202012Validator(schema)
    for printed_value in printed[name]:
        validator.validate(printed_value)
        value, inner = printed_value, validator
        if isinstance(value, list):
            value, inner = value[0], Draft202012Validator(schema["items"] | {"$defs": schema["$defs"]})
        with pytest.raises(ValidationError):
            inner.validate(value | {"another": 1})
        missing = next(iter(value))
        with pytest.raises(ValidationError):
            inner.validate({key: held for key, held in value.items() if key != missing})


def test_a_calibration_is_what_the_schema_says() -> None:
    from geomphys.authoring.calibration import Calibration, Surface

    surface = Surface(0.7, 0.2, (0.0, 0.0, 0.7), (0.0, 0.0, 0.0, 1.0))
    found = Calibration(
        log="log.mcap", scene="scene.toml", avatar="hand", offset_m=(0.0, 0.1, 0.2), offset_rpy_deg=None,
        surfaces={"table": surface}, delay_s={"/glove": 0.05}, correlation={"/glove": 0.9},
        frames=3, residual_m=0.001, residual_p90_m=0.002, confidence={"offset along x": 0.001},
        finger_scale={"index": 1.05}, unobservable=("tilt",), changes=(),
    )  # fmt: skip
    Draft202012Validator(geomphys.json_schema("calibrate")).validate(json.loads(json.dumps(found.as_dict())))


def test_the_command_knows_every_schema(capsys: pytest.CaptureFixture[str]) -> None:
    assert OUTPUTS == JSON_OUTPUTS
    found = {name: cli.get_command(click.Context(cli), name) for name in COMMANDS}
    commands = {name for name, command in found.items() if command and any(p.name == "as_json" for p in command.params)}
    assert {*OUTPUTS} == commands | {"manifest"}
    assert run(["schema", "stats"]) == 0
    assert json.loads(capsys.readouterr().out) == geomphys.json_schema("stats")
    with pytest.raises(geomphys.ConfigError, match="choose among"):
        geomphys.json_schema("view")
