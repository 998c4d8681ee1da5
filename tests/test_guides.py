"""Every command of every guide runs: in its order, in a folder where a short recording stands for the reader's own."""

from __future__ import annotations

import itertools
import re
import shlex
import shutil
from pathlib import Path

import pytest
from geomphys_cli.main import run
from mcap.writer import Writer

import geomphys
from geomphys.output.input_copy import MessageCopy
from geomphys.recording.reader import open_log
from tests.test_documented_output import SHOWN, is_run, stories

ROOT = Path(__file__).resolve().parent.parent
GUIDES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "assets" / "docs").glob("*.md"))]
ELSEWHERE = {
    "geomphys view": "tests/cli/test_view_snapshot.py",
    "geomphys bench": "tests/bench",
    "s3://": "tests/storage/test_remote_files.py",
    "https://": "tests/storage/test_remote_files.py",
    "--scheduler": "tests/batch",
}
"""Part of a command that needs a screen, a server or minutes -> where it is tested."""

OUTPUT_OPTIONS = ("-o", "-O", "--rrd", "--html", "--junit", "--lerobot", "--foxglove")
ENDS = {"diff": {0, 1}, "audit": {0, 4}, "check": {0, 1}}
"""Command -> exit codes of a run that told something; 0 of all others."""


def commands(path: Path) -> list[str]:
    """Commands of the shell blocks, continued lines joined."""
    blocks = re.findall(r"```(?:sh|bash|console|shell)\n(.*?)```", path.read_text(), flags=re.DOTALL)
    lines = [line.strip() for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    return [line for line in lines if line.startswith("geomphys ") and not any(part in line for part in ELSEWHERE)]


def on_recordings(line: str) -> bool:
    """Whether a command is about a recording of the checkout, or what was made of one."""
    return "recordings/" in line and not line.startswith("geomphys batch")


def cut(log: Path, out: Path, seconds: float) -> None:
    """Write the messages of the first seconds of a log."""
    with open_log(log, recover=False) as reader, out.open("wb") as target:
        writer, messages = Writer(target), MessageCopy(reader.channels)
        writer.start()
        for message in reader.read():
            if message.log_time > reader.start_ns + seconds * 1e9:
                break
            messages.add(message, writer)
        writer.finish()


@pytest.fixture(scope="module")
def stand_ins(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log, its URDF, scene and outputs, under the names that the guides give them."""
    folder = tmp_path_factory.mktemp("reader")
    cut(ROOT / "recordings" / "finger_snip.mcap", folder / "hand.mcap", seconds=1.0)
    (folder / "cut_off.mcap").write_bytes((folder / "hand.mcap").read_bytes()[:-5000])
    shutil.copytree(ROOT / "assets" / "hand" / "meshes", folder / "meshes")
    shutil.copy(ROOT / "assets" / "hand" / "hand.urdf", folder)
    scene = (ROOT / "assets" / "scenes" / "finger_snip.toml").read_text()
    (folder / "scene.toml").write_text(scene.replace('"../', f'"{ROOT}/assets/'))
    for name, end in (("old", 1.0), ("new", 1.1), ("other", 1.1), ("corrected", None)):
        geomphys.run(
            folder / "hand.mcap", folder / "scene.toml", out=folder / f"{name}.mcap", config=geomphys.Config(end=end)
        )
    for name, source in (("recordings_of_a_day", "hand.mcap"), ("corrected", "new.mcap")):
        (folder / name).mkdir()
        shutil.copy(folder / source, folder / name / "one.mcap")
    return folder


def run_in(folder: Path, line: str, stand_ins: Path) -> None:
    """Run a command of a guide: what it reads is there, what it writes is not."""
    line = line.replace("batch recordings/", "batch recordings_of_a_day/").replace("--jobs 8", "--jobs 1")
    words = shlex.split(line, comments=True)[1:]
    words = [match for word in words for match in (sorted(map(str, Path().glob(word))) if "*" in word else [word])]
    for before, word in itertools.pairwise(words):
        if before in OUTPUT_OPTIONS and "--resume" not in words:
            target = folder / word
            if target.is_dir():
                shutil.rmtree(target)
            target.unlink(missing_ok=True)
        elif (stand_ins / word).exists() and not (folder / word).exists():
            copy = shutil.copytree if (stand_ins / word).is_dir() else shutil.copy
            copy(stand_ins / word, folder / word)
    code = run([*words, "-q"])
    assert code in ENDS.get(words[0], {0}), f"{line}: exit code {code}"


def cases() -> list[object]:
    """Commands of a guide that no guide before it has; those on recordings of the checkout and batches take longer."""
    found: list[object] = []
    seen: set[str] = set()
    for path in GUIDES:
        lines = [line for line in commands(path) if line not in seen]
        seen.update(lines)
        if str(path.relative_to(ROOT)) in SHOWN:  # there their text is compared too
            lines = [line for line in lines if not on_recordings(line) and "out/" not in line]
        elif any(map(on_recordings, lines)):
            found.append(pytest.param(lines, id=path.stem, marks=pytest.mark.slow))
            continue
        batches = [line for line in commands(path) if line.startswith("geomphys batch")]
        if batches:  # each needs the one before it
            found.append(pytest.param(batches, id=f"{path.stem}-batches", marks=pytest.mark.slow))
        if others := [line for line in lines if line not in batches]:
            found.append(pytest.param(others, id=path.stem))
    return found


@pytest.mark.parametrize("lines", cases())
def test_every_command_runs(
    lines: list[str],
    stand_ins: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in ("assets", "recordings"):
        (tmp_path / name).symlink_to(ROOT / name)
    for name in ("meshes", "corrected"):
        shutil.copytree(stand_ins / name, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    for line in lines:
        run_in(tmp_path, line, stand_ins)
        assert "error" not in capsys.readouterr().err or line.startswith(("geomphys audit", "geomphys check")), line


def test_no_guide_is_left_out() -> None:
    assert {path.name for path in GUIDES if commands(path)} >= {
        "README.md", "batch.md", "chains.md", "comparing.md", "damaged.md", "grasping.md", "keypoints.md", "performance.md",
        "tables.md", "your_recording.md", "CONTRIBUTING.md",
    }  # fmt: skip
    assert all((ROOT / where).exists() for where in ELSEWHERE.values())


def test_no_command_is_left_out() -> None:
    run_here = {line for case in cases() for line in case.values[0]}  # type: ignore[attr-defined]
    shown = [line for name in SHOWN for lines, _ in stories((ROOT / name).read_text()) for line in lines]
    run_there = {line.strip() for line in shown if is_run(line)}
    assert {line for path in GUIDES for line in commands(path)} <= run_here | run_there
