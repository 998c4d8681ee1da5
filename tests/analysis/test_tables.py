"""Exported tables hold what the output holds, in both formats, and pandas and DuckDB read them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

import geomphys
from geomphys.analysis.tables import COLUMNS, POSE
from geomphys.errors import ConfigError, OutputError
from geomphys.output.output_log import OutputFrame, open_output
from tests.made import Results


@pytest.fixture(scope="module")
def frames(landed: Results) -> list[OutputFrame]:
    return list(open_output(landed.out).frames())


@pytest.fixture(scope="module", params=["parquet", "csv"])
def tables(
    request: pytest.FixtureRequest, landed: Results, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, pd.DataFrame]:
    folder = tmp_path_factory.mktemp("tables") / "deep" / "folder"
    rows = geomphys.export_tables(landed.out, folder, file_format=request.param)
    assert sorted(p.name for p in folder.iterdir()) == sorted(f"{table}.{request.param}" for table in COLUMNS)
    read = pd.read_parquet if request.param == "parquet" else pd.read_csv
    found = {table: read(folder / f"{table}.{request.param}") for table in COLUMNS}
    assert {table: len(frame) for table, frame in found.items()} == rows
    return found


def test_columns_are_those_documented(tables: dict[str, pd.DataFrame]) -> None:
    for table, columns in COLUMNS.items():
        assert list(tables[table].columns) == [name for name, _ in columns]
    assert list(tables["poses"].columns[:10]) == ["time_ns", "frame", "body", *POSE]
    assert list(tables["joints"].columns) == ["time_ns", "frame", "avatar", "joint", "position", "recorded"]


def test_poses_are_those_of_tf_bit_for_bit(tables: dict[str, pd.DataFrame], frames: list[OutputFrame]) -> None:
    poses = tables["poses"].set_index(["frame", "body"])
    for frame in frames[::20]:
        for name, pose in zip(frame.tf.names, frame.tf.values, strict=True):
            row = poses.loc[(frame.index, name)]
            assert np.array_equal(row[list(POSE)].to_numpy(float), pose)
            assert row["time_ns"] == frame.time_ns
        for name, pose in zip(frame.recorded.names, frame.recorded.values, strict=True):
            row = poses.loc[(frame.index, name.removeprefix("recorded/"))]
            assert np.array_equal(row[[f"recorded_{key}" for key in POSE]].to_numpy(float), pose)
    fixed = tables["poses"].query("body == 'table'")
    assert list(fixed["frame"]) == [frames[0].index]
    assert fixed["recorded_x"].isna().all()


def test_joints_are_corrected_and_recorded_ones(tables: dict[str, pd.DataFrame], landed: Results) -> None:
    joints = tables["joints"]
    world = geomphys.load_world(landed.scene)
    from geomphys.recording.frames import FrameSource
    from tests.made import WINDOW

    with FrameSource(landed.log, world, WINDOW) as source:
        recorded = np.array([frame.angles for _, frame in zip(range(20), source, strict=False)])
    columns = joints.pivot_table(index="frame", columns="joint", values="recorded")[list(world.dof_names)].to_numpy()
    assert columns[:20] == pytest.approx(recorded, abs=1e-9)
    assert set(joints["avatar"]) == {"hand"}
    assert not joints["position"].isna().any()


def test_contacts_and_metrics_are_those_of_the_channels(
    tables: dict[str, pd.DataFrame], frames: list[OutputFrame]
) -> None:
    contacts, metrics = tables["contacts"], tables["metrics"]
    rows = [(f.index, c) for f in frames for c in f.contacts]
    assert len(rows) > 50
    assert list(contacts["frame"]) == [index for index, _ in rows]
    for column, get in {
        "body_a": "body_a",
        "body_b": "body_b",
        "depth": "depth",
        "normal_impulse": "normal_impulse",
    }.items():
        assert list(contacts[column]) == [getattr(c, get) for _, c in rows]
    assert np.array_equal(contacts[["x", "y", "z"]].to_numpy(), [c.point for _, c in rows])
    assert np.array_equal(contacts[["nx", "ny", "nz"]].to_numpy(), [c.normal for _, c in rows])
    for name in ("frame", "recorded_penetration_m", "correction_m", "flags", "held"):
        assert list(metrics[name]) == [f.metrics[name] for f in frames]
    assert set(contacts["body_a"]) | set(contacts["body_b"]) <= set(tables["poses"]["contact_body"])


def test_what_is_there_stays_without_force(landed: Results, tmp_path: Path) -> None:
    (tmp_path / "joints.parquet").write_text("mine")
    with pytest.raises(OutputError, match=r"joints\.parquet: exists already"):
        geomphys.export_tables(landed.out, tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["joints.parquet"]
    assert geomphys.export_tables(landed.out, tmp_path, force=True)["joints"] > 0
    with pytest.raises(ConfigError, match="expected parquet or csv"):
        geomphys.export_tables(landed.out, tmp_path, file_format="xlsx")


def test_two_exports_are_equal_in_bytes(landed: Results, tmp_path: Path) -> None:
    for name in ("one", "two"):
        geomphys.export_tables(landed.out, tmp_path / name)
    for table in COLUMNS:
        assert (tmp_path / "one" / f"{table}.parquet").read_bytes() == (
            tmp_path / "two" / f"{table}.parquet"
        ).read_bytes()


def test_a_recorded_angle_is_the_turn_of_the_recorded_links() -> None:
    """A joint about a slanted axis with an offset frame, turned by known angles, also beyond half a turn."""
    from types import SimpleNamespace
    from typing import Any

    from scipy.spatial.transform import Rotation

    from geomphys.analysis.joint_angles import RecordedJoints
    from geomphys.output.decoders import Poses

    axis = np.array([[1.0, 0, 0], [2.0, -1.0, 0.5], [0.3, 0.4, -0.9]])
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    turns = np.array([[0.0, 0, 0], [0.3, -1.0, 0.2], [1.0, 0.1, 0.0]])  # rpy
    frames = [Rotation.from_euler("xyz", turn) for turn in turns]
    shifts = np.array([[0.0, 0, 0], [0.1, 0.2, 0.3], [0.0, -0.1, 0.05]])

    def joint(name: str, kind: str, parent: str, child: str, k: int) -> str:
        rpy, xyz, direction = (" ".join(map(repr, row[k].tolist())) for row in (turns, shifts, axis))
        return (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{direction}"/></joint>'
        )

    links = "".join(f'<link name="{name}"/>' for name in "abc")
    joints = joint("turn", "revolute", "a", "b", 1) + joint("slide", "prismatic", "b", "c", 2)
    urdf = f'<robot name="arm">{links}{joints}</robot>'
    output: Any = SimpleNamespace(attachments=lambda: {"arm.urdf": urdf.encode()})

    def pose(rotation: Rotation, position: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([position, rotation.as_quat()])

    root, at = Rotation.from_rotvec([0.5, 0.6, -0.7]), np.array([3.0, -2.0, 1.0])
    for angle, slide in ((0.0, 0.0), (0.7, -0.02), (-3.0, 0.1), (4.0, 0.0), (-9.0, 0.3)):
        second, second_at = root * frames[1] * Rotation.from_rotvec(angle * axis[1]), at + root.apply(shifts[1])
        third = second * frames[2]
        third_at = second_at + second.apply(shifts[2]) + third.apply(slide * axis[2])
        poses = Poses(
            ("recorded/a", "recorded/b", "recorded/c"),
            np.array([pose(root, at), pose(second, second_at), pose(third, third_at)]),
        )
        near = np.array([angle + 0.5, 0.0])
        found = RecordedJoints(output).values(poses, "arm", ("turn", "slide"), near)
        assert found == pytest.approx([angle, slide], abs=1e-12)
    assert np.isnan(
        RecordedJoints(output).values(Poses((), np.zeros((0, 7))), "arm", ("turn", "gone"), np.zeros(2))
    ).all()


def test_duckdb_joins_contacts_to_poses(landed: Results, tmp_path: Path) -> None:
    import duckdb

    geomphys.export_tables(landed.out, tmp_path)
    ((contacts, joined),) = duckdb.sql(
        f"""SELECT (SELECT count(*) FROM '{tmp_path}/contacts.parquet'), count(*) FROM '{tmp_path}/contacts.parquet' c
        JOIN '{tmp_path}/poses.parquet' p ON p.frame = c.frame AND p.contact_body = c.body_a"""
    ).fetchall()
    assert contacts == joined > 50
