"""Measures of an output's motion: against the whole columns at once, and angles of joints against the joint states."""

from __future__ import annotations

import json

import numpy as np
import pytest

import geomphys
from geomphys.analysis import output_motion
from geomphys.analysis.diff.quantities import measure_table
from geomphys.analysis.joint_angles import Unwrapper, link_trees
from geomphys.analysis.motion_quality import MotionQuality
from geomphys.analysis.output_motion import OutputMotionMeter
from geomphys.output.output_log import OutputFrame, open_output
from tests.made import Results


def test_measures_of_both_outputs_stand_side_by_side(landed: Results) -> None:
    difference = geomphys.compare_outputs(landed.out, landed.raised)
    shown = {name: values for name, *values in measure_table(difference)}
    sides = [geomphys.statistics_of([path]).outputs[0].values for path in (landed.out, landed.raised)]
    assert shown["amplification, p95"] == [f"{side['amplification'].p95:.2f}" for side in sides]
    assert shown["correction, largest"] == [f"{1e3 * side['correction_m'].max:.3g} mm" for side in sides]


@pytest.fixture(scope="module")
def frames(landed: Results) -> list[OutputFrame]:
    return list(open_output(landed.out).frames())


def columns(frames: list[OutputFrame]) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names of the links, recorded and corrected poses (n, L, 7)."""
    names = [name.removeprefix("recorded/") for name in frames[0].recorded.names]
    corrected = [frame.tf.values[[frame.tf.names.index(name) for name in names]] for frame in frames]
    return names, np.array([frame.recorded.values for frame in frames]), np.array(corrected)


def test_angles_of_joints_are_those_of_the_joint_states(landed: Results, frames: list[OutputFrame]) -> None:
    names, _, corrected = columns(frames)
    links = link_trees(open_output(landed.out), names)
    angles = links.angles(corrected)
    (topic,) = frames[0].joints
    joints = frames[0].joints[topic].names
    stated = np.array([frame.joints[topic].values for frame in frames])
    assert angles.shape == stated.shape
    order = [int(np.abs(np.cos(stated - angles[:, [k]]) - 1.0).max(axis=0).argmin()) for k in range(angles.shape[1])]
    assert sorted(order) == list(range(len(joints)))  # each angle is that of one joint
    assert np.abs(np.exp(1j * angles) - np.exp(1j * stated[:, order])).max() < 1e-9


def test_links_of_an_avatar_are_one_tree(landed: Results, frames: list[OutputFrame]) -> None:
    names = [*columns(frames)[0], "a cup"]
    trees = link_trees(open_output(landed.out), names).trees
    assert len(set(trees[:-1].tolist())) == 1
    assert trees[-1] != trees[0]


def test_unwrapped_angles_are_continuous_over_pieces() -> None:
    true = np.cumsum(np.random.default_rng(1).uniform(-1.0, 1.2, (200, 2)), axis=0)
    unwrap = Unwrapper()
    pieces = [unwrap.add(np.angle(np.exp(1j * true[k : k + 7]))) for k in range(0, 200, 7)]
    assert np.diff(np.concatenate(pieces), axis=0) == pytest.approx(np.diff(true, axis=0))


def test_measures_are_those_of_the_whole_columns(
    landed: Results, frames: list[OutputFrame], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(output_motion, "BATCH_FRAMES", 20)
    log = open_output(landed.out)
    meter = OutputMotionMeter(log)
    for frame in frames:
        meter.add(frame)
    found = meter.motion()
    names, recorded, corrected = columns(frames)
    links = link_trees(log, names)
    whole = MotionQuality(links.trees)
    metrics = log.metrics()
    whole.add(
        metrics["time_ns"], recorded, corrected, depths=metrics["recorded_penetration_m"],
        recorded_angles=np.unwrap(links.angles(recorded), axis=0),
        corrected_angles=np.unwrap(links.angles(corrected), axis=0),
    )  # fmt: skip
    for name, value in vars(whole.figures()).items():
        assert getattr(found, name) == (None if value is None else pytest.approx(value, rel=1e-9)), name
    assert found.jerk_rms_ratio is not None
    assert found.contacts_recorded == metrics["contacts_recorded"].sum() > 0
    assert found.contacts_kept == metrics["contacts_kept"].sum()


def test_statistics_and_differences_have_them(landed: Results, pressed: Results) -> None:
    statistics = geomphys.statistics_of([landed.out, pressed.out])
    as_json = json.loads(json.dumps(statistics.as_dict(), allow_nan=False))
    first = as_json["outputs"][0]
    assert first["motion"]["contacts_recorded"] > 0
    assert first["worst"][0]["kind"] == "recorded_penetration"
    assert first["values"]["fingertip_error_in_contact_m"]["count"] < first["values"]["fingertip_error_m"]["count"]
    assert as_json["all"]["motion"] is None
    difference = geomphys.compare_outputs(landed.out, landed.raised)
    as_json = json.loads(json.dumps(difference.as_dict(), allow_nan=False))
    assert as_json["motion"]["a"] == first["motion"]
    assert as_json["worst"]["a"] == first["worst"]
    raised = geomphys.statistics_of([landed.raised]).outputs[0].values
    for name, value in as_json["values"]["a"].items():
        assert value == first["values"][name]
        assert as_json["values"]["b"][name] == vars(raised[name])
    poses_alone = geomphys.compare_outputs(landed.out, landed.raised, channels=["/tf"])
    assert (poses_alone.motion, poses_alone.values) == (None, None)
