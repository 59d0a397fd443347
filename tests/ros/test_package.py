"""The ROS package and the layouts: all named things exist, with the names and QoS of `ros.topics`."""

from __future__ import annotations

import importlib
import importlib.util
import json
import re
import runpy
import sys
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml

from waychair import __version__
from waychair.ros import topics
from waychair.ros.environment import PROFILE
from waychair.ros.topics import RosTopic

CONFIG = PROFILE.parent
PACKAGE = CONFIG.parent / "package"
NAME = "waychair_ros"
TABLE = [value for value in vars(topics).values() if isinstance(value, RosTopic)] + [topics.sonar(k) for k in range(8)]
HAS_LAUNCH = importlib.util.find_spec("launch_ros") is not None
SERVICES = {"/stop", "/confirm", "/cancel"}


@pytest.fixture
def setup(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Return the arguments of setuptools.setup in setup.py."""
    asked: dict[str, Any] = {}
    monkeypatch.setenv("SETUPTOOLS_USE_DISTUTILS", "stdlib")  # another test of this process may have loaded distutils
    monkeypatch.setattr("setuptools.setup", lambda **given: asked.update(given))
    monkeypatch.chdir(PACKAGE)
    runpy.run_path("setup.py")
    return asked


def test_the_package_declares_itself_to_ament(setup: dict[str, Any]) -> None:
    package = ElementTree.parse(PACKAGE / "package.xml").getroot()
    assert package.attrib["format"] == "3"
    assert package.findtext("name") == setup["name"] == NAME
    assert package.findtext("version") == setup["version"] == __version__
    assert package.findtext("export/build_type") == "ament_python"
    installed = dict(setup["data_files"])
    assert installed["share/ament_index/resource_index/packages"] == [f"resource/{NAME}"]
    assert installed[f"share/{NAME}"] == ["package.xml"]
    for files in installed.values():
        assert all((PACKAGE / file).is_file() for file in files)
    assert f"$base/lib/{NAME}" in (PACKAGE / "setup.cfg").read_text()


def test_every_entry_point_is_an_existing_node(setup: dict[str, Any]) -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed (no rclpy)")
    entries = dict(re.fullmatch(r"(\w+) = ([\w.]+):main", entry).groups() for entry in setup["entry_points"]["console_scripts"])  # type: ignore[union-attr] # fmt: skip
    assert set(entries) == {"simulator", "bridge", "cells", "glove", "mapper", "navigator", "recorder"}
    for node, module in entries.items():
        assert module == f"waychair.ros.nodes.{node}_node"
        assert callable(importlib.import_module(module).main)


class Said:
    """A stand-in for any class of ROS's launch: it keeps its arguments."""

    def __init__(self, *given: Any, **named: Any) -> None:
        self.given, self.named = given, named


@pytest.fixture
def launch_file(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Load the launch file, with stand-ins where ROS's launch is not installed."""
    if not HAS_LAUNCH:
        for name, kinds in {
            "launch": ("LaunchDescription",),
            "launch.actions": ("DeclareLaunchArgument", "OpaqueFunction"),
            "launch_ros": (),
            "launch_ros.actions": ("Node",),
        }.items():
            module = types.ModuleType(name)
            for kind in kinds:
                setattr(module, kind, type(kind, (Said,), {}))
            monkeypatch.setitem(sys.modules, name, module)
    return runpy.run_path(str(PACKAGE / "launch" / "chair.launch.py"))


def test_the_launch_file_starts_the_processes_of_waychair_up(launch_file: dict[str, Any], tmp_path: Path) -> None:
    if HAS_LAUNCH:
        pytest.skip("ROS's own launch hides what a node was given")
    assert launch_file["generate_launch_description"]() is not None
    given = {name: value for name, (value, _) in launch_file["ARGUMENTS"].items()}
    given |= {"sim": "small_clinic", "camera": "False", "out": str(tmp_path), "namespace": "ward"}
    nodes = launch_file["nodes"](types.SimpleNamespace(launch_configurations=given))
    assert [node.named["executable"] for node in nodes] == ["simulator", "bridge", "mapper", "navigator"]
    for node in nodes:
        assert node.named["package"] == NAME
        assert node.named["arguments"][:3] == ["--ros-args", "-r", "__ns:=/ward"]
        assert Path(node.named["arguments"][-1]).is_file()
    values = yaml.safe_load((tmp_path / "simulator.yaml").read_text())["/**/simulator"]["ros__parameters"]
    assert (values["world"], values["camera"], values["people"]) == ("small_clinic", False, True)


def displays(node: Any) -> Iterator[dict[str, Any]]:
    """All displays and tools of an RViz configuration that take or send a topic."""
    if isinstance(node, dict):
        if "Value" in node and "Reliability Policy" in node:
            yield node
        for value in node.values():
            yield from displays(value)
    elif isinstance(node, list):
        for value in node:
            yield from displays(value)


def test_rviz_requests_each_topic_with_the_offered_qos() -> None:
    known = {topic.name: topic for topic in TABLE}
    shown = list(displays(yaml.safe_load((CONFIG / "waychair.rviz").read_text())))
    named = {display["Value"] for display in shown}
    maps = {"map", "global_costmap/costmap", "local_costmap/costmap"}
    assert named - set(known) == {f"{name}_updates" for name in maps}  # RViz's own; no node sends them
    assert named >= {"scan", "plan", "local_plan", "robot_description", "amcl_pose", "initialpose", "goal_pose", *maps}
    for display in shown:
        if display["Value"] in known:
            qos = known[display["Value"]].qos
            assert display["Reliability Policy"] == ("Reliable" if qos.reliable else "Best Effort")
            assert display["Durability Policy"] == ("Transient Local" if qos.latched else "Volatile")


def strings(node: Any) -> Iterator[str]:
    if isinstance(node, str):
        yield node
    elif isinstance(node, dict):
        for key, value in node.items():
            yield from strings(key)
            yield from strings(value)
    elif isinstance(node, list):
        for value in node:
            yield from strings(value)


def test_foxglove_shows_existing_topics_and_every_panel_once() -> None:
    layout = json.loads((CONFIG / "foxglove.json").read_text())
    names = {f"/{topic.name.lstrip('/')}" for topic in TABLE}
    for text in strings(layout["configById"]):
        if text.startswith("/"):
            topic = text.split(".")[0]
            assert topic in names | SERVICES | {"/clicked_point"}, text
    panels = [text for text in strings(layout["layout"]) if "!" in text]
    assert sorted(panels) == sorted(layout["configById"])
    publish = layout["configById"]["3D!map"]["publish"]
    assert (publish["poseTopic"], publish["poseEstimateTopic"]) == ("/goal_pose", "/initialpose")
