"""From decoded messages to streams: units, offsets, order, mapping by names, poses in frames that move."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.recording.channels import JointSample, Pose
from geomphys.recording.input_plan import JointInput, PoseInput
from geomphys.recording.recorded_space import RecordedSpace
from geomphys.recording.routes import JointRoute, LengthMismatches, RootRoute
from geomphys.recording.stream_prescan import Prescan, StreamInfo, joint_key
from geomphys.recording.transform_chain import TransformBuffer
from geomphys.recording.transform_plan import TransformPlan
from geomphys.scene.topic_sources import JointSource, RootSource
from tests.recording.log_files import IDENTITY, S

GAP = S // 4
NAMES = ("a", "b", "slide")
PRISMATIC = np.array([False, False, True])


def joint_route(degrees: bool = False, side: str = "", constant: str = "", **source: object) -> JointRoute:
    """A route of three joints that vary but `constant`, which has the value 0.5."""
    prescan = Prescan()
    recorded = [*source.get("rename", {}), *NAMES]  # type: ignore[misc]
    for name in recorded:
        info = StreamInfo(value=(0.5,), varies=name != constant)
        prescan.streams["/j", joint_key(name, side)] = info
    fields = {
        "tree": 0,
        "topic": "/j",
        "unit": None,
        "rename": {},
        "dofs": {n: k for k, n in enumerate(NAMES)},
    } | source
    made = JointInput(JointSource(**fields), "/j", side, (), degrees)  # type: ignore[arg-type]
    return JointRoute(made, prescan, GAP, PRISMATIC, holds_bad_samples=False)


def sample(side: str = "", **values: float) -> JointSample:
    return JointSample(None, list(values), list(values.values()), side)


def last(route: JointRoute) -> list[float]:
    assert route.stream is not None
    return [float(x) for x in route.stream.at(route.latest).value]


def test_angles_in_degrees_become_radians_and_lengths_stay() -> None:
    route = joint_route(degrees=True)
    route.add(S, sample(a=90.0, b=-180.0, slide=0.25))
    assert last(route) == pytest.approx([math.pi / 2, -math.pi, 0.25])


def test_factors_and_offsets_are_applied_after_the_unit() -> None:
    """The offset is in rad, whatever the unit of the log."""
    route = joint_route(degrees=True, factors={"a": -2.0}, offsets={"a": 0.1, "slide": 0.5})
    route.add(S, sample(a=90.0, b=0.0, slide=0.25))
    assert last(route) == pytest.approx([-math.pi + 0.1, 0.0, 0.75])


def test_without_a_factor_or_an_offset_no_bit_changes() -> None:
    route = joint_route()
    values = (-0.0, 1e-300, 0.1)
    route.add(S, sample(a=values[0], b=values[1], slide=values[2]))
    assert np.array(last(route)).tobytes() == np.array(values).tobytes()


def test_joints_are_matched_by_name_in_any_order_and_of_two_of_one_name_the_first_counts() -> None:
    route = joint_route(rename={"other": "b"})
    route.add(S, JointSample(None, ["x", "slide", "other", "a", "a", "b"], [9.0, 3.0, 2.0, 1.0, 7.0, 8.0], ""))
    assert last(route) == [1.0, 2.0, 3.0]
    assert route.names == {"x", "slide", "other", "a", "b"}


def test_joints_that_do_not_vary_are_constants() -> None:
    route = joint_route(constant="b")
    assert route.constants == {1: 0.5}
    assert route.columns.tolist() == [0, 2]


def test_a_missing_joint_keeps_its_stream_and_a_bad_one_is_not_taken() -> None:
    route = joint_route()
    route.add(S, sample(a=1.0, b=2.0, slide=3.0))
    route.add(S + S // 10, sample(a=1.5))
    route.add(S + S // 5, sample(a=math.nan, b=2.5, slide=1e300))
    assert route.stream is not None
    values = route.stream.at(S).value
    assert values.tolist() == [1.0, 2.0, 3.0]
    assert float(route.stream.at(S + S // 10).value[0]) == 1.5
    assert float(route.stream.at(S + S // 5).value[1]) == 2.5


def test_messages_of_the_other_glove_are_passed_over() -> None:
    route = joint_route(side="left")
    assert not route.add(S, sample(side="right", a=1.0, b=1.0, slide=1.0))
    assert route.add(S, sample(side="left", a=2.0, b=2.0, slide=2.0))
    assert last(route) == [2.0, 2.0, 2.0]


def test_messages_out_of_order_are_counted_with_the_largest_step_back() -> None:
    route = joint_route()
    for time in (10, 20, 15, 12, 30):
        route.add(time * S, sample(a=1.0, b=1.0, slide=1.0))
    assert (route.out_of_order, route.max_disorder, route.latest) == (2, 8 * S, 30 * S)


def test_unequal_numbers_of_names_and_values_are_counted_by_kind() -> None:
    counts = LengthMismatches()
    for values in ((), (1.0,), (1.0, 2.0, 3.0), (1.0, 2.0, 3.0, 4.0)):
        counts.add(JointSample(None, ["a", "b"], values, ""))
    assert (counts.empty, counts.shorter, counts.longer) == (1, 1, 2)
    route = joint_route()
    route.add(S, JointSample(None, ["a", "b"], [1.0], ""))
    assert route.length_mismatches.shorter == 1
    assert route.stream is not None
    assert route.stream.at(S).held  # no value can be given to a name


def root_route(space: RecordedSpace, **source: object) -> RootRoute:
    fields = {"tree": 0, "topic": "/p", "position": (0, 0, 0), "orientation": (0, 0, 0, 1)} | source
    made = PoseInput(RootSource(**fields), "/p", "", ())  # type: ignore[arg-type]
    prescan = Prescan()
    prescan.streams["/p", ""] = StreamInfo(varies=True)
    tracks = TransformBuffer(TransformPlan("log.mcap"), space, GAP)
    return RootRoute(made, prescan, tracks, GAP, holds_bad_samples=False)


def test_a_root_is_where_space_tracker_and_offset_say() -> None:
    """world_from_space ∘ space_from_tracker ∘ tracker_from_root, by matrices of scipy; positions in millimetres."""
    turns = [Rotation.random(random_state=k) for k in range(3)]
    space = RecordedSpace((1.0, 2.0, 3.0, *turns[0].as_quat()), 1000.0)
    route = root_route(space, position=(0.1, 0.2, 0.3), orientation=tuple(turns[2].as_quat()))
    route.add(S, Pose(None, "", (500.0, -250.0, 100.0, *turns[1].as_quat()), ""))
    tracker = route.stream.at(S).value
    assert tracker[:3] == pytest.approx([0.5, -0.25, 0.1])
    found = route.world_from_root(tracker)
    point = turns[0].apply(turns[1].apply([0.1, 0.2, 0.3]) + np.array([0.5, -0.25, 0.1])) + np.array([1, 2, 3])
    assert found[:3] == pytest.approx(point, abs=1e-12)
    assert (Rotation.from_quat(found[3:]) * (turns[0] * turns[1] * turns[2]).inv()).magnitude() <= 1e-12


def test_a_tracker_that_is_the_root_is_copied_to_the_bit() -> None:
    route = root_route(RecordedSpace())
    value = (0.1, -0.0, 1e-9, *IDENTITY[3:])
    route.add(S, Pose(None, "", value, ""))
    assert np.array(route.world_from_root(route.stream.at(S).value)).tobytes() == np.array(value).tobytes()


def test_poses_out_of_order_are_counted() -> None:
    route = root_route(RecordedSpace())
    for time in (3, 5, 4):
        route.add(time * S, Pose(None, "", IDENTITY, ""))
    assert (route.out_of_order, route.max_disorder) == (1, S)
