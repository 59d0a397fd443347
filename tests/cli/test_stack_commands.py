"""The processes of `waychair up`, its refusals, and commands without a running chair."""

from __future__ import annotations

import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml

from waychair.cli.options.arguments import BadArgument
from waychair.cli.options.stack_options import StackChairOptions, StackFileOptions, StackPageOptions
from waychair.cli.running.stack_commands import goto_command
from waychair.cli.running.starting import up_command
from waychair.errors import ConfigError, MapNotFound, WorldError, ZoneError
from waychair.maps.folders.map_files import load_map, save_map
from waychair.ros.stack import BOARD_LINK, Stack, processes
from waychair.runtime.last_pose import remembered_pose
from waychair.simulation.plan.world import load_world
from waychair.types import OccupancyGrid, Pose2

WORLD = "small_clinic"


def parameters(folder: Path, name: str) -> dict[str, object]:
    found = yaml.safe_load((folder / f"{name}.yaml").read_text())
    values = found[f"/**/{name}"]["ros__parameters"]
    assert isinstance(values, dict)
    return values


def test_a_simulated_chair_has_four_processes_and_the_plan_of_its_world(tmp_path: Path) -> None:
    table = processes(Stack(tmp_path, world=WORLD))
    assert [row.name for row in table] == ["simulator", "bridge", "mapper", "navigator"]
    assert all(row.priority == 0 for row in table)
    assert load_map(tmp_path / "map").cells.shape == load_world(WORLD).grid.cells.shape
    assert parameters(tmp_path, "bridge")["cable"] == f"pty:{tmp_path / BOARD_LINK}"
    assert parameters(tmp_path, "simulator")["board_link"] == str(tmp_path / BOARD_LINK)
    for name in ("bridge", "mapper", "navigator"):
        assert parameters(tmp_path, name)["map_folder"] == str(tmp_path / "map")


def test_a_real_chair_has_no_simulator(tmp_path: Path) -> None:
    table = processes(Stack(tmp_path, map_folder=tmp_path, calibration=tmp_path / "chair.yaml", cable="/dev/ttyUSB0"))
    assert [row.name for row in table] == ["bridge", "mapper", "navigator"]
    assert parameters(tmp_path, "bridge")["cable"] == "/dev/ttyUSB0"
    assert parameters(tmp_path, "mapper")["calibration"] == str(tmp_path / "chair.yaml")


def test_a_chair_of_a_fleet_has_the_navigator_that_keeps_the_order(tmp_path: Path) -> None:
    modules = {row.name: row.module for row in processes(Stack(tmp_path, world=WORLD, fleet=True))}
    assert modules["navigator"] == "waychair.ros.nodes.fleet_navigator_node"
    assert modules["mapper"] == "waychair.ros.nodes.mapper_node"


@pytest.mark.parametrize(
    ("given", "told"), [("maps", "maps"), ("maps/map.yaml", "maps"), ("maps/lab.yaml", "maps/lab.yaml")]
)
def test_every_node_gets_the_given_map(tmp_path: Path, given: str, told: str) -> None:
    (tmp_path / "maps").mkdir()
    processes(Stack(tmp_path, map_folder=tmp_path / given, cable="/dev/ttyUSB0", page_port=8000))
    for name in ("bridge", "mapper", "navigator", "page"):
        assert parameters(tmp_path, name)["map_folder"] == str(tmp_path / told)


def test_the_start_is_stored_with_the_last_pose_of_the_mapper_and_used_once(tmp_path: Path) -> None:
    processes(Stack(tmp_path, world=WORLD))
    assert remembered_pose(tmp_path / "pose.json", tmp_path / "map") == load_world(WORLD).start
    assert "start" not in parameters(tmp_path, "mapper")
    processes(Stack(tmp_path, world=WORLD, start=Pose2(2.0, 1.0, 0.5)))
    assert remembered_pose(tmp_path / "pose.json", tmp_path / "map") == Pose2(2.0, 1.0, 0.5)


def test_a_chair_on_a_known_map_starts_at_its_last_pose(tmp_path: Path) -> None:
    processes(Stack(tmp_path, map_folder=tmp_path, cable="/dev/ttyUSB0", start=Pose2(2.0, 1.0, 0.5)))
    processes(Stack(tmp_path, map_folder=tmp_path, cable="/dev/ttyUSB0"))
    assert remembered_pose(tmp_path / "pose.json", tmp_path) == Pose2(2.0, 1.0, 0.5)


def test_urgent_processes_have_priorities_in_the_order_of_safety(tmp_path: Path) -> None:
    ranks = {row.name: row.priority for row in processes(Stack(tmp_path, world=WORLD, urgent=True))}
    assert ranks["bridge"] > ranks["mapper"] > ranks["navigator"] > 0


def test_parameters_of_the_user_come_last_and_override_the_others(tmp_path: Path) -> None:
    own = tmp_path / "own.yaml"
    own.write_text("/**/navigator: {ros__parameters: {limiter: {max_speed: 0.5}, camera: false, use_sim_time: true}}\n")
    configured = {"navigator": {"limiter.max_speed": 0.9}}
    for row in processes(Stack(tmp_path, world=WORLD, parameters=own, settings=configured)):
        assert row.arguments[-2:] == ("--params-file", str(tmp_path / f"{row.name}.yaml"))
    given = parameters(tmp_path, "navigator")
    assert (given["limiter.max_speed"], given["camera"], given["use_sim_time"]) == (0.5, False, True)
    assert "limiter.max_speed" not in parameters(tmp_path, "bridge")


def test_nodes_of_a_namespace_keep_their_transforms_inside_of_it(tmp_path: Path) -> None:
    for row in processes(Stack(tmp_path, world=WORLD, namespace="/ward_3/left")):
        assert row.arguments[:3] == ("--ros-args", "-r", "__ns:=/ward_3/left")
        assert {"/tf:=tf", "/tf_static:=tf_static"} <= set(row.arguments)


@pytest.mark.parametrize(
    ("stack", "error", "sentence"),
    [
        (Stack(Path()), ConfigError, "there is no chair: name a world with --sim"),
        (Stack(Path(), cable="/dev/ttyUSB0"), ConfigError, "there is no map: name one with --map"),
        (Stack(Path(), world="atlantis"), WorldError, "atlantis"),
        (Stack(Path("out"), world=WORLD, namespace="3rd"), ConfigError, "the namespace '3rd' is impossible"),
    ],
)
def test_an_impossible_run_is_refused(stack: Stack, error: type[Exception], sentence: str) -> None:
    with pytest.raises(error, match=sentence):
        processes(stack)


def test_unattended_drives_are_refused_for_a_real_chair() -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed (no rclpy)")
    with pytest.raises(BadArgument, match="--unattended needs --sim"):
        up_command(chair=StackChairOptions(chair=Path("chair.yaml"), cable="/dev/ttyUSB0", unattended=True))


def test_goto_without_a_goal_is_refused() -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed (no rclpy)")
    with pytest.raises(BadArgument, match="name a place to go to"):
        goto_command()


def test_the_status_of_a_chair_that_does_not_run_is_one_sentence() -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed (no rclpy)")
    script = "from waychair.cli.main import main; main()"
    told = subprocess.run(
        [sys.executable, "-c", script, "status", "--domain", "101"],
        capture_output=True,
        text=True,
        check=False,
        timeout=120.0,
    )
    assert told.returncode == 1
    assert told.stderr.startswith("waychair: no chair runs in ROS domain 101: start one with `waychair up`")
    assert told.stderr.count("\n") == 1


def test_an_invalid_map_or_a_zone_of_another_place_is_refused_before_any_node_starts(tmp_path: Path) -> None:
    simulated, files = StackChairOptions(sim=WORLD), StackFileOptions(out=tmp_path)
    up = partial(up_command, chair=simulated, files=files, page=StackPageOptions(page=False))
    with pytest.raises(MapNotFound, match="there is no map at"):
        up(map=tmp_path / "nowhere")
    folder = tmp_path / "map"
    save_map(folder, OccupancyGrid(np.zeros((40, 40), np.int8), 0.05))
    (folder / "zones.yaml").write_text("stairs: {keep_out: true, polygon: [[9, 9], [11, 9], [11, 12]]}\n")
    with pytest.raises(ZoneError, match="the zone 'stairs'"):
        up(map=folder)
