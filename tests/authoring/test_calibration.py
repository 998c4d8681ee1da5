"""Calibration: what is injected comes back on logs that show it, and is named and left alone on logs that do not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import geomphys
from geomphys.authoring.contact_fit import ContactFit, with_differences
from geomphys.authoring.contact_frames import collect
from geomphys.authoring.contact_gaps import Unknowns
from geomphys.authoring.known_changes import known_part, name_unknown
from geomphys.authoring.time_shift import find_time_shift
from geomphys.config import Config
from geomphys.numerics.transforms import quaternion_from_rpy, rotation_from_quaternion
from geomphys.scene.skeleton import load_skeleton
from tests.authoring.calibrated_logs import (
    ALL_WAYS,
    CHANGES,
    FLAT,
    HEIGHT,
    OFFSET,
    deviations_of_touches,
    stretches,
    write_log,
    write_scene,
)

_RNG = np.random.default_rng(4)
WAYS = (*ALL_WAYS, *(tuple(map(float, _RNG.uniform(-80, 80, 3))) for _ in range(6)))


def angle_to_truth(rpy):
    dot = abs(float(np.dot(quaternion_from_rpy(rpy), quaternion_from_rpy(OFFSET[1]))))
    return float(np.degrees(2 * np.arccos(min(dot, 1.0))))


@pytest.fixture(scope="module")
def rich(tmp_path_factory):
    """A log that shows everything, with 1 mm of noise, every twelfth frame 20 mm off."""
    folder = tmp_path_factory.mktemp("rich")
    return folder, write_log(folder, WAYS, noise=0.001, outliers=12)


@pytest.fixture(scope="module")
def flat(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flat")
    return folder, write_log(folder, FLAT)


def calibrated(folder, log, *, ways=WAYS, seek=("offset", "surface"), **errors):
    scene = write_scene(folder, **errors)
    found = stretches(ways)
    return geomphys.calibrate(
        log, scene, flats=found[:3], touches=[(a + 0.1, "") for a, _ in found[3:]], on=["table"], seek=seek
    )


@pytest.mark.parametrize("errors", [
    {"position": (0.05, -0.04, 0.005), "rpy": (10, -15, 25), "height": 0.80},
    {"position": (-0.01, 0.02, 0.06), "rpy": (0, -5, 15), "height": 0.70},
])  # fmt: skip
def test_offset_tilt_and_height_come_back_together(rich, errors):
    found = calibrated(*rich, **errors)
    np.testing.assert_allclose(found.offset_m, OFFSET[0], atol=0.002)
    assert angle_to_truth(found.offset_rpy_deg) < 1.0
    assert found.surfaces["table"].height_m == pytest.approx(HEIGHT, abs=0.002)
    assert found.surfaces["table"].tilt_deg < 1.0
    assert found.residual_m < 0.002
    assert found.unobservable == ("delay of /glove",)
    assert list(found.confidence) == list(CHANGES)
    within = np.array([found.confidence[f"offset along {a}"] for a in "xyz"])
    assert (np.abs(np.subtract(found.offset_m, OFFSET[0])) < within).all()
    assert (within <= 0.002).all()


def test_a_flat_hand_shows_height_or_offset_but_not_which(flat):
    found = calibrated(*flat, ways=FLAT, height=0.70)
    assert "offset along z with height of 'table'" in found.unobservable
    assert {"offset along x", "offset along y", "rotation of the offset about z"} & {
        part for line in found.unobservable for part in line.split(" with ")
    } == {"offset along x", "offset along y", "rotation of the offset about z"}
    np.testing.assert_allclose(found.offset_m, OFFSET[0], atol=1e-3)
    assert found.surfaces["table"].height_m == pytest.approx(0.70, abs=1e-4)
    assert not [c for c in found.changes if c.kind == "object"]


def test_changes_that_fit_as_well_are_not_shown():
    names, unknowns = ["a", "b", "c"], Unknowns(False, (1,))
    same, other = np.array([3.0, 0.0, 0.0]), np.array([0.0, 4.0, -4.0])
    found = with_differences(0.01 * np.eye(3), [np.zeros(3), 0.001 * same, other])
    assert name_unknown(names, found) == ["b with c"]
    assert name_unknown(names, 0.01 * np.eye(3)) == []
    fit = ContactFit(np.array([9.0, 8.0, 7.0]), found, {}, 0.0, 0.0)
    np.testing.assert_allclose(known_part(fit, unknowns)[0], 9.0)


def test_what_is_hidden_is_left_and_what_is_known_beside_it_is_not():
    unknowns = Unknowns(True, ())
    axis = np.array([0.2, -0.3, 1.0]) / np.linalg.norm([0.2, -0.3, 1.0])
    covariance = 0.01 * np.eye(6)
    covariance[3:, 3:] += 100.0 * np.outer(axis, axis)
    fit = ContactFit(np.arange(1.0, 7.0), covariance, {}, 0.0, 0.0)
    found = known_part(fit, unknowns)
    np.testing.assert_allclose(found[:3], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(found[3:], fit.change[3:] - axis * (axis @ fit.change[3:]), atol=1e-9)
    covariance[3:, 3:] = 0.01 * np.eye(3) + np.outer(axis, axis)  # known to some units: neither hidden nor known
    np.testing.assert_array_equal(known_part(fit, unknowns)[5], 0.0)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("flats", "touches"), [(0, 6), (0, 24), (3, 8)])
def test_what_is_written_is_right_and_what_is_not_is_named(tmp_path, seed, flats, touches):
    assert wrong_values(tmp_path, flats, touches, seed) == []


def test_the_right_fit_is_found_where_a_wrong_one_is_found_more_easily(tmp_path):
    """From a wide loss one start in 20 leads to it; the other, 11 degrees away, leaves gaps that are nearly as small."""
    assert wrong_values(tmp_path, 3, 6, seed=13) == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3, 43))
@pytest.mark.parametrize(("flats", "touches"), [(0, 5), (0, 8), (0, 12), (0, 24), (3, 0), (3, 6), (3, 16)])
def test_what_is_written_is_right_whatever_is_injected(tmp_path, seed, flats, touches):
    assert wrong_values(tmp_path, flats, touches, seed) == []


def wrong_values(folder, flats, touches, seed):
    """Of a log with random ways to rest and random errors in the scene: values wrong and not named, or named and shown."""
    rng = np.random.default_rng(seed)
    ways = [(0.0, 0.0, float(rng.uniform(-80, 80))) for _ in range(flats)]
    ways += [tuple(map(float, rng.uniform(-80, 80, 3))) for _ in range(touches)]
    log = write_log(folder, ways, noise=0.001)
    signs = rng.choice([-1.0, 1.0], 7) * rng.uniform(0.3, 1.0, 7)
    position = tuple(map(float, np.array(OFFSET[0]) + 0.03 * signs[:3]))
    rpy, height = tuple(map(float, np.array(OFFSET[1]) + 5.0 * signs[3:6])), float(HEIGHT + 0.05 * signs[6])
    scene, found = write_scene(folder, position=position, rpy=rpy, height=height), stretches(ways)
    found = geomphys.calibrate(
        log, scene, flats=found[:flats], touches=[(a + 0.1, "") for a, _ in found[flats:]], on=["table"]
    )
    error = rotation_from_quaternion(quaternion_from_rpy(found.offset_rpy_deg))
    error = error @ rotation_from_quaternion(quaternion_from_rpy(OFFSET[1])).T
    rotation = np.degrees([error[2, 1] - error[1, 2], error[0, 2] - error[2, 0], error[1, 0] - error[0, 1]]) / 2
    errors = {f"offset along {a}": (found.offset_m[k] - OFFSET[0][k]) / 0.002 for k, a in enumerate("xyz")}
    errors |= {f"rotation of the offset about {a}": rotation[k] for k, a in enumerate("xyz")}
    errors["height of 'table'"] = (found.surfaces["table"].height_m - HEIGHT) / 0.002
    errors["tilt of 'table'"] = found.surfaces["table"].tilt_deg
    named = " ".join(found.unobservable)
    wrong = [(name, float(error)) for name, error in errors.items() if name not in named and abs(error) > 1.0]
    if touches >= 24:  # no other fit is as good, so what is named is what the touches do not show
        shown = deviations_of_touches(folder, ways, 0.0003)
        wrong += [(f"{name} is hidden", shown[name]) for name in CHANGES if name in named and shown[name] < 0.3]
    return wrong


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_flats_show_the_table_whatever_is_injected_where_the_offset_is_right(tmp_path, seed):
    rng = np.random.default_rng(seed)
    ways = [(0.0, 0.0, float(yaw)) for yaw in rng.uniform(-80, 80, 3)]
    height = HEIGHT + float(rng.choice([-1.0, 1.0]) * rng.uniform(0.01, 0.05))
    log, scene = write_log(tmp_path, ways, noise=0.001, outliers=20), write_scene(tmp_path, height=height)
    found = geomphys.calibrate(log, scene, flats=stretches(ways), on=["table"], seek=("surface",))
    assert found.surfaces["table"].height_m == pytest.approx(HEIGHT, abs=0.002)
    assert found.surfaces["table"].tilt_deg < 1.0
    assert "height of 'table'" not in found.unobservable


def test_a_fit_from_beneath_the_table_is_no_rival(flat):
    """A hand that is as thick on both sides might lie under a table that is 114 mm higher, which is within what is expected."""
    folder, log = flat
    found = geomphys.calibrate(log, write_scene(folder, height=0.70), flats=stretches(FLAT), on=["table"])
    height = [line for line in found.unobservable if "height" in line]
    assert height == ["offset along z with height of 'table'"]


def test_touches_alone_show_fewer_directions_than_there_are_touches(rich):
    folder, log = rich
    scene = write_scene(folder, position=(0.03, -0.02, 0.03))
    found = geomphys.calibrate(log, scene, touches=[(a + 0.1, "") for a, _ in stretches(WAYS)[3:7]], on=["table"])
    assert found.changes == ()
    assert len({name for line in found.unobservable for name in line.split(" with ")}) == 10


def test_it_shows_the_height_where_the_offset_is_right(flat):
    found = calibrated(*flat, ways=FLAT, seek=("surface",), height=0.70)
    assert found.surfaces["table"].height_m == pytest.approx(HEIGHT, abs=0.001)
    assert found.offset_m == pytest.approx(OFFSET[0])


def test_a_tilted_table_is_found(tmp_path):
    log = write_log(tmp_path, ((0, 3, 0), (0, 3, 40)), tilt=(0.0, 3.0, 0.0))
    scene = write_scene(tmp_path)
    ways = [(0.55, 0.95), (1.55, 1.95)]
    found = geomphys.calibrate(log, scene, flats=ways[:1], on=["table"], seek=("surface",))
    assert found.surfaces["table"].tilt_deg == pytest.approx(3.0, abs=0.5)


def test_slow_moments_count_where_nothing_is_named(flat):
    folder, log = flat
    scene = write_scene(folder, height=0.72)
    found = geomphys.calibrate(log, scene, on=["table"], seek=("surface",))
    assert found.surfaces["table"].height_m == pytest.approx(HEIGHT, abs=0.001)


def test_it_is_written_and_the_rest_of_the_file_stays(flat):
    folder, log = flat
    scene = write_scene(folder, height=0.70)
    before = scene.read_text()
    found = calibrated(folder, log, ways=FLAT, seek=("surface",), height=0.70).write()
    after = scene.read_text()
    assert found.written
    changed = [(a, b) for a, b in zip(before.splitlines(), after.splitlines(), strict=True) if a != b]
    assert all(a.split(" = ")[0] == b.split(" = ")[0] in ("position", "rpy") for a, b in changed)
    assert "# my desk" in after
    assert "# measured with a ruler" in after
    assert "# oak" in after
    assert "# calibrated: 0.0 mm left over" in after
    again = geomphys.calibrate(log, scene, flats=stretches(FLAT), on=["table"], seek=("surface",))
    assert again.surfaces["table"].height_m == pytest.approx(HEIGHT, abs=0.001)
    assert (
        geomphys.calibrate(log, scene, flats=stretches(FLAT), on=["table"], seek=("surface",)).changes == again.changes
    )


def test_an_offset_on_one_line_is_written_beside_the_comment_of_the_line(rich):
    found = calibrated(*rich, position=(0.05, -0.04, 0.005), rpy=(10, -15, 25), height=0.80)
    scene = found.write().write().scene
    (line,) = [line for line in Path(scene).read_text().splitlines() if line.startswith("root")]
    assert line.partition("}")[2].strip() == f"# measured with a ruler; {found.comment}"


@pytest.mark.parametrize(("call", "message"), [
    ({"flats": [(0.5, 1.0)], "on": ["desk"]}, r"on 'desk': the scene has no such object; it has table"),
    ({"flats": [(90.0, 91.0)], "on": ["table"]}, r"has no good frame from 90 to 91 s"),
    ({"touches": [(0.7, "index_nail")], "on": ["table"]}, r"no link 'index_nail'"),
    ({"avatar": "foot"}, r"avatar 'foot': the scene has hand"),
])  # fmt: skip
def test_what_is_not_there_is_named(flat, call, message):
    folder, log = flat
    with pytest.raises(geomphys.GeomphysError, match=message):
        geomphys.calibrate(log, write_scene(folder), **call)


def events(seed, times, lag=0.0):
    """A speed with starts and stops at random times."""
    rng = np.random.default_rng(seed)
    at = np.cumsum(rng.uniform(0.1, 0.6, 100))
    height = rng.uniform(0.2, 1.0, 100)
    return sum(h * np.exp(-(((times - lag - a) / 0.06) ** 2)) for a, h in zip(at, height, strict=True)) + 0.01


@pytest.mark.parametrize("lag", [-0.08, -0.013, 0.0, 0.08])
def test_a_lag_comes_back(lag):
    times = np.arange(0, 12, 1 / 100)
    rng = np.random.default_rng(0)
    second = events(1, times, lag) + 0.02 * rng.random(len(times))
    found = find_time_shift(times, [events(1, times), events(7, times)], second)
    assert found.is_shown
    assert found.seconds == pytest.approx(lag, abs=0.005)


def test_a_lag_that_is_another_in_each_part_of_a_log_is_not_shown():
    times = np.arange(0, 12, 1 / 100)
    drifting = np.where(times < 6, events(1, times), events(1, times, 0.03))
    assert not find_time_shift(times, [events(1, times)], drifting).is_shown


@pytest.mark.parametrize("lag", [0.08, -0.08])
def test_a_lag_comes_back_beside_an_offset_and_a_height(tmp_path, lag):
    log = write_log(tmp_path, WAYS, noise=0.0005, lag=lag, moves=True)
    found = calibrated(tmp_path, log, position=(0.05, -0.04, 0.005), rpy=(10, -15, 25), height=0.80)
    assert found.delay_s == {"/glove": pytest.approx(-lag, abs=0.005)}
    assert found.unobservable == ()
    np.testing.assert_allclose(found.offset_m, OFFSET[0], atol=0.002)
    assert angle_to_truth(found.offset_rpy_deg) < 1.0
    assert found.surfaces["table"].height_m == pytest.approx(HEIGHT, abs=0.002)


def test_the_lag_of_streams_that_move_on_their_own_is_not_shown():
    times = np.arange(0, 12, 1 / 100)
    assert not any(find_time_shift(times, [events(k, times)], events(k + 50, times)).is_shown for k in range(12))
    assert not find_time_shift(times, [events(1, times)], np.zeros(len(times))).is_shown
    assert not find_time_shift(times[:50], [events(1, times[:50])], events(1, times[:50])).is_shown


@pytest.mark.parametrize("lag", [0.08, -0.08])
def test_a_lag_of_a_real_glove(shared_dir, tmp_path, lag):
    scene = tmp_path / "scene.toml"
    urdf = shared_dir / "models" / "human_hands" / "dfki_glove_right.urdf"
    scene.write_text(
        f'[[avatar]]\nname = "hand"\nurdf = "{urdf}"\nroot = {{ topic = "/tracker/right_hand" }}\n'
        f'joints = {{ topic = "/glove/joint_states", delay = {lag} }}\n'
    )
    found = geomphys.calibrate(shared_dir / "recordings" / "dfki_pillow_a_ros2.mcap", scene)
    assert found.delay_s["/glove/joint_states"] == pytest.approx(0.0, abs=0.005)


def test_frames_are_thinned(flat):
    folder, log = flat
    world = geomphys.load_world(write_scene(folder))
    from geomphys.authoring.contact_frames import MAX_FRAMES, Stretch

    recorded = collect(log, world, Config(), 0, [(Stretch(0.0, 3.0), 1)], [1])
    assert MAX_FRAMES // 2 <= len(recorded.contacts) <= MAX_FRAMES


FINGER_WAYS = ((0, 75, 20), (0, 60, 120), (10, 80, -70), (20, 70, 0))
"""Ways to rest on the tip of the middle finger, the longest."""


def with_long_fingers(folder, factor):
    """A log of a hand whose middle finger is longer by a factor, and the scene with the plain hand."""
    log = write_log(
        folder, FINGER_WAYS, factors={f"middle_{part}": factor for part in ("spread", "proximal", "middle", "distal")}
    )
    return log, write_scene(folder)


@pytest.mark.parametrize("factor", [1.12, 1.04])
def test_the_length_of_a_finger_comes_back_and_is_written_as_another_urdf(tmp_path, factor):
    log, scene = with_long_fingers(tmp_path, factor)
    touches = [(a + 0.2, "middle_distal") for a, _ in stretches(FINGER_WAYS)]
    found = geomphys.calibrate(log, scene, touches=touches, on=["table"], seek=("fingers",))
    assert found.finger_scale == {"middle": pytest.approx(factor, abs=0.02)}
    assert found.unobservable == ("delay of /glove",)
    before = (tmp_path / "hand.urdf").read_bytes()
    found.write()
    assert (tmp_path / "hand.urdf").read_bytes() == before
    assert 'urdf = "hand_scaled.urdf" # calibrated: ' in scene.read_text()
    again = geomphys.calibrate(log, scene, touches=touches, on=["table"], seek=("fingers",))
    assert again.changes == ()
    assert again.residual_m < 0.001
    assert load_skeleton(tmp_path / "hand_scaled.urdf").dof_names == load_skeleton(tmp_path / "hand.urdf").dof_names


def test_fingers_that_touched_nothing_are_named_and_left(tmp_path):
    log, scene = with_long_fingers(tmp_path, 1.1)
    touches = [(a + 0.2, "") for a, _ in stretches(FINGER_WAYS)]
    found = geomphys.calibrate(log, scene, touches=touches, on=["table"], seek=("fingers",))
    assert {n: f for n, f in found.finger_scale.items() if n != "middle"} == dict.fromkeys(
        ("thumb", "index", "ring", "little"), 1.0
    )
    assert {"length of 'thumb'", "length of 'little'"} <= set(found.unobservable)


def test_a_finger_and_an_offset_that_is_not_known_cannot_be_told_apart_by_few_touches(tmp_path):
    log, scene = with_long_fingers(tmp_path, 1.1)
    touches = [(a + 0.2, "middle_distal") for a, _ in stretches(FINGER_WAYS)]
    found = geomphys.calibrate(log, scene, touches=touches, on=["table"], seek=("offset", "surface", "fingers"))
    assert found.changes == ()
    assert "length of 'middle'" in " ".join(found.unobservable)
