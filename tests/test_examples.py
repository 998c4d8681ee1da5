"""Every Python example of the documents runs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
TEXTS = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "assets" / "docs").glob("*.md"))]
PYTHON = [
    pytest.param(code, id=f"{path.stem}-{number}")
    for path in TEXTS
    for number, code in enumerate(re.findall(r"```python\n(.*?)```", path.read_text(), flags=re.DOTALL))
]


@pytest.mark.parametrize("code", PYTHON)
def test_library_examples_run(code, tmp_path, monkeypatch) -> None:
    (tmp_path / "hand.mcap").symlink_to(ROOT / "recordings" / "finger_snip.mcap")
    (tmp_path / "hand.urdf").symlink_to(ROOT / "assets" / "hand" / "hand.urdf")
    (tmp_path / "meshes").symlink_to(ROOT / "assets" / "hand" / "meshes")
    scene = (ROOT / "assets" / "scenes" / "finger_snip.toml").read_text()
    (tmp_path / "scene.toml").write_text(scene.replace('"../', f'"{ROOT}/assets/'))
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "example", "exec"), {})
