"""Configuration files: `waychair config` prints them, and every command that maps, localises, plans or drives reads them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.cli.command import refused, waychair
from waychair.cli.options.configuration import (
    PARTS,
    configuration_text,
    load_configuration,
    load_recording_settings,
    part_from_text,
)
from waychair.cli.planning import _planning_settings
from waychair.control.speed.limiter import LimiterSettings
from waychair.errors import ConfigError
from waychair.offline.localising import LocalisingSettings
from waychair.offline.mapping import MappingSettings
from waychair.offline.recording_settings import RecordingSettings
from waychair.offline.rgbd_mapping import RgbdMappingSettings
from waychair.ros.node_settings.sections import NODES, nodes_part
from waychair.ros.parameters import leaves, settings_from_parameters
from waychair.ros.stack import Stack, node_parameters, processes
from waychair.runtime.chair import ChairSettings
from waychair.simulation.simulator import SimulationSettings, SimulatorSettings, with_all_sensors
from waychair.trials.barn import JACKAL, BarnTask, navigator_settings
from waychair.trials.live.live_chair import LiveChair

COMMANDS = {
    "map": ("map", "drive.clf", "--out", "out"),
    "localize": ("localize", "drive.clf", "--map", "map", "--out", "out"),
    "plan": ("plan", "--map", "map", "--start", "0,0", "--goal", "1,1"),
    "navigate": ("navigate", "--world", "small_clinic", "--goal", "1,1"),
    "page": ("page",),
    "demo": ("demo", "--headless", "--quiet"),
    "up": ("up", "--sim", "small_clinic"),
    "barn": ("barn", "worlds"),
}

SLOW = "chair: {limiter: {max_speed: 0.35}}\n"


def written(folder: Path, text: str) -> Path:
    path = folder / "settings.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("chair: {limiter: {max_sped: 0.5}}", "chair: limiter: unknown key 'max_sped'; did you mean 'max_speed'?"),
        ("map: {checkpoint_interval: [1]}", "map: Expected `float`, got `array`"),
        ("simulation: {plant_model: rails}", "simulation: plant_model = 'rails' is unknown: take kinematic or mujoco"),
        ("nodes: {mapper: {keep: maps}}", "nodes: 'mapper.keep' is now called 'mapper.save_folder': rename it"),
        ("nodes: 5", "nodes must hold `key: value` lines, not 5"),
        (
            "{chair: {}, limiter: {}}",
            "'limiter' is none of its parts, map, chair, simulation or nodes: put it into one",
        ),
        ("chiar: {limiter: {}}", "there is no part 'chiar': take map, chair, simulation or nodes"),
        ("chair: [", ", line "),
    ],
)
def test_every_command_names_a_bad_file_and_refuses_it_before_it_begins(
    command: str, text: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = written(tmp_path, text)
    sentence = refused(waychair(*COMMANDS[command], "--config", path))
    assert f"{path}" in sentence
    assert said in sentence
    assert sorted(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_names_a_missing_file(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert "cannot read none.yaml" in refused(waychair(*COMMANDS[command], "--config", "none.yaml"))


def test_the_printed_file_holds_all_parts_and_loads_back_to_the_defaults(tmp_path: Path) -> None:
    path = written(tmp_path, waychair("config").stdout)
    assert tuple(yaml.safe_load(path.read_text())) == PARTS
    found = load_configuration(path)
    assert found.map == RecordingSettings()
    assert found.chair == ChairSettings()
    assert found.simulation == SimulationSettings()
    assert found.nodes == nodes_part()()
    for kind in (MappingSettings, LocalisingSettings, RgbdMappingSettings):
        assert load_recording_settings(path, kind) == kind()


@pytest.mark.parametrize("part", PARTS)
def test_one_part_is_printed_alone_and_loads_back(part: str, tmp_path: Path) -> None:
    text = waychair("config", part).stdout
    assert tuple(yaml.safe_load(text)) == (part,)
    assert text in configuration_text()
    assert load_configuration(written(tmp_path, text)).parts.keys() == {part}


def test_an_unknown_part_is_refused_with_the_four_known_names() -> None:
    assert "there is no part 'chairs': take map, chair, simulation or nodes" in refused(waychair("config", "chairs"))
    with pytest.raises(ConfigError, match="there is no part ''"):
        part_from_text("")


def test_a_file_of_0_1_0_gets_one_sentence_about_its_removed_keys(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = written(tmp_path, "laser_height: 0.3\nodometry:\n  wheel_scale: 0.002\n  still_s: 0.3  # s, at rest\n")
    sentence = refused(waychair(*COMMANDS["map"], "--config", path))
    assert f"{path}: 'odometry.still_s' is no longer a setting: it is always 0.3 s" in sentence
    sentence = refused(waychair(*COMMANDS["plan"], "--config", path))
    assert f"{path}: 'laser_height' belongs to the part 'map'" in sentence
    assert "put the lines under 'map:'" in sentence


def test_a_flat_file_belongs_to_the_part_that_the_command_reads_first(tmp_path: Path) -> None:
    path = written(tmp_path, "limiter: {max_speed: 0.35}\n")
    assert load_configuration(path).chair.limiter == LimiterSettings(max_speed=0.35)
    path = written(tmp_path, "mapper: {key_distance: 0.3}\n")
    assert load_recording_settings(path, MappingSettings).mapper.key_distance == 0.3
    path = written(tmp_path, "rgbd: {odometry: {max_speed: 1.0}}\n")
    assert load_recording_settings(path, RgbdMappingSettings).rgbd.odometry.max_speed == 1.0
    assert load_configuration(written(tmp_path, "")).chair == ChairSettings()


def test_the_part_map_holds_the_settings_of_localisation_and_pictures(tmp_path: Path) -> None:
    path = written(tmp_path, "map: {localiser: {lost_scans: 9}, rgbd: {odometry: {max_speed: 1.0}}, vision: 'off'}\n")
    assert load_recording_settings(path, LocalisingSettings).localiser.lost_scans == 9
    assert load_recording_settings(path, RgbdMappingSettings).rgbd.odometry.max_speed == 1.0
    assert load_recording_settings(path, MappingSettings) == MappingSettings(vision="off")


class Reached(Exception):
    """A command has called the function that works with its settings."""


def arguments_of(function: str, monkeypatch: pytest.MonkeyPatch, *command: str | Path) -> dict[str, Any]:
    """Run a command up to a function, and return the function's arguments by name."""
    found: dict[str, Any] = {}

    def called(*positional: Any, **named: Any) -> None:
        found.update(named, positional=positional)
        raise Reached

    monkeypatch.setattr(function, called)
    with pytest.raises(Reached):
        waychair(*command)
    return found


def test_a_speed_limit_and_a_sensor_of_the_file_reach_a_drive_and_options_override_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = """
chair: {limiter: {max_speed: 0.35}, navigator: {planner: {planner: astar}}}
simulation: {sensors: {lidar: {beams: 360}}}
"""
    path = written(tmp_path, text)
    options = ("--config", path, "--planner", "dijkstra")
    found = arguments_of("waychair.trials.navigate.navigate", monkeypatch, *COMMANDS["navigate"], *options)
    assert found["settings"].limiter.max_speed == 0.35
    assert found["settings"].navigator.planner.planner == "dijkstra"
    assert found["simulation"].sensors.lidar.beams == 360
    plain = arguments_of("waychair.trials.navigate.navigate", monkeypatch, *COMMANDS["navigate"])
    assert plain["settings"] == ChairSettings()


def test_the_file_reaches_the_demo_and_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, SLOW + "map: {vision: 'off'}\n")
    found = arguments_of("waychair.trials.demo.demo.run_demo", monkeypatch, *COMMANDS["demo"], "--config", path)
    assert found["mapping_settings"] == MappingSettings(vision="off")
    assert found["chair_settings"].limiter.max_speed == 0.35
    monkeypatch.setattr(
        "waychair.runtime.processes.signalled", lambda *signals: lambda: False
    )  # this process keeps its own
    found = arguments_of("waychair.trials.live.live_chair.LiveChair", monkeypatch, "page", "--config", path)
    assert found["settings"].limiter.max_speed == 0.35


def test_the_page_counts_down_unless_the_file_gives_a_countdown() -> None:
    assert LiveChair("small_clinic")._blueprint.settings.supervisor.countdown_s == 3.0
    settings = ChairSettings(supervisor=replace(ChairSettings().supervisor, countdown_s=5.0))
    assert LiveChair("small_clinic", settings=settings)._blueprint.settings == settings


def test_the_planner_takes_the_file_and_options_override_it(tmp_path: Path) -> None:
    path = written(tmp_path, "chair: {navigator: {planner: {planner: astar}, clearance: {comfortable: 0.7}}}\n")
    settings, comfortable = _planning_settings(path, None)
    assert (settings.planner, comfortable) == ("astar", 0.7)
    assert _planning_settings(path, "dijkstra")[0].planner == "dijkstra"


def test_the_benchmark_keeps_its_own_settings_except_those_that_the_file_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("waychair.trials.barn.worlds_in", lambda folder, count: [])

    def task(*options: str | Path) -> BarnTask:
        found = arguments_of("waychair.trials.barn.run_worlds", monkeypatch, *COMMANDS["barn"], *options)
        given: BarnTask = found["positional"][1]
        return given

    assert task() == BarnTask()
    path = written(tmp_path, "chair: {navigator: {dwa: {max_reverse: 0.1}, recovery: {patience: 30}}}\n")
    changed = task("--config", path)
    own = navigator_settings(JACKAL, 0.5, 1.0)
    slower = replace(own.dwa, max_reverse=0.1)
    assert changed.navigator() == replace(own, dwa=slower, recovery=replace(own.recovery, patience=30.0))
    assert task("--config", path, "--speed", "0.7").navigator().dwa.max_speed == 0.7
    assert BarnTask().navigator() == navigator_settings(JACKAL, 0.5, 1.0)
    monkeypatch.undo()
    sentence = refused(waychair(*COMMANDS["barn"], "--config", written(tmp_path, SLOW)))
    assert "the benchmark has no part of the chair but navigator.clearance" in sentence


def test_sensors_without_a_rate_in_the_file_keep_that_of_the_command() -> None:
    every = with_all_sensors(SimulatorSettings())
    assert SimulationSettings().over(every) == every
    assert SimulationSettings().over(SimulatorSettings()) == SimulatorSettings()


def parameters(folder: Path, name: str) -> dict[str, Any]:
    """Return a node's parameters as `waychair up` wrote them."""
    found: dict[str, Any] = yaml.safe_load((folder / f"{name}.yaml").read_text())
    values: dict[str, Any] = found[f"/**/{name}"]["ros__parameters"]
    return values


def stack_of(folder: Path, text: str, change: Callable[[Stack], Stack] = lambda stack: stack) -> None:
    """Write the parameter files of a simulated chair with a configuration file."""
    found = load_configuration(written(folder, text))
    settings = node_parameters(found.chair, found.map, found.simulation, found.nodes)
    processes(change(Stack(folder, world="small_clinic", settings=settings)))


def test_the_file_reaches_the_parameter_files_of_nodes_with_the_setting(tmp_path: Path) -> None:
    text = """
chair: {limiter: {max_speed: 0.35}, navigator: {obstacle_range: 3}, localiser: {lost_scans: 9}, bridge: {family: 2}}
map: {mapper: {key_distance: 0.3}, vision: 'off', depth: {mount: [0, 0, 1, 0, 0]}}
simulation: {plant_model: mujoco, sensors: {lidar: {beams: 360}}}
nodes: {bridge: {black_box: {parts: 3}}, mapper: {scan_frame: front}}
"""
    stack_of(tmp_path, text)
    told = {name: parameters(tmp_path, name) for name in ("bridge", "mapper", "navigator", "simulator")}
    limit = "limiter.max_speed"
    assert [told[name].get(limit) for name in told] == [0.35, None, 0.35, None]
    assert told["bridge"]["black_box.parts"] == 3
    assert told["bridge"]["bridge.family"] == 2
    assert told["navigator"]["navigator.obstacle_range"] == 3.0
    assert told["mapper"]["localiser.lost_scans"] == 9
    assert told["mapper"]["live.mapper.key_distance"] == 0.3
    assert told["mapper"]["scan_frame"] == "front"
    assert (told["simulator"]["plant_model"], told["simulator"]["sensors.lidar.beams"]) == ("mujoco", 360)
    for name, values in told.items():
        settings = settings_from_parameters(NODES[name], values, name)  # as the node reads them
        assert leaves(settings).keys() >= values.keys()


def test_a_file_of_defaults_adds_no_parameter(tmp_path: Path) -> None:
    processes(Stack(tmp_path, world="small_clinic", page_port=8123))
    started = NODES.keys() - {"cells", "glove"}
    before = {name: parameters(tmp_path, name) for name in started}
    stack_of(tmp_path, configuration_text(), lambda stack: replace(stack, page_port=8123))
    assert {name: parameters(tmp_path, name) for name in started} == before


def test_a_chair_that_is_to_perceive_gets_the_cells_node(tmp_path: Path) -> None:
    stack_of(tmp_path, "chair: {perceive: true}\n")
    assert parameters(tmp_path, "cells")["perceive"] is True
    assert "perceive" not in parameters(tmp_path, "navigator")


def test_a_countdown_of_the_file_replaces_that_of_the_page(tmp_path: Path) -> None:
    stack_of(tmp_path, "chair: {supervisor: {countdown_s: 5}}\n", lambda stack: replace(stack, page_port=8123))
    assert parameters(tmp_path, "bridge")["supervisor.countdown_s"] == 5.0


def test_a_parameter_that_an_option_sets_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="'seed' of the node 'simulator' is set by the options of `waychair up`"):
        stack_of(tmp_path, "nodes: {simulator: {seed: 3}}\n")


def test_up_passes_the_file_on_to_its_nodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options = ("--config", written(tmp_path, SLOW), "--out", tmp_path / "run")
    found = arguments_of("waychair.ros.stack.processes", monkeypatch, *COMMANDS["up"], *options)
    stack: Stack = found["positional"][0]
    assert stack.settings["bridge"] == stack.settings["navigator"] == {"limiter.max_speed": 0.35}
    assert stack.settings["mapper"] == {}
