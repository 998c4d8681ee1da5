"""`geomphys batch --ros2` failed with every log: it looked for metrics in the output, which a bag for ROS 2 has not."""

from __future__ import annotations

from pathlib import Path

import geomphys
from geomphys.output.provenance import sha256_of_file
from tests.cli.press import SCENE, write_log


def test_a_batch_writes_bags_for_ros2(tmp_path: Path) -> None:
    scene, log, alone = tmp_path / "scene.toml", tmp_path / "one.mcap", tmp_path / "alone.mcap"
    scene.write_text(SCENE)
    write_log(log, frames=5)
    outputs = geomphys.OutputOptions(timing=False, ros2=True)
    report = geomphys.run_batch([log], scene, tmp_path / "out", options=geomphys.BatchOptions(jobs=1), outputs=outputs)
    (entry,) = report.entries
    assert (entry.status, entry.error) == ("done", None)
    geomphys.run(log, scene, out=alone, options=outputs)
    assert entry.out_sha256 == sha256_of_file(alone) == sha256_of_file(tmp_path / "out/one.mcap")
    assert (entry.input_sha256, entry.scene_sha256) == (sha256_of_file(log), sha256_of_file(scene))
