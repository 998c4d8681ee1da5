"""Logs that are whole but not what the scene takes them for, by the command line: units, the other hand, hostile names."""

from __future__ import annotations

import json
import math
from html.parser import HTMLParser
from pathlib import Path

import pytest
from geomphys_cli.main import run

from tests.cli.press import SCENE, write_log
from tests.recording import log_files
from tests.recording.log_files import glove, joints, pose
from tests.scene.models import ball, joint, urdf

FINGERS = ("thumb", "index", "middle")
TOPIC = "/glove/joint_states"


def right_hand(folder: Path, unit: str | None = None, topic: str = TOPIC) -> Path:
    """The scene of a right hand with three joints, limited to a radian each way."""
    parts = [ball("palm")]
    for k, name in enumerate(FINGERS):
        link = f"right_{name}"
        parts += [ball(link, at=f"0.1 {0.1 * k} 0"), joint(f"{link}_joint", "palm", link)]
    urdf(folder / "right.urdf", *parts)
    said = f', unit = "{unit}"' if unit else ""
    path = folder / "scene.toml"
    path.write_text(
        '[[avatar]]\nname = "hand"\nurdf = "right.urdf"\nmode = "rigid"\nmaterial = "human"\n'
        f'root = {{ topic = "/wrist" }}\njoints = {{ topic = "{topic}"{said} }}\n'
    )
    return path


def moving(folder: Path, largest: float, side: str = "right") -> Path:
    items = []
    for k in range(30):
        values = {f"{side}_{name}_joint": largest * math.sin(k / 5 + i) for i, name in enumerate(FINGERS)}
        items += [pose("/wrist", 1 + k / 60, (0, 0, 0.01 * k, 0, 0, 0, 1)), joints(TOPIC, 1 + k / 60, values)]
    return log_files.write_log(folder / "log.mcap", items)


@pytest.mark.parametrize(
    ("largest", "unit", "says"),
    [
        (50.0, "rad", 'say unit = "deg"'),
        (50.0, None, 'say unit = "deg"'),
        (6.0, "rad", ""),  # as degrees anything small fits any limits
        (0.9, "deg", 'say unit = "rad"'),
        (0.9, "rad", ""),
        (1.2, "rad", ""),
        (50.0, "deg", ""),
    ],
)
def test_angles_of_the_other_unit(
    tmp_path: Path, largest: float, unit: str | None, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    log, scene = moving(tmp_path, largest), right_hand(tmp_path, unit)
    for command in ("check", "replay"):
        assert run([command, str(log), "-s", str(scene), "--json"]) == 0
        said = json.loads(capsys.readouterr().out)
        warnings = said["warnings"] if command == "check" else [message["text"] for message in said["messages"]]
        told = [line for line in warnings if "unit = " in line]
        assert len(told) == bool(says), warnings
        assert all(says in line and TOPIC in line for line in told)
        assert run([command, str(log), "-s", str(scene)]) == 0
        text = capsys.readouterr().out
        assert says in text
        assert ("unit = " in text) == bool(says)
    assert run(["check", str(log), "-s", str(scene), "--strict"]) == (1 if says or largest in (1.2, 6.0) else 0)
    capsys.readouterr()


def test_the_log_of_the_other_hand(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, scene = moving(tmp_path, 0.9, side="left"), right_hand(tmp_path)
    for command in ("check", "replay"):
        assert run([command, str(log), "-s", str(scene)]) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert f"{log}: topic '{TOPIC}' has none of the joints" in line
        assert "of the left side" in line
        assert "of the right one: choose the topic or the URDF of the same side" in line


def test_the_glove_of_the_other_hand(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    items = [pose("/wrist", 1 + k / 60, (0, 0, 0, 0, 0, 0, 1)) for k in range(5)]
    items += [glove("/manus", 1 + k / 60, {"right_index_joint": 3.0 * k}, side="Left") for k in range(5)]
    log = log_files.write_log(tmp_path / "log.mcap", items)
    scene = right_hand(tmp_path, topic="/manus#right")
    for command in ("check", "replay"):
        assert run([command, str(log), "-s", str(scene)]) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert "'/manus' has no glove of the side 'right'; it has left" in line


EVIL = '<img src=x onerror="alert(1)"><script>alert(2)<!-- &amp;\'"`[bold red]%s{0}'
"""Markup of pages and of the terminal, as a name."""
STEERING = "\x1b[2J\x1b]8;;http://x\x07a\n\r\u202e\x9b31m"


class Elements(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.said = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.said += data


def quoted(text: str) -> str:
    return json.dumps(text)


def test_names_that_are_markup_do_nothing_in_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, scene = tmp_path / "log.mcap", tmp_path / "scene.toml"
    write_log(log, topic="/" + EVIL)
    text = SCENE.replace('"finger"', quoted(EVIL)).replace('"/tracker/finger"', quoted("/" + EVIL))
    outputs = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    for out, depth in zip(outputs, ("-0.05", "-0.04"), strict=True):
        scene.write_text(text.replace("0.0, 0.0, -0.05", f"0.0, 0.0, {depth}"))
        assert run(["replay", str(log), "-s", str(scene), "-o", str(out)]) == 0
    capsys.readouterr()
    page = tmp_path / "page.html"
    assert run(["diff", *map(str, outputs), "--html", str(page)]) == 1
    assert EVIL in capsys.readouterr().out.replace("\n", "")
    content = Elements(page.read_text())
    assert content.said.count(EVIL) > 2
    allowed = {"html", "head", "meta", "title", "style", "link", "body", "h1", "h2", "p", "span", "div", "table", "thead",
               "tbody", "tr", "th", "td", "svg", "text", "tspan", "path", "line", "polyline", "polygon", "figure", "img",
               "figcaption", "details", "summary", "g", "rect", "circle", "code", "ul", "li"}  # fmt: skip
    assert {tag for tag, _ in content.tags} <= allowed
    for tag, attributes in content.tags:
        assert not any(name.startswith("on") for name in attributes), (tag, attributes)
        for name in ("src", "href"):
            assert (attributes.get(name) or "data:").startswith("data:")


@pytest.mark.parametrize("where", ["topic", "joint", "tree"])
def test_names_that_steer_do_nothing_in_the_terminal(
    tmp_path: Path, where: str, capsys: pytest.CaptureFixture[str]
) -> None:
    wild = EVIL + STEERING
    names = [f"right_{name}_joint" for name in FINGERS] + ([wild] if where == "joint" else [])
    items = []
    for k in range(30):
        at = 1 + k / 60
        items += [pose("/wrist", at, (0, 0, 0.01 * k, 0, 0, 0, 1)), joints(TOPIC, at, dict.fromkeys(names, 9.0))]
        items += [joints(f"/{wild}", at, {"a": 0.1})] if where == "topic" else []
    log, scene = log_files.write_log(tmp_path / "log.mcap", items), right_hand(tmp_path)
    text = scene.read_text()
    scene.write_text(text.replace('"hand"', quoted(EVIL)) if where == "tree" else text)
    out = tmp_path / "out.mcap"
    for words, code in (
        (["info", log], 0), (["info", log, "-v"], 0), (["info", log, "--json"], 0), (["check", log, "-s", scene, "-v"], 0),
        (["replay", log, "-s", scene, "-o", out, "-v"], 0), (["stats", out], 0), (["diff", out, out], 0),
        (["audit", out], 0), (["check", log, "-s", tmp_path / "none.toml"], 2),
        (["init", log, "--urdf", tmp_path / "right.urdf", "-o", tmp_path / "new.toml", "--force"], 0),
    ):  # fmt: skip
        told = run([str(word) for word in words])
        said = capsys.readouterr()
        assert told == code, (words, said.err)
        assert all(c.isprintable() or c == "\n" for c in said.out + said.err), words
