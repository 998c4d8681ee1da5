"""The scene file: what it may say, and how what it may not is answered."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geomphys.errors import SceneError
from geomphys.numerics.transforms import rotation_from_quaternion
from geomphys.scene import scene_file
from geomphys.scene.scene_file import SceneFile, load_scene_file, parse_scene, scene_json_schema

HERE = Path("s.toml")
BALL = '[[object]]\nname = "ball"\nclass = "fixed"\nsphere = 0.1\n'
DRIVEN = '[[object]]\nname = "mug"\nclass = "driven"\ncylinder = [0.04, 0.1]\ntopic = "/mug"\n'
HAND = '[[avatar]]\nname = "hand"\nurdf = "hand.urdf"\n'
JOINTS = HAND + "[avatar.joints]\ntopic = '/glove'\n{}\n"

FULL = """
[scene]
name = "gallery"
gravity = [0.0, 0.0, -9.81]

[recording]
up = "y"
unit = "mm"
frame = "lighthouse"
position = [0.0, 0.0, 0.4]
rpy = [0.0, 0.0, 90.0]

[[material_pair]]
materials = ["rubber", "wood"]
restitution = 0.8
friction = 0.9

[[object]]
name = "table"
class = "fixed"
mesh = "meshes/table.glb"
scale = 0.5
position = [0, 0, 0.4]
orientation = [0, 0, 0, 1]
material = "wood"
density = 600.0
decomposition = "coacd"

[[object]]
name = "ball"
class = "simulated"
sphere = 0.05
mass = 2.0
velocity = [1, 0, 0]
angular_velocity = [0, 0, 3]

[[object]]
name = "mug"
class = "driven"
capsule = [0.05, 0.1]
topic = "/tracker/mug#cup"
coupling = "rigid"

[[object]]
name = "door"
class = "fixed"
urdf = "door/door.urdf"
topic = "/scene/door/frame"
joints = { topic = "/scene/door/joint_states", sign = { hinge = -1 }, delay = 0.08 }
up = "y"

[[avatar]]
name = "hand"
urdf = "hand/hand.urdf"
mode = "chains"
material = "human"
mass = 0.4
root = { topic = "/tracker/wrist", position = [0, 0, 0.1], orientation = [0, 0, 0, 1] }
joints = { topic = "/glove", unit = "deg", rename = { recorded = "urdf_name" } }
coupling = { stiffness = 500.0, damping = 30 }
self_collision = false
ignore_pairs = [["palm", "thumb_base"]]

[[avatar.chain]]
name = "arm"
base = "torso"
tip = "hand"

[[avatar.reach_cone]]
joints = ["x", "y", "z"]
limb = [0.0, 0.0, -1.0]
directions = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]
"""


def fault(text: str) -> str:
    """What is said about a scene, without the file's name."""
    with pytest.raises(SceneError) as caught:
        parse_scene(text, HERE)
    message = str(caught.value)
    assert message.startswith("s.toml: ")
    assert message.isprintable()
    return message.removeprefix("s.toml: ")


def test_a_file_with_everything() -> None:
    scene = parse_scene(FULL, HERE)
    table, ball, mug, door = scene.object
    (hand,) = scene.avatar
    assert (table.shape, table.scale, table.density, table.decomposition) == ("mesh", 0.5, 600.0, "coacd")
    assert (ball.mass, ball.velocity, ball.angular_velocity) == (2.0, (1.0, 0.0, 0.0), (0.0, 0.0, 3.0))
    assert (mug.class_, mug.topic, mug.coupling, mug.capsule) == ("driven", "/tracker/mug#cup", "rigid", (0.05, 0.1))
    assert door.joints is not None
    assert (door.shape, door.joints.topic, door.joints.unit) == ("urdf", "/scene/door/joint_states", None)
    assert (hand.mode, hand.self_collision, hand.ignore_pairs) == ("chains", False, (("palm", "thumb_base"),))
    assert hand.root.position == (0.0, 0.0, 0.1)
    assert hand.joints is not None
    assert hand.joints.rename == {"recorded": "urdf_name"}
    assert hand.coupling != "rigid"
    assert (hand.coupling.stiffness, hand.coupling.damping) == (500.0, 30.0)
    assert (hand.chain[0].base, hand.chain[0].tip) == ("torso", "hand")
    assert hand.reach_cone[0].directions[2] == (0.0, 0.0, -1.0)
    assert scene.material_pair[0].materials == ("rubber", "wood")


def test_what_is_left_out() -> None:
    (hand,) = parse_scene(HAND, HERE).avatar
    assert (hand.mode, hand.material, hand.mass, hand.self_collision) == ("auto", "human", 0.4, True)
    assert hand.coupling != "rigid"
    assert (hand.coupling.stiffness, hand.coupling.damping) == (1000.0, 40.0)
    assert hand.root.topic is None
    assert parse_scene(BALL, HERE).scene.gravity == (0.0, 0.0, -9.81)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "names no object and no avatar"),
        ("x", "not valid TOML: Expected '=' after a key"),
        ("[scene\n", "not valid TOML: "),
        (BALL + "colour = 1", "object[0] ('ball').colour = 1: unknown key, expected one of name, class"),
        (BALL + 'materal = "wood"', "object[0] ('ball').materal = 'wood': unknown key, did you mean 'material'?"),
        ("[scen]\n" + BALL, "scen = {}: unknown key, did you mean 'scene'?"),
        (BALL.replace("0.1", "[1]"), "object[0] ('ball').sphere = [1]: expected a number"),
        (BALL.replace("0.1", '"big"'), "object[0] ('ball').sphere = 'big': expected a number"),
        (BALL.replace("0.1", "true"), "object[0] ('ball').sphere = True: expected a number"),
        (BALL.replace("0.1", "nan"), "object[0] ('ball').sphere = nan: expected a finite number"),
        (
            BALL.replace("0.1", "1979-05-27"),
            "object[0] ('ball').sphere = datetime.date(1979, 5, 27): expected a number",
        ),
        (BALL.replace("0.1", "-0.1"), "object[0] ('ball').sphere = -0.1: expected at least 1e-06"),
        (BALL.replace("0.1", "0"), "object[0] ('ball').sphere = 0: expected at least 1e-06"),
        (BALL.replace("0.1", "1e300"), "object[0] ('ball').sphere = 1e+300: expected at most 100000"),
        (BALL + "position = [0, -inf, 0]", "object[0] ('ball').position[1] = -inf: expected a finite number"),
        (BALL + "position = [0, 0]", "object[0] ('ball').position = [0, 0]: expected more values"),
        (BALL + "position = [0, 0, 0, 0]", "object[0] ('ball').position = [0, 0, 0, 0]: expected at most 3 values"),
        (BALL + "position = 3", "object[0] ('ball').position = 3: expected an array [...]"),
        (BALL + "orientation = [0, 0, 0, 1.01]", "not a unit quaternion x y z w: its norm is 1.01, expected 1"),
        (BALL + "orientation = [0, 0, 0, 0]", "object[0] ('ball').orientation = [0, 0, 0, 0]: is not a unit"),
        (BALL + "orientation = [0, 0, nan, 1]", "object[0] ('ball').orientation[2] = nan: expected a finite"),
        (HAND + "root = { orientation = [1, 1, 0, 0] }", "avatar[0] ('hand').root.orientation = [1, 1, 0, 0]: is not"),
        (
            BALL + "orientation = [0, 0, 0, 1]\nrpy = [0, 0, 0]",
            "object[0] ('ball') has both orientation and rpy, each of",
        ),
        (BALL + "rpy = [0, 0, 0]\nup = 'y'", "object[0] ('ball') has both rpy and up, each of which is its rotation"),
        (
            HAND + "root = { up = 'z', orientation = [0, 0, 0, 1] }",
            "avatar[0] ('hand').root has both orientation and up",
        ),
        ("[recording]\nrpy = [0, 0, 1]\norientation = [0, 0, 0, 1]\n" + BALL, "recording has both orientation and rpy"),
        (BALL + "up = 'x'", "object[0] ('ball').up = 'x': expected 'y' or 'z'"),
        (BALL + "rpy = [0, 90]", "object[0] ('ball').rpy = [0, 90]: expected more values"),
        (BALL + "rpy = [0, 0, 4000]", "object[0] ('ball').rpy[2] = 4000: expected at most 3600"),
        ("[recording]\nunit = 'inch'\n" + BALL, "recording.unit = 'inch': expected 'm', 'mm' or 'cm'"),
        ("[recording]\nunits = 'mm'\n" + BALL, "recording.units = 'mm': unknown key, did you mean 'unit'?"),
        ("[recording]\nframe = 3\n" + BALL, "recording.frame = 3: expected an array [...]"),
        ("[recording]\nframe = []\n" + BALL, "recording.frame = []: expected at least 1 values"),
        ("[recording]\nframe = ['a', '']\n" + BALL, "recording.frame[1] = '': must not be empty"),
        ("[[recording]]\nup = 'y'\n" + BALL, "recording = [{'up': 'y'}]: expected a table {...}"),
        (JOINTS.format("sign = { '' = 1 }"), "avatar[0] ('hand').joints.sign. = '': must not be empty"),
        (BALL + "delay = 0.1", "object[0] ('ball') delay: shifts the times of a topic, and there is none"),
        (HAND + "root = { delay = 0.1 }", "avatar[0] ('hand').root delay: shifts the times of a topic"),
        (DRIVEN + "delay = 1e4", "object[0] ('mug').delay = 10000.0: expected at most 600"),
        (JOINTS.format("sign = { a = 2 }"), "avatar[0] ('hand').joints.sign.a = 2: expected 1 or -1"),
        (JOINTS.format("sign = { a = true }"), "avatar[0] ('hand').joints.sign.a = True: expected 1 or -1"),
        (JOINTS.format("scale = { a = 0.0 }"), "avatar[0] ('hand').joints.scale.a = 0.0: would make the joint stand"),
        (JOINTS.format("offset = { a = nan }"), "avatar[0] ('hand').joints.offset.a = nan: expected a finite number"),
        (JOINTS.format("ignore = 'a'"), "avatar[0] ('hand').joints.ignore = 'a': expected an array [...]"),
        (
            JOINTS.format("igore = ['a']"),
            "avatar[0] ('hand').joints.igore = ['a']: unknown key, did you mean 'ignore'?",
        ),
        (BALL.replace("fixed", "moving"), "class = 'moving': expected 'fixed', 'simulated' or 'driven'"),
        (BALL.replace('class = "fixed"\n', ""), "object[0] ('ball').class is missing"),
        (BALL + "box = [1, 1, 1]", "object[0] ('ball') needs exactly one of mesh, box"),
        (BALL.replace("sphere = 0.1", ""), "it has none of them"),
        (BALL + "density = 1.0\nmass = 1.0", "object[0] ('ball') has both density and mass"),
        (BALL + "mass = 0", "object[0] ('ball').mass = 0: expected at least 1e-09"),
        (BALL + "velocity = [1, 0, 0]", "velocity: only an object with class = simulated has one, this is fixed"),
        (DRIVEN + "angular_velocity = [1, 0, 0]", "angular_velocity: only an object with class = simulated"),
        (DRIVEN.replace('topic = "/mug"', ""), "topic: a driven object needs the topic it follows"),
        (DRIVEN.replace("driven", "simulated"), "topic: a simulated object follows no topic"),
        (BALL + "coupling = 'rigid'", "coupling: only an object with class = driven has one"),
        (BALL + "scale = 2.0", "scale = 2.0: only a mesh is scaled"),
        (BALL + "decomposition = 'hull'", "decomposition = 'hull': a sphere is exact"),
        (BALL + "decomposition = 'vhacd'", "decomposition = 'vhacd': expected 'auto', 'hull' or 'coacd'"),
        (BALL + "joints = { topic = '/j' }", "joints: only an object with a urdf has joints"),
        (BALL.replace("sphere = 0.1", "urdf = 'a'").replace("fixed", "simulated"), "must have class = fixed"),
        (BALL.replace("sphere = 0.1", "urdf = 'a'\nmass = 1"), "mass: an articulated object has a density"),
        (BALL + BALL, "two objects or avatars are named 'ball'"),
        (BALL + HAND.replace("hand", "ball"), "two objects or avatars are named 'ball'"),
        (BALL.replace('"ball"', '"a/b"'), "object[0] ('a/b').name = 'a/b': must not hold '/' or '#'"),
        (BALL.replace('"ball"', '"a\\u001b[2J"'), "holds a control character"),
        (BALL.replace('"ball"', '"a\\nb"'), "holds a control character"),
        (BALL.replace('"ball"', '""'), "must not be empty"),
        (BALL.replace('"ball"', '"world"'), "is reserved"),
        (BALL.replace('"ball"', "3"), "object[0].name = 3: expected text in quotes"),
        (BALL + 'topic = "a\\u0000"', "object[0] ('ball').topic = 'a\\x00': holds a control character"),
        ("[object]\nname = 'a'", "object = {'name': 'a'}: expected tables [[object]]"),
        ("object = 3", "object = 3: expected tables [[object]]"),
        (BALL + "[scene]\ngravity = 9.81", "scene.gravity = 9.81: expected an array"),
        (BALL + "[scene]\ngravity = [0, 0, 1e9]", "scene.gravity[2] = 1000000000.0: expected at most 10000"),
        (HAND + "mode = 'floppy'", "avatar[0] ('hand').mode = 'floppy': expected 'auto', 'rigid' or 'chains'"),
        (HAND + "self_collision = 1", "avatar[0] ('hand').self_collision = 1: expected true or false"),
        (HAND + "coupling = 'soft'", "avatar[0] ('hand').coupling = 'soft': expected"),
        (HAND + "coupling = { stiffness = 0 }", "avatar[0] ('hand').coupling.stiffness = 0: expected at least 0.001"),
        (HAND + "coupling = { stiffnes = 1 }", "coupling.stiffnes = 1: unknown key, did you mean 'stiffness'?"),
        (HAND + "joints = { unit = 'rad' }", "avatar[0] ('hand').joints.topic is missing"),
        (HAND + "joints = { topic = '/j', unit = 'grad' }", "joints.unit = 'grad': expected 'rad' or 'deg'"),
        (
            HAND + "joints = { topic = '/j', rename = { a = 'c', b = 'c' } }",
            "rename gives two recorded joints the name 'c'",
        ),
        (HAND + "ignore_pairs = [['a']]", "ignore_pairs[0] = ['a']: expected more values"),
        (HAND + "[[avatar.chain]]\nname = 'c'\nbase = 'a'", "avatar[0] ('hand').chain[0] ('c').tip is missing"),
        (HAND + "[[avatar.chain]]\nname='c'\nbase='a'\ntip='b'\n" * 2, "two objects|two chains are named 'c'"),
        (
            HAND + "[[avatar.reach_cone]]\njoints = ['a']\nlimb = [0, 0, 0]\ndirections = [[1,0,0],[0,1,0],[0,0,1]]",
            "avatar[0] ('hand').reach_cone[0] limb: [0.0, 0.0, 0.0] has no direction",
        ),
        (
            HAND + "[[avatar.reach_cone]]\njoints = ['a']\nlimb = [0, 0, 1]\ndirections = [[1,0,0],[0,1,0]]",
            "directions = [[1, 0, 0], [0, 1, 0]]: expected at least 3 values",
        ),
        (
            "[[material_pair]]\nmaterials = ['a', 'b']\nrestitution = 1.1\nfriction = 0\n" + BALL,
            "material_pair[0].restitution = 1.1: expected at most 1",
        ),
        (
            "[[material_pair]]\nmaterials = ['a', 'b']\nrestitution = 1\nfriction = 0\n"
            "[[material_pair]]\nmaterials = ['b', 'a']\nrestitution = 1\nfriction = 0\n" + BALL,
            "the pair 'a / b' is given twice",
        ),
    ],
)
def test_faults_name_key_value_and_what_is_expected(text: str, says: str) -> None:
    message = fault(text)
    assert any(part in message for part in says.split("|")), message


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 100_000,
        "a = " + "{ a = " * 5_000 + "1" + "}" * 5_000,
        "[" + "a." * 3_000 + "a]\nx = 1",
        "a = " + "9" * 5_000,
    ],
    ids=["arrays", "tables", "keys", "digits"],
)
def test_what_is_nested_or_long_without_measure_is_refused(text: str) -> None:
    assert len(fault(text)) < 300


def test_the_first_fault_and_how_many_more() -> None:
    message = fault(BALL.replace("0.1", "-1") + BALL.replace('"ball"', '"b"').replace("0.1", "-1"))
    assert message.endswith("(and 1 more)")


def test_unit_quaternions_stay_as_they_are_and_close_ones_are_made_unit() -> None:
    unit = (0.1825741858350554, 0.3651483716701107, 0.5477225575051661, 0.7302967433402214)
    text = BALL + "orientation = [{}, {}, {}, {}]"
    assert parse_scene(text.format(*unit), HERE).object[0].orientation == unit
    rounded = parse_scene(text.format(0.1826, 0.3651, 0.5477, 0.7303), HERE).object[0].orientation
    assert math.hypot(*rounded) == pytest.approx(1.0, abs=1e-15)
    assert rounded[0] == pytest.approx(0.1826, abs=1e-4)


@pytest.mark.parametrize("norm", [0.991, 0.9995, 1.0005, 1.0099])
def test_a_quaternion_typed_by_hand_is_normalised_within_one_percent(norm: float) -> None:
    """1 0 0 1 over the root of two, typed with few digits, is a rotation by 90 degrees and not an error."""
    s = norm * math.sqrt(0.5)
    ball = parse_scene(BALL + f"orientation = [{s}, 0, 0, {s}]", HERE).object[0]
    assert ball.rotation == pytest.approx((math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)), abs=1e-15)
    assert "not a unit quaternion" in fault(BALL + f"orientation = [0, 0, 0, {norm + math.copysign(0.01, norm - 1)}]")


def test_a_rotation_is_the_same_however_it_is_written() -> None:
    s = math.sqrt(0.5)
    written = (f"orientation = [{s}, 0, 0, {s}]", "rpy = [90, 0, 0]", "up = 'y'")
    for text in written:
        ball = parse_scene(BALL + text, HERE).object[0]
        hand = parse_scene(HAND + "root = { " + text + " }", HERE).avatar[0]
        assert ball.rotation == hand.root.rotation == pytest.approx((s, 0.0, 0.0, s), abs=1e-15)
    assert parse_scene(BALL + "up = 'z'", HERE).object[0].rotation == (0.0, 0.0, 0.0, 1.0)


def test_the_recorded_space() -> None:
    """`up` first, then the rotation in the world: y goes to z, and a turn by 90 degrees about z takes z of it to x."""
    nothing = parse_scene(BALL, HERE).recording
    assert (nothing.rotation, nothing.unit, nothing.frame) == ((0.0, 0.0, 0.0, 1.0), "m", ())
    space = parse_scene("[recording]\nup = 'y'\nunit = 'mm'\nrpy = [0, 0, 90]\n" + BALL, HERE).recording
    world_from_recorded = rotation_from_quaternion(space.rotation)
    for axis, goes_to in (((0, 1, 0), (0, 0, 1)), ((1, 0, 0), (0, 1, 0)), ((0, 0, 1), (1, 0, 0))):
        assert world_from_recorded @ axis == pytest.approx(np.array(goes_to), abs=1e-15)
    assert space.unit == "mm"


def test_what_becomes_of_recorded_joints() -> None:
    keys = "sign = { a = -1, b = 1.0 }\nscale = { a = 2 }\noffset = { c = 0.5 }\nignore = ['x*']\ndelay = -0.08"
    joints = parse_scene(JOINTS.format(keys), HERE).avatar[0].joints
    assert joints is not None
    assert (joints.sign, joints.scale, joints.offset) == ({"a": -1, "b": 1}, {"a": 2.0}, {"c": 0.5})
    assert (joints.ignore, joints.delay) == (("x*",), -0.08)


def test_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SceneError, match="no such scene file"):
        load_scene_file(tmp_path / "none.toml")
    with pytest.raises(SceneError, match="is a folder"):
        load_scene_file(tmp_path)
    path = tmp_path / "s.toml"
    path.write_bytes(b"# \xc3\xa4\n\xff")
    with pytest.raises(SceneError, match="line 2: not UTF-8 text"):
        load_scene_file(path)
    path.write_bytes(b"\xef\xbb\xbf" + BALL.replace("\n", "\r\n").encode())  # as Windows editors write it
    assert load_scene_file(path).object[0].name == "ball"
    monkeypatch.setattr(scene_file, "MAX_FILE_BYTES", 10)
    with pytest.raises(SceneError, match="is larger than"):
        load_scene_file(path)


def test_the_schema_describes_the_file() -> None:
    import jsonschema

    schema = scene_json_schema()
    json.dumps(schema)
    jsonschema.Draft202012Validator.check_schema(schema)
    import tomllib

    jsonschema.validate(tomllib.loads(FULL), schema)
    for frame in ('"world"', '["world", "map"]'):
        jsonschema.validate(tomllib.loads(f"[recording]\nframe = {frame}\n" + BALL), schema)
    for wrong in (JOINTS.format("sign = { a = 2 }"), BALL + "up = 'x'", "[recording]\nframe = []\n" + BALL):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(tomllib.loads(wrong), schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(tomllib.loads(BALL + "colour = 1"), schema)


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=6,
)


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_no_table_raises_anything_else(data: st.DataObject) -> None:
    """Any key of any table replaced by any value gives a scene or a SceneError on one line."""
    import tomllib

    from pydantic import ValidationError

    from geomphys.scene.scene_file_errors import explain

    table = tomllib.loads(FULL)
    here: object = table
    for _ in range(data.draw(st.integers(1, 4))):
        if isinstance(here, dict):
            key: object = data.draw(st.sampled_from(sorted(here)) | st.text(max_size=5))
        elif isinstance(here, list) and here:
            key = data.draw(st.integers(0, len(here) - 1))
        else:
            break
        if data.draw(st.booleans()) or not (isinstance(here, list) or key in here):  # type: ignore[operator]
            here[key] = data.draw(values)  # type: ignore[index]
            break
        here = here[key]  # type: ignore[index]
    message = "fine"
    try:
        SceneFile.model_validate(table)
    except ValidationError as error:
        message = explain(error, table, scene_file._TABLES)
    assert message.isprintable()


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_no_text_raises_anything_else(data: st.DataObject) -> None:
    text = FULL
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text) - 1))
        text = text[:at] + data.draw(st.text(max_size=4)) + text[at + data.draw(st.integers(0, 20)) :]
    message = "fine"
    try:
        parse_scene(text, HERE)
    except SceneError as error:
        message = str(error)
    assert message.isprintable()
