"""Identifiers are the field's words, functions take few parameters, and numbers are not arrays."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest

from tests.house.sources import modules, tree

REFUSED = {
    "aim": "target",
    "articulate": "general_motion",
    "articulated": "general_motion",
    "aside": "excluded, apart, drift",
    "asked": "prescribed, requested",
    "bare": "uncovered, plain",
    "behind": "tracking_error, has_offset",
    "bend": "joint_offset",
    "bends": "joint_offset",
    "bent": "joint_offset, curved",
    "board": "job_queue",
    "brake": "opposing_rate",
    "carried": "attached_motion, supported",
    "carrier": "support_body",
    "carriers": "support_bodies",
    "carry": "attached_motion",
    "course": "trajectory, prescribed_velocity",
    "courses": "trajectories",
    "crew": "worker_pool",
    "dear": "weight",
    "deformed": "general_motion",
    "detour": "tunnelling_check",
    "detours": "tunnelling_check",
    "escape": "depenetration",
    "escapes": "depenetration",
    "eventful": "event_frames",
    "firsts": "first_frames",
    "foresight": "look_ahead",
    "halt": "stop",
    "halts": "stops",
    "hang": "connected",
    "hasty": "stop_on_failure",
    "heft": "effective_mass",
    "how_many": "count",
    "interplay": "coupled_step",
    "kept": "cached, retained",
    "knob": "parameter",
    "knobs": "parameters",
    "lag": "tracking_error",
    "ledger": "impulse_accumulation",
    "let_go": "exclude, release",
    "lightness": "inverse_mass",
    "loose": "unlocked",
    "meet": "in_contact, intersect, encounter",
    "meeting": "encounter",
    "meetings": "encounters",
    "meets": "in_contact, intersects",
    "met": "in_contact, encountered",
    "mine": "reference",
    "narrator": "reporter",
    "odd": "unusual, inconsistent",
    "pace": "rate_limit",
    "paces": "rate_limits",
    "outlined": "noinline",
    "parting": "position_projection",
    "partings": "position_projections",
    "part_ways": "separate",
    "place": "pose, position, offset; open_path",
    "places": "poses, positions, offsets",
    "pull": "acceleration",
    "pulled": "accelerated",
    "push": "normal_impulse",
    "pushed": "displaced, loaded",
    "rescue": "depenetration",
    "rescues": "depenetrations",
    "room": "workspace, margin, capacity, budget",
    "rooms": "workspaces, margins, capacities",
    "rough": "approximate",
    "rowed": "row_state",
    "rub": "tangential_impulse",
    "rubs": "tangential_impulses",
    "seen_at": "measured_at",
    "shove": "position_correction",
    "shoves": "position_corrections",
    "sightings": "view_statistics",
    "sketch": "lowered code",
    "sketched": "lowered",
    "sketches": "lowered code",
    "soon": "a time in its unit",
    "spare": "reserve",
    "spin": "angular_velocity",
    "spread": "islands, extent",
    "stiff": "rigid",
    "stir": "motion_bound",
    "stirred": "moved",
    "stirs": "motion_bounds",
    "tell": "report",
    "tells": "reports",
    "theirs": "incident",
    "told": "reported",
    "trouble": "problem, damage",
    "troubles": "problems",
    "turn": "rotation, angle, substep",
    "turned": "rotated",
    "turns": "rotations, substeps",
    "undisturbed": "without_garbage_collection",
    "unite": "merge_labels",
    "unsettled": "unconverged",
    "want": "request",
    "wanted": "target, requested",
    "wants": "requests",
    "way": "path, displacement",
    "wedge": "infeasible",
    "wedged": "infeasible",
    "wedges": "infeasible",
    "went": "last_step",
    "wish": "desired_velocity",
    "wishes": "desired_velocities",
    "workshop": "geometry_loader",
}
"""Words that mean nothing, or another thing, to who knows the field -> the field's words for what they stood for."""

STANDARD = {"tell", "contacts_kept", "grasps_kept", "CONTACTS_KEPT", "GRASPS_KEPT"}
"""Identifiers that the standard library prescribes (those of a file), and fields of messages that are a contract."""

PARTS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


def words(identifier: str) -> set[str]:
    """The words of an identifier in lower case, singly and joined where a refused phrase has several."""
    split = [part.lower() for part in PARTS.findall(identifier)]
    return set(split) | {phrase for phrase in REFUSED if "_" in phrase and f"_{phrase}_" in f"_{'_'.join(split)}_"}


def identifiers(module: ast.Module) -> Iterator[str]:
    """What a module defines: functions, classes, parameters, variables, attributes it assigns or declares."""
    for node in ast.walk(module):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.alias) and node.asname:
            yield node.asname


def folder_of(package: str, module: str) -> str:
    """The folder of `geomphys/` that a module lies in, its name if it is a module of the root; `cli` for all of `cli/`."""
    return "cli" if package == "cli" else module.split(".")[0] or "geomphys"


def refused_words() -> dict[str, dict[str, set[str]]]:
    """Folder -> refused word -> where: ``module: identifier``."""
    found: dict[str, dict[str, set[str]]] = {}
    for package in ("geomphys", "cli"):
        for name, path in modules(package).items():
            for identifier in {*name.split("."), *identifiers(tree(path))} - STANDARD:
                for word in words(identifier) & REFUSED.keys():
                    of_folder = found.setdefault(folder_of(package, name), {})
                    of_folder.setdefault(word, set()).add(f"{package}.{name}: {identifier}")
    return found


FOUND = refused_words()
FOLDERS = sorted({folder_of(package, name) for package in ("geomphys", "cli") for name in modules(package)})


@pytest.mark.parametrize("folder", FOLDERS)
def test_identifiers_are_in_the_words_of_the_field(folder: str) -> None:
    of_folder = FOUND.get(folder, {})
    bad = [f"{where} - say {REFUSED[word]}" for word in sorted(of_folder) for where in sorted(of_folder[word])]
    assert not bad, "\n".join(bad)


@pytest.mark.parametrize(
    ("source", "word"),
    [
        ("def place_tree(): ...", "place"),
        ("class ChainRoom: ...", "room"),
        ("def f(is_wedged): ...", "wedged"),
        ("self.told = 1", "told"),
        ("KEPT_NORM = 1", "kept"),
        ("set_how_many = 1", "how_many"),
        ("for turn in range(3): ...", "turn"),
        ("import numpy as knobs", "knobs"),
        ("class A:\n    stir: float", "stir"),
    ],
)
def test_a_private_word_is_found(source: str, word: str) -> None:
    assert word in set().union(*map(words, identifiers(ast.parse(source))))


@pytest.mark.parametrize("name", ["replace", "displacement", "returned", "carrying", "roommate", "howmany", "spinner"])
def test_a_word_that_only_contains_one_is_none(name: str) -> None:
    assert not words(name) & REFUSED.keys()


MAX_PARAMETERS = 8


def parameter_count(function: ast.FunctionDef) -> int:
    """How many parameters a function takes."""
    taken = function.args
    return len(taken.posonlyargs) + len(taken.args) + len(taken.kwonlyargs)


def test_functions_of_the_library_take_few_parameters() -> None:
    many = {
        f"{name}.{node.name}"
        for name, path in modules("geomphys").items()
        for node in ast.walk(tree(path))
        if isinstance(node, ast.FunctionDef) and parameter_count(node) > MAX_PARAMETERS
    }
    assert not many, f"more than {MAX_PARAMETERS} parameters: pass a record of options: {sorted(many)}"


def test_parameters_are_counted() -> None:
    functions = ast.parse("def a(x, /, y, *, z): ...\ndef b(): ...").body
    assert [parameter_count(f) for f in functions if isinstance(f, ast.FunctionDef)] == [3, 0]


ONE_ELEMENT = re.compile(r"np\.(zeros|ones|empty|full)\(\(?1[,)]")


@pytest.mark.parametrize("folder", ["collision", "driven", "engine", "keypoints", "simulated"])
def test_no_array_of_one_element_stands_for_a_number(folder: str) -> None:
    bad = [
        f"{name}:{number}"
        for name, path in modules("geomphys").items()
        if name.split(".")[0] == folder
        for number, line in enumerate(path.read_text().splitlines(), start=1)
        if ONE_ELEMENT.search(line)
    ]
    assert not bad, f"return it, or make it a number or a record (`geomphys.jit.packed_records`): {bad}"
