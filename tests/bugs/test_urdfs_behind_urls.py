"""A URDF behind a URL could name local files by file://, and a package:// mesh in it ended in a traceback."""

from __future__ import annotations

import pytest

from geomphys.errors import MeshError
from geomphys.scene.ros_packages import MeshResolver
from geomphys.storage.remote_files import as_path

FOLDER = "memory://urdfs_behind_urls/robots/hand"


def test_a_local_file_is_refused() -> None:
    with pytest.raises(MeshError, match=r"file:///etc/passwd\.stl: is a local file"):
        MeshResolver(as_path(FOLDER)).find("file:///etc/passwd.stl")


def test_a_package_is_found_in_the_folder_alone(monkeypatch: pytest.MonkeyPatch, tmp_path: object) -> None:
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))
    folder = as_path(f"{FOLDER}/hand.urdf").parent
    with pytest.raises(MeshError, match=r"package 'meshes' was not found in memory://"):
        MeshResolver(folder).find("package://meshes/palm.stl")
    (folder / "meshes/palm.stl").write_bytes(b"solid")
    assert str(MeshResolver(folder).find("package://meshes/palm.stl")) == f"{FOLDER}/meshes/palm.stl"
