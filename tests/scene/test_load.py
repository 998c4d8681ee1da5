"""A scene file becomes a world: names, trees, pieces, masses, sources, what may not collide."""

from __future__ import annotations

import math
import time
from pathlib import Path

import numpy as np
import pytest

from geomphys.engine.state import make_replay_data
from geomphys.errors import ConfigError, GeomphysError, MeshError, SceneError
from geomphys.load import load_world
from geomphys.numerics.transforms import compose, matrix_from_frame, matrix_from_pose, rotation_about
from geomphys.scene import assembly
from geomphys.scene.arrays import BOX, CAPSULE, CYLINDER, DRIVEN, FIXED, HULL, JOINT_PRISMATIC, SIMULATED, SPHERE
from geomphys.scene.skeleton import load_skeleton
from geomphys.scene.world import World
from tests.scene.models import ball, cube, ell, joint, link, stl, urdf

HAND = '[[avatar]]\nname = "hand"\nurdf = "hand.urdf"\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a hand of two fingers, a drawer, a cube and an open L."""
    urdf(
        tmp_path / "hand.urdf",
        ball("palm", 0.03),
        link("root1"),
        ball("one"),
        ball("two"),
        link("root2"),
        ball("three"),
        ball("four"),
        joint("p1", "palm", "root1", xyz="0 0.02 0.05"),
        joint("p2", "palm", "root2", xyz="0 -0.02 0.05"),
        joint("j1", "root1", "one", xyz="0 0 0"),
        joint("j2", "one", "two", xyz="0 0 0.03"),
        joint("j3", "root2", "three", xyz="0 0 0"),
        joint("j4", "three", "four", xyz="0 0 0.03", inside='<mimic joint="j3" multiplier="2" offset="0.1"/>'),
    )
    urdf(
        tmp_path / "drawer.urdf",
        link("case", '<geometry><box size="0.4 0.4 0.2"/></geometry>'),
        link("box", '<geometry><mesh filename="cube.stl" scale="0.1 0.1 0.1"/></geometry>'),
        joint("slide", "case", "box", "prismatic"),
    )
    stl(tmp_path / "cube.stl", *cube())
    corners, faces = ell()
    stl(tmp_path / "open.stl", corners, faces[1:])
    stl(tmp_path / "ell.stl", corners, faces)
    return tmp_path


def load(folder: Path, text: str, **options: str) -> World:
    path = folder / "scene.toml"
    path.write_text(text)
    return load_world(path, **options)


def thing(name: str, shape: str, kind: str = "fixed", *more: str) -> str:
    return "\n".join([f'[[object]]\nname = "{name}"\nclass = "{kind}"', shape, *more]) + "\n"


def test_avatars_come_first_then_objects_in_the_order_of_the_file(folder: Path) -> None:
    world = load(
        folder,
        thing("table", "box = [1, 1, 0.1]")
        + HAND
        + thing("drawer", 'urdf = "drawer.urdf"')
        + thing("ball", "sphere = 0.1", "simulated", "velocity = [1, 2, 3]", "angular_velocity = [4, 5, 6]")
        + thing("mug", "capsule = [0.05, 0.1]", "driven", 'topic = "/mug"'),
    )
    assert world.tree_names == ("hand", "table", "drawer", "ball", "mug")
    assert world.avatar_count == 1
    hand = ("palm", "root1", "root2", "one", "three", "two", "four")
    assert world.body_names == (*(f"hand/{n}" for n in hand), "table", "drawer/case", "drawer/box", "ball", "mug")
    assert world.frame_names == (*hand, *world.body_names[7:])
    assert world.dof_names == ("p1", "p2", "j1", "j3", "j2", "slide")
    trees, bodies = world.scene.trees, world.scene.bodies
    assert trees.role.tolist() == [DRIVEN, FIXED, FIXED, SIMULATED, DRIVEN]
    assert trees.moving.tolist() == [1, 0, 0, 1, 1]
    assert trees.body_start.tolist() == [0, 7, 8, 10, 11, 12]
    assert trees.dof_start.tolist() == [0, 5, 5, 6, 6, 6]
    assert bodies.tree.tolist() == [0] * 7 + [1, 2, 2, 3, 4]
    assert world.scene.initial_velocity[10].tolist() == [1, 2, 3, 4, 5, 6]
    assert world.scene.initial_velocity[[0, 7, 11]].tolist() == np.zeros((3, 6)).tolist()
    assert world.urdfs == {"hand": folder / "hand.urdf", "drawer": folder / "drawer.urdf"}
    assert {len(world.triangles), len(world.collision_triangles), len(world.body_names)} == {12}


def test_several_avatars_prefix_their_frames(folder: Path) -> None:
    world = load(folder, HAND + HAND.replace('"hand"', '"other"'))
    assert world.frame_names == world.body_names
    assert world.frame_names[:1] + world.frame_names[7:8] == ("hand/palm", "other/palm")


def test_every_shape_is_exact(folder: Path) -> None:
    world = load(
        folder,
        thing("a", "sphere = 0.1")
        + thing("b", "capsule = [0.1, 0.6]")
        + thing("c", "box = [0.2, 0.4, 0.6]")
        + thing("d", "cylinder = [0.1, 0.6]")
        + thing("e", 'mesh = "cube.stl"\nscale = 0.5')
        + thing("f", 'mesh = "open.stl"\ndecomposition = "hull"'),
    )
    pieces = world.scene.pieces
    assert pieces.kind.tolist() == [SPHERE, CAPSULE, BOX, CYLINDER, HULL, HULL]
    np.testing.assert_allclose(
        pieces.size[:4], [[0.1, 0, 0], [0.1, 0.3, 0], [0.1, 0.2, 0.3], [0.1, 0.3, 0]], rtol=1e-15
    )
    hull = pieces.vertices[pieces.vertex_start[4] : pieces.vertex_start[5]]
    assert sorted(map(tuple, hull)) == sorted(map(tuple, 0.25 * 2 * cube()[0]))
    for name, (vertices, _) in zip(world.body_names, world.collision_triangles, strict=True):
        assert np.isfinite(vertices).all(), name
    assert len(world.collision_triangles[5][0]) == 10  # what collides of the open L is its hull


@pytest.mark.parametrize(
    ("shape", "kind", "more", "mass"),
    [
        ("box = [0.1, 0.2, 0.5]", "simulated", "density = 700.0", 7.0),
        ("box = [0.1, 0.2, 0.5]", "simulated", "", 10.0),
        ("sphere = 0.3", "simulated", "mass = 2.5", 2.5),
        ('mesh = "ell.stl"\ndecomposition = "hull"', "simulated", "density = 1000.0", 3.5),
        ('mesh = "cube.stl"\nscale = 0.1', "simulated", "density = 500.0", 0.5),
        ("sphere = 0.1", "driven", 'topic = "/t"', 0.4),
        ("sphere = 0.1", "driven", 'topic = "/t"\nmass = 0.7', 0.7),
        ("box = [0.1, 0.1, 0.1]", "driven", 'topic = "/t"\ndensity = 800.0', 0.8),
    ],
)
def test_masses(folder: Path, shape: str, kind: str, more: str, mass: float) -> None:
    world = load(folder, thing("a", shape, kind, more))
    assert world.scene.bodies.mass[0] == pytest.approx(mass, rel=1e-6)
    assert world.scene.trees.mass[0] == pytest.approx(mass, rel=1e-6)


def test_links_have_the_mass_of_their_geometry(folder: Path) -> None:
    world = load(folder, HAND + "density = 900.0\nmass = 0.6\n")
    bodies = world.scene.bodies
    volume = 4 / 3 * math.pi * np.array([0.03, 0, 0, 0.01, 0.01, 0.01, 0.01]) ** 3
    np.testing.assert_allclose(bodies.mass, 900.0 * volume, rtol=1e-14)
    assert world.scene.trees.mass.tolist() == [0.6]


def test_couplings(folder: Path) -> None:
    world = load(
        folder,
        HAND
        + "coupling = { stiffness = 500.0, damping = 20.0 }\n"
        + thing("a", "sphere = 1", "driven", 'topic = "/a"')
        + thing("b", "sphere = 1", "driven", 'topic = "/b"', 'coupling = "rigid"'),
    )
    assert world.scene.trees.stiffness.tolist() == [500.0, 1000.0, math.inf]
    assert world.scene.trees.damping[:2].tolist() == [20.0, 40.0]


def test_where_poses_and_angles_come_from(folder: Path) -> None:
    offset = "position = [0, 0, 0.1], orientation = [0, 0, 0.6, 0.8]"
    world = load(
        folder,
        HAND
        + f'root = {{ topic = "/wrist", {offset} }}\n'
        + 'joints = { topic = "/glove", unit = "deg", rename = { recorded = "j1" } }\n'
        + thing("still", "sphere = 1", "fixed", "position = [1, 2, 3]", "orientation = [0, 0, 0.6, 0.8]")
        + thing("cup", "sphere = 1", "fixed", 'topic = "/cup"', "position = [1, 2, 3]")
        + thing("drawer", 'urdf = "drawer.urdf"', "fixed", 'joints = { topic = "/drawer" }'),
    )
    root, cup = world.roots
    assert (root.tree, root.topic, root.position, root.orientation) == (0, "/wrist", (0, 0, 0.1), (0, 0, 0.6, 0.8))
    assert (cup.tree, cup.topic, cup.position) == (2, "/cup", (1.0, 2.0, 3.0))
    assert world.scene.trees.rest.tolist() == [
        [0, 0, 0, 0, 0, 0, 1],
        [1, 2, 3, 0, 0, 0.6, 0.8],
        [0, 0, 0, 0, 0, 0, 1],
        [0, 0, 0, 0, 0, 0, 1],
    ]
    glove, drawer = world.joints
    assert glove.dofs == {"p1": 0, "p2": 1, "j1": 2, "j3": 3, "j2": 4}
    assert (glove.unit, glove.rename, glove.mimics) == ("deg", {"recorded": "j1"}, ("j4",))
    assert (drawer.tree, drawer.unit, drawer.dofs) == (3, None, {"slide": 5})
    assert world.scene.trees.moving.tolist() == [1, 0, 1, 1]


def test_the_arrays_hold_the_skeleton(folder: Path) -> None:
    """Forward kinematics from the arrays alone equals the skeleton's."""
    world = load(folder, HAND + thing("drawer", 'urdf = "drawer.urdf"', "fixed", "position = [1, 2, 3]"))
    bodies, trees = world.scene.bodies, world.scene.trees
    angles = np.random.default_rng(0).normal(size=len(world.dof_names))
    poses = np.zeros((len(world.body_names), 4, 4))
    for b, parent in enumerate(bodies.parent):
        if parent < 0:
            poses[b] = matrix_from_pose(trees.rest[bodies.tree[b]])
            continue
        move = np.eye(4)
        if bodies.dof[b] >= 0:
            value = bodies.multiplier[b] * angles[bodies.dof[b]] + bodies.offset[b]
            if bodies.joint[b] == JOINT_PRISMATIC:
                move[:3, 3] = value * bodies.axis[b]
            else:
                move[:3, :3] = rotation_about(bodies.axis[b], value)
        poses[b] = compose(poses[parent], compose(matrix_from_frame(bodies.origin[b]), move))
    hand = load_skeleton(folder / "hand.urdf").forward(angles[:5])
    drawer = load_skeleton(folder / "drawer.urdf").forward(angles[5:], matrix_from_pose(trees.rest[1]))
    np.testing.assert_allclose(poses, np.concatenate([hand, drawer]), atol=1e-14)
    assert world.scene.dofs.lower[5] == -1.0
    assert world.scene.dofs.upper[3] == pytest.approx((1 - 0.1) / 2)  # the mimic joint's limit


def test_an_avatar_yields_by_chains_in_chains_mode_only(folder: Path) -> None:
    text = HAND + '[[avatar.chain]]\nname = "c"\nbase = "palm"\ntip = "one"\n'
    rigid = load(folder, text, mode="rigid")
    assert rigid.scene.trees.chains.tolist() == [0]
    # say whose joints a tip has
    assert [rigid.body_names[b] for b in rigid.scene.chains.bodies] == ["hand/root1", "hand/one"]
    assert load(folder, text).scene.trees.chains.tolist() == [1]  # auto: the joints move links that collide
    world = load(folder, text, mode="chains")
    assert [world.body_names[b] for b in world.scene.chains.bodies] == ["hand/root1", "hand/one"]
    assert world.scene.trees.chains.tolist() == [1]
    assert world.scene.dofs.chain.tolist() == [0, -1, 0, -1, -1]
    assert (
        load(folder, text.replace("[[avatar.ch", 'mode = "chains"\n[[avatar.ch'), mode="rigid").scene.trees.chains[0]
        == 0
    )
    suggested = load(folder, HAND, mode="chains")
    assert [suggested.body_names[b] for b in suggested.scene.chains.bodies] == [
        f"hand/{n}" for n in ("root1", "one", "two", "root2", "three", "four")
    ]
    assert suggested.scene.dofs.chain.tolist() == [0, 1, 0, 1, 0]


def test_neighbours_ignored_pairs_and_zero_pose_overlaps_are_excluded(folder: Path) -> None:
    wide = (folder / "hand.urdf").read_text().replace('<sphere radius="0.01"/>', '<sphere radius="0.019"/>', 1)
    (folder / "hand.urdf").write_text(wide)  # link `one`, 0.04 m from `three`: 0.019 + 0.01 leaves them apart
    world = load(folder, HAND + 'ignore_pairs = [["two", "three"]]\n')
    index = {name.removeprefix("hand/"): k for k, name in enumerate(world.body_names)}

    def excluded(a: str, b: str) -> bool:
        assert world.scene.excluded[index[a], index[b]] == world.scene.excluded[index[b], index[a]]
        return bool(world.scene.excluded[index[a], index[b]])

    assert excluded("palm", "one")  # neighbours: root1 has no geometry
    assert excluded("one", "two")
    assert excluded("two", "three")  # ignored
    assert not excluded("one", "three")
    assert not excluded("one", "four")
    assert world.zero_pose_overlaps == ()

    (folder / "hand.urdf").write_text(wide.replace("0.019", "0.031"))
    world = load(folder, HAND)
    assert world.zero_pose_overlaps == (("hand/one", "hand/three"),)
    assert excluded("one", "three")
    assert not excluded("one", "four")


def test_reach_cones_are_laid_out(folder: Path) -> None:
    cone = '[[avatar.reach_cone]]\njoints = ["p1", "j1"]\nlimb = [0, 0, 2]\ndirections = [[1,0,1],[0,1,1],[-1,-1,1]]\n'
    cones = load(folder, HAND + cone).scene.cones
    assert cones.joints.tolist() == [1, 3]
    assert cones.limb.tolist() == [[0, 0, 1]]
    assert cones.direction_start.tolist() == [0, 3]
    np.testing.assert_allclose(np.linalg.norm(cones.directions, axis=1), 1.0)


RUBBER = '[[material_pair]]\nmaterials = ["rubber", "wood"]\nrestitution = 0.8\nfriction = 0.9\n'
OWN = RUBBER + '[[material_pair]]\nmaterials = ["rubber", "rubber"]\nrestitution = 0.6\nfriction = 0.4\n'


def of(name: str, material: str, kind: str = "simulated") -> str:
    return thing(name, "sphere = 1", kind, f'material = "{material}"')


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (of("a", "x", "fixed") + of("b", "wood", "fixed"), ("'x' of 'a' is not known", "Known are wood, human, metal")),
        (of("a", "wod"), ("did you mean 'wood'?",)),
        (RUBBER + of("a", "ruber"), ("did you mean 'rubber'?", "human, metal, rubber")),
        (HAND + 'material = "skin"\n', ("'skin' of 'hand'", 'materials = ["skin", "skin"]')),
        (RUBBER + of("a", "rubber") + of("b", "rubber"), ("'rubber'", "none with itself", '["rubber", "rubber"]')),
        (RUBBER + of("a", "rubber") + of("b", "metal"), ("'rubber' has none with itself", '["rubber", "metal"]')),
        (RUBBER + HAND + 'material = "rubber"\nmode = "chains"\n', ("'rubber'", "of 'hand'")),
    ],
)
def test_materials_that_nothing_defines(folder: Path, text: str, says: tuple[str, ...]) -> None:
    with pytest.raises(SceneError) as caught:
        load(folder, text)
    assert all(part in str(caught.value) for part in says), str(caught.value)


@pytest.mark.parametrize(
    ("text", "pairs"),
    [
        (RUBBER + of("a", "rubber") + of("b", "wood", "fixed"), []),
        (RUBBER + of("a", "rubber", "fixed") + of("b", "rubber", "fixed") + of("c", "metal", "fixed"), []),
        (RUBBER + HAND + 'material = "rubber"\nmode = "rigid"\n', []),
        (RUBBER + HAND + 'material = "rubber"\nmode = "chains"\nself_collision = false\n', []),
        (OWN + of("a", "rubber") + of("b", "metal") + of("c", "wood"), [("rubber", "metal", 0.3, 0.2)]),
        (OWN + of("a", "rubber", "fixed") + of("b", "metal", "fixed") + of("c", "wood"), []),
    ],
)
def test_pairs_that_are_missing_are_derived_where_they_can_meet(
    folder: Path, text: str, pairs: list[tuple[str, str, float, float]]
) -> None:
    world = load(folder, text)
    found = [(*p.materials, p.restitution, p.friction) for p in world.findings.default_pairs]
    assert [(*p[:2], pytest.approx(p[2]), pytest.approx(p[3])) for p in pairs] == found
    table = world.scene.materials
    kinds = {int(m) for m in world.scene.bodies.material}
    moving = {int(m) for m, role in zip(world.scene.bodies.material, world.scene.bodies.role, strict=True) if role}
    if len(pairs):
        assert all(np.isfinite(table.friction[a, b]) for a in kinds for b in moving if a != b)


@pytest.mark.parametrize(
    ("text", "kind", "says"),
    [
        (thing("a", 'mesh = "none.stl"'), MeshError, ("object 'a'", "none.stl: no such file")),
        (thing("a", 'mesh = "hand.urdf"'), MeshError, ("object 'a'", "hand.urdf: not a mesh file")),
        (thing("a", 'mesh = "open.stl"'), MeshError, ("object 'a'", "neither watertight nor convex", '"hull"')),
        (HAND.replace("hand.urdf", "none.urdf"), SceneError, ("avatar 'hand'", "urdf = 'none.urdf'", "no such file")),
        (HAND + 'ignore_pairs = [["palm", "thum"]]\n', SceneError, ("ignore_pairs[0]", "no link 'thum'")),
        (HAND + 'ignore_pairs = [["pal", "one"]]\n', SceneError, ("did you mean 'palm'",)),
        (
            HAND + 'joints = { topic = "/g", rename = { a = "j9" } }\n',
            SceneError,
            ("joints.rename.a = 'j9'", "no moving joint", "it has p1, p2, j1"),
        ),
        (
            HAND + 'joints = { topic = "/g", sign = { p9 = -1 } }\n',
            SceneError,
            ("'hand': joints.sign.p9 = -1", "no moving joint of this name", "it has p1, p2, j1"),
        ),
        (
            HAND + 'joints = { topic = "/g", offset = { j4 = 0.1 } }\n',
            SceneError,
            ("joints.offset.j4 = 0.1", "follows another by the URDF"),
        ),
        (
            thing("drawer", 'urdf = "drawer.urdf"\njoints = { topic = "/g", scale = { slid = 2.0 } }'),
            SceneError,
            ("'drawer': joints.scale.slid = 2.0", "did you mean 'slide'?"),
        ),
        (
            HAND + '[[avatar.chain]]\nname = "c"\nbase = "palm"\ntip = "x"\n',
            SceneError,
            ("chain 'c' of avatar 'hand'",),
        ),
    ],
)
def test_faults_name_file_thing_and_value(
    folder: Path, text: str, kind: type[GeomphysError], says: tuple[str, ...]
) -> None:
    with pytest.raises(kind) as caught:
        load(folder, text)
    message = str(caught.value)
    assert str(folder / "scene.toml") in message
    assert all(part in message for part in says), message
    assert message.isprintable()


def test_a_mesh_of_a_urdf_is_named_with_its_link(folder: Path) -> None:
    (folder / "cube.stl").unlink()
    with pytest.raises(MeshError) as caught:
        load(folder, thing("drawer", 'urdf = "drawer.urdf"'))
    assert f"{folder / 'drawer.urdf'}: link 'box': {folder / 'cube.stl'}: no such file" in str(caught.value)


def test_an_unknown_mode(folder: Path) -> None:
    with pytest.raises(ConfigError, match="mode = 'floppy'"):
        load(folder, HAND, mode="floppy")


def test_loading_twice_gives_the_same_bytes(folder: Path) -> None:
    text = HAND + thing("a", 'mesh = "cube.stl"') + thing("drawer", 'urdf = "drawer.urdf"')
    first, second = (load(folder, text).scene for _ in range(2))

    def arrays(value: object) -> list[bytes]:
        return [value.tobytes()] if isinstance(value, np.ndarray) else [b for part in value for b in arrays(part)]  # type: ignore[attr-defined]

    assert arrays(first) == arrays(second)


def test_two_thousand_objects_load_fast(folder: Path) -> None:
    shapes = ("box = [0.1, 0.2, 0.3]", "sphere = 0.05", "cylinder = [0.05, 0.2]", 'mesh = "cube.stl"')
    text = "".join(thing(f"o{k}", shapes[k % 4], "simulated" if k % 2 else "fixed") for k in range(2000))
    load(folder, thing("a", "sphere = 1"))  # imports
    start = time.perf_counter()
    world = load(folder, text)
    assert time.perf_counter() - start < 3.0
    assert len(world.body_names) == 2000
    assert world.triangles[3][0] is world.triangles[7][0]  # shared, not copied


SCENES = (
    "body_02_shared",
    "claps_chains",
    "claps_rigid",
    "door_chains",
    "door_rigid",
    "table_grab",
    "table_pinch",
    pytest.param("pillow_a", marks=pytest.mark.slow),
)


@pytest.mark.parametrize("name", SCENES)
def test_scenes_of_real_recordings_load(shared_dir: Path, name: str) -> None:
    world = load_world(shared_dir / "checks" / "scenes" / f"{name}.toml")
    assert len(world.scene.pieces.kind) > 40
    assert np.isfinite(world.scene.pieces.vertices).all()


@pytest.mark.parametrize(
    "model", ["adroit/adroit_hand", "cmu_body/cmu_subject_02", "human_hands/leap_three_claps_left"]
)
def test_overlaps_of_the_zero_pose_are_those_coal_finds(shared_dir: Path, tmp_path: Path, model: str) -> None:
    """Primitives only but for the palm; pairs that nearly touch may be counted either way."""
    coal = pytest.importorskip("coal")
    from tests.collision.engines import coal_place, coal_shape

    path = shared_dir / "models" / f"{model}.urdf"
    world = load(tmp_path, f'[[avatar]]\nname = "a"\nurdf = "{path}"\n')
    skeleton, pieces = load_skeleton(path), world.scene.pieces
    poses = skeleton.forward()
    engines, places = [], []
    for k in range(len(pieces.kind)):
        engines.append(coal_shape(pieces, k))
        place = compose(poses[pieces.body[k]], matrix_from_frame(pieces.local[k]))
        places.append(coal_place(place))
    neighbours = skeleton.neighbours()
    listed = {tuple(skeleton.index(n.removeprefix("a/")) for n in pair) for pair in world.zero_pose_overlaps}
    request = coal.DistanceRequest()
    closest: dict[tuple[int, int], float] = {}
    for i in range(len(engines)):
        for j in range(i + 1, len(engines)):
            pair = (int(pieces.body[i]), int(pieces.body[j]))
            if pair[0] != pair[1] and pair not in neighbours:
                gap = coal.distance(engines[i], places[i], engines[j], places[j], request, coal.DistanceResult())
                closest[pair] = min(closest.get(pair, np.inf), gap)
    assert listed >= {pair for pair, gap in closest.items() if gap < 0}
    assert listed <= {pair for pair, gap in closest.items() if gap < 1e-5}
    assert listed


@pytest.mark.parametrize(("limit", "says"), [("MAX_BODIES", "bodies"), ("MAX_DRIVEN_DOFS", "degrees of freedom")])
def test_a_scene_of_more_than_there_is_memory_for_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str, says: str
) -> None:
    balls = [f'[[object]]\nname = "b{k}"\nclass = "driven"\nsphere = 0.1\ntopic = "/b"\n' for k in range(3)]
    (tmp_path / "scene.toml").write_text("".join(balls))
    assert len(load_world(tmp_path / "scene.toml").body_names) == 3
    monkeypatch.setattr(assembly, limit, 2)
    with pytest.raises(SceneError, match=f"scene.toml: .*{says}.* at most 2"):
        load_world(tmp_path / "scene.toml")


def test_thousands_of_fixed_objects_need_little_memory(tmp_path: Path) -> None:
    """The workspace of the least-distance problem goes with what is driven."""
    balls = [f'[[object]]\nname = "b{k}"\nclass = "fixed"\nsphere = 0.1\nposition = [{k}, 0, 0]\n' for k in range(1000)]
    (tmp_path / "scene.toml").write_text("".join(balls))
    assert make_replay_data(load_world(tmp_path / "scene.toml").scene).workspace.problem.least.basis.nbytes < 1e6
