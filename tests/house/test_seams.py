"""What is added often is added in few places."""

from __future__ import annotations

import ast
import json
import sys
from pathlib import Path

import pytest

from geomphys.recording.channels import MessageKind, kind_of, make_message_reader
from geomphys.recording.reader import LogChannel
from tests.house.sources import imports, modules, tree

SINK_METHODS = {"open", "write", "close"}


def sinks() -> dict[str, str]:
    """Class of every sink of the package that writes files or keeps results -> its module."""
    return {
        node.name: name
        for name, path in modules("geomphys").items()
        if name.startswith("output.") and name != "output.sink"
        for node in tree(path).body
        if isinstance(node, ast.ClassDef)
        and {item.name for item in node.body if isinstance(item, ast.FunctionDef)} >= SINK_METHODS
    }


def bases(path: Path) -> set[str]:
    """Names of the classes that those of a module are made from."""
    classes = [node for node in tree(path).body if isinstance(node, ast.ClassDef)]
    return {base.id for node in classes for base in node.bases if isinstance(base, ast.Name)}


def test_the_package_has_the_sinks_it_should() -> None:
    assert sinks().keys() >= {"McapSink", "RerunSink", "MemorySink"}


@pytest.mark.parametrize("name", sorted(sinks()))
def test_a_sink_is_known_to_one_module_besides_its_own(name: str) -> None:
    home = sinks()[name]
    users = {
        f"{package}.{module}"
        for package in ("geomphys", "cli")
        for module, path in modules(package).items()
        if f"geomphys.{home}.{name}" in imports(path, only_types=True) and name not in bases(path)
    }
    assert len(users) <= 1, users


def test_a_kind_of_message_is_one_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    table = sys.modules[MessageKind.__module__]
    numbers = ("at.x", "at.y", "at.z", "q.x", "q.y", "q.z", "q.w")
    toy = MessageKind(
        ("toy_msgs/msg/Where",), ("json",), "pose", table.PoseLayout(pose=numbers, scale=0.001), has_stamp=False
    )
    channel = LogChannel(0, "/where", "toy_msgs/Where", "jsonschema", b"{}", "json", 1, 0, 0)
    assert kind_of(channel) is None
    monkeypatch.setitem(table._KIND_BY_TYPE, (toy.names[0], "json"), toy)
    found = kind_of(channel)
    assert found is toy
    message = {"at": {"x": 10, "y": 20, "z": 30}, "q": {"x": 0, "y": 0, "z": 0, "w": 1}}
    (pose,) = make_message_reader(channel, found)(json.dumps(message).encode())
    assert pose.value == pytest.approx((0.01, 0.02, 0.03, 0.0, 0.0, 0.0, 1.0))
