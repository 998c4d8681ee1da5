"""A LeRobot data set has the files, features and figures of format v3.0."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import geomphys
from geomphys.errors import LogError, OutputError
from geomphys.output.output_log import open_output
from tests.made import Results


@pytest.fixture(scope="module")
def dataset(landed: Results, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lerobot") / "dataset"
    assert geomphys.export_lerobot(landed.out, folder) == 72
    return folder


def test_its_files_are_where_the_format_says(dataset: Path) -> None:
    assert sorted(p.relative_to(dataset).as_posix() for p in dataset.rglob("*") if p.is_file()) == [
        "data/chunk-000/file-000.parquet", "meta/episodes/chunk-000/file-000.parquet", "meta/info.json", "meta/stats.json",
        "meta/tasks.parquet",
    ]  # fmt: skip


def test_rows_fit_the_features_announced(dataset: Path) -> None:
    info = json.loads((dataset / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0"
    assert (info["total_episodes"], info["total_frames"], info["fps"]) == (1, 72, 60)
    rows = pd.read_parquet(dataset / info["data_path"].format(chunk_index=0, file_index=0))
    assert set(rows.columns) == set(info["features"])
    for name, feature in info["features"].items():
        values = np.stack(rows[name].to_numpy()) if feature["names"] else rows[name].to_numpy()
        assert values.dtype == feature["dtype"], name
        assert values.shape[1:] == (tuple(feature["shape"]) if feature["names"] else ())
        assert np.isfinite(values).all()
        if feature["names"]:
            assert len(feature["names"]) == feature["shape"][0]
    assert rows["timestamp"].to_numpy() == pytest.approx(np.arange(72) / 60, abs=1e-6)


def test_the_state_is_the_corrected_motion(dataset: Path, landed: Results) -> None:
    info = json.loads((dataset / "meta/info.json").read_text())
    rows = pd.read_parquet(dataset / "data/chunk-000/file-000.parquet")
    names = info["features"]["observation.state"]["names"]
    assert names[-7:] == [f"root.{key}" for key in ("x", "y", "z", "qx", "qy", "qz", "qw")]
    differs = False
    for row, frame in zip(rows.itertuples(), open_output(landed.out).frames(), strict=True):
        state, recorded = rows["observation.state"][row.Index], rows["observation.recorded"][row.Index]
        assert np.array_equal(state[:-7], frame.joints["/joint_states"].values.astype(np.float32))
        root = frame.tf.names.index("forearm")
        assert np.array_equal(state[-7:], frame.tf.values[root].astype(np.float32))
        differs |= not np.array_equal(state, recorded)
    assert differs, "the hand was lifted"


def test_its_episode_says_where_its_rows_are(dataset: Path) -> None:
    episode = pd.read_parquet(dataset / "meta/episodes/chunk-000/file-000.parquet").iloc[0]
    assert (episode["length"], episode["dataset_from_index"], episode["dataset_to_index"]) == (72, 0, 72)
    tasks = pd.read_parquet(dataset / "meta/tasks.parquet")
    assert list(tasks.index) == list(episode["tasks"])
    stats = json.loads((dataset / "meta/stats.json").read_text())
    rows = np.stack(pd.read_parquet(dataset / "data/chunk-000/file-000.parquet")["observation.state"].to_numpy())
    assert stats["observation.state"]["max"] == pytest.approx(rows.max(axis=0).tolist(), rel=1e-6)
    assert stats["observation.state"]["count"] == [72]


def test_what_cannot_be_an_episode_is_told(dataset: Path, landed: Results, pressed: Results, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="exists already; name a new folder"):
        geomphys.export_lerobot(landed.out, dataset)
    with pytest.raises(LogError, match="has no avatar"):
        geomphys.export_lerobot(pressed.out, tmp_path / "new")
    assert not (tmp_path / "new").exists()
