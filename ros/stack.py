"""The table of a chair's processes and their parameters, for a real or a simulated chair."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from waychair.config import Settings
from waychair.errors import ConfigError
from waychair.files import write_text
from waychair.maps.drawn.erased import clear_erased, load_erased
from waychair.maps.drawn.places import save_places
from waychair.maps.folders.map_drawing import forget
from waychair.maps.folders.map_files import MAP_YAML, load_map, save_map, yaml_path
from waychair.ros.environment import namespace_arguments
from waychair.ros.node_settings.sections import NODES
from waychair.ros.parameter_files import parameters_of_nodes
from waychair.ros.parameters import ROS_PARAMETERS, changed_parameters, leaves, settings_from_parameters
from waychair.runtime.chair import ChairSettings
from waychair.runtime.last_pose import remember_pose
from waychair.runtime.processes import Process
from waychair.simulation.plan.world import World, load_world
from waychair.simulation.simulator import SimulationSettings
from waychair.slam.mapping.live_mapping import LiveMappingSettings
from waychair.types import Pose2

BOARD_LINK = "board"
"""The name of the simulated board's cable in the folder of a run."""

MADE_MAP = "made_map"
"""The folder of a newly made map in the folder of a run."""

_POSE_FILE, _TRUTH_FILE = "pose.json", "simulated_pose.json"

_PAGE, _PAGE_MODULE = "page", "waychair.cli.options.page_process"
"""The module that combines the page's node and the web server, which do not import each other."""

_NAVIGATOR, _FLEET_MODULE = "navigator", "waychair.ros.nodes.fleet_navigator_node"
"""The navigator's node, and its module for a chair that shares its building with others."""

_CELLS = "cells"
"""The node of the behaviour cells, which `perceive` starts. The chair drives without it as well."""

_GLOVE = "glove"
"""The node of the rider's glove, which its `port` starts. The chair drives without it as well."""

COUNTDOWN_S = 3.0
"""Seconds from the rider's confirmation to the first motion, if there is a page to announce it."""

_COUNTDOWN = "supervisor.countdown_s"

_PRIORITIES = {"simulator": 5, "bridge": 4, "mapper": 3, "navigator": 2}
"""Real-time priorities with `urgent`: stopping comes before driving, and the simulated world is on time for all."""


@dataclass(frozen=True, slots=True)
class Stack:
    """The configuration of a run. `folder` holds the run's files; `world` is the world of a simulated chair.

    Without a map a simulated chair gets its world's floor plan as the map, unless `mapping`. `parameters` is a YAML file
    of the user that overrides these settings. `ignore_commands`: all commands are ignored. `urgent`: real-time priority.
    `box`: folder of the black box; None: no log. `page_port`, `page_host`: address of the page; port None: no page.
    `page_names`: its further host names. With a page, each drive begins with a countdown that the page announces.
    `namespace`: that of all nodes. `settings`: the parameters of each node from a configuration file (`node_parameters`).
    `fleet`: the chair shares its building with others, by the fleet file that the environment names.
    """

    folder: Path
    world: str = ""
    map_folder: Path | None = None
    mapping: bool = False
    calibration: Path | None = None
    cable: str = ""
    camera: bool = True
    people: bool = True
    seed: int = 0
    unattended: bool = False
    ignore_commands: bool = False
    start: Pose2 | None = None
    parameters: Path | None = None
    urgent: bool = False
    box: Path | None = None
    page_port: int | None = None
    page_host: str = "127.0.0.1"
    page_names: tuple[str, ...] = ()
    namespace: str = ""
    settings: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    fleet: bool = False


def node_parameters(
    chair: ChairSettings, live: LiveMappingSettings, simulation: SimulationSettings, nodes: Settings
) -> dict[str, dict[str, object]]:
    """Return each node's parameters that differ from their defaults, from the parts of a configuration file.

    The bridge, the cells, the navigator and the mapper take the chair's settings that they have, the mapper those of
    mapping as well (`live`), the simulator those of the simulation. `nodes` holds each node's own (`node_settings.sections`).
    """
    shared = {**changed_parameters(chair), **changed_parameters(live, "live."), **changed_parameters(simulation)}
    found: dict[str, dict[str, object]] = {}
    for name, kind in NODES.items():
        own = changed_parameters(getattr(nodes, name))
        found[name] = {**{key: value for key, value in shared.items() if key in leaves(kind())}, **own}
    return found


def processes(stack: Stack) -> tuple[Process, ...]:
    """Return the process table, after writing the parameter files into the stack's folder.

    Raises:
        ConfigError: a world or a cable is missing, a map or `mapping` is missing, or the namespace is invalid.
        WorldError: the world does not exist.
        ConfigError: `settings` hold a parameter that `waychair up` sets by its options, or the user's parameter file
            names an unknown node, or holds an unknown or impossible parameter.
        OutputError: the folder cannot be written to.
    """
    if not stack.world and not stack.cable:
        raise ConfigError("there is no chair: name a world with --sim, or a real chair's --chair and --cable")
    if not stack.world and stack.map_folder is None and not stack.mapping:
        raise ConfigError("there is no map: name one with --map, or make one with --mapping")
    folder = stack.folder.resolve()
    cable = stack.cable or f"pty:{folder / BOARD_LINK}"
    known = _known_map(stack, folder)
    rows: dict[str, dict[str, object]] = {}
    chair: dict[str, object] = {"calibration": str(stack.calibration.resolve()) if stack.calibration else ""}
    place = {**chair, "map_folder": "" if known is None else str(known[0])}
    if stack.world:
        (folder / _TRUTH_FILE).unlink(missing_ok=True)  # left by an earlier run
        rows["simulator"] = {
            "world": stack.world,
            "seed": stack.seed,
            "people": stack.people,
            "camera": stack.camera,
            "publish_base": False,
            "board_link": str(folder / BOARD_LINK),
            "pose_file": str(folder / _TRUTH_FILE),
        }
    start = stack.start or (None if known is None else known[1])
    if known is not None and start is not None:
        # As the mapper's saved pose, not as its `start`: when it restarts during a run, the chair stands elsewhere.
        remember_pose(folder / _POSE_FILE, known[0], start)
    rows["bridge"] = {
        **place,
        "cable": cable,
        "confirm_goals": stack.unattended,
        "ignore_commands": stack.ignore_commands,
        "black_box_folder": "" if stack.box is None else str(stack.box.resolve()),
    }
    if _COUNTDOWN not in stack.settings.get("bridge", {}):
        rows["bridge"][_COUNTDOWN] = 0.0 if stack.page_port is None else COUNTDOWN_S
    rows["mapper"] = {
        **place,
        "map_folder": "" if stack.mapping else place["map_folder"],
        "pose_file": str(folder / _POSE_FILE),
        "save_folder": str(folder / MADE_MAP),
    }
    rows[_NAVIGATOR] = {**place, "camera": stack.camera}
    if stack.settings.get(_CELLS, {}).get("perceive"):
        rows[_CELLS] = {**chair, "camera": stack.camera}
    if stack.settings.get(_GLOVE, {}).get("port"):
        rows[_GLOVE] = dict(chair)
    if stack.page_port is not None:
        rows[_PAGE] = {**place, "host": stack.page_host, "port": stack.page_port}
        if stack.page_names:
            rows[_PAGE]["names"] = ",".join(stack.page_names)
    _add_settings(rows, stack)
    return tuple(_process(name, values, folder, stack) for name, values in rows.items())


def _add_settings(rows: Mapping[str, dict[str, object]], stack: Stack) -> None:
    """Add the settings of the configuration file to each node's parameters, then those of the user's parameter file.

    Raises:
        ConfigError: see `processes`.
    """
    path, names = stack.parameters, tuple(rows)
    own = {} if path is None else parameters_of_nodes(path, NODES, names, stack.namespace)
    for name, values in rows.items():
        given = stack.settings.get(name, {})
        if both := sorted(given.keys() & values.keys()):
            raise ConfigError(
                f"'{both[0]}' of the node '{name}' is set by the options of `waychair up`: remove it from --config, and give "
                "the option instead"
            )
        values.update(given)
        values.update(own.get(name, {}))
        if own.get(name):
            checked = {key: value for key, value in values.items() if not key.startswith(ROS_PARAMETERS)}
            settings_from_parameters(NODES[name], checked, f"{path}: {name}")


def _known_map(stack: Stack, folder: Path) -> tuple[Path, Pose2 | None] | None:
    """Return the map's folder (or its YAML file if that is not named map.yaml), and the start pose if known.

    None while a map is being made.
    """
    if stack.map_folder is not None:
        path = yaml_path(stack.map_folder)
        folder = path.parent.resolve()
        return folder if path.name == MAP_YAML else folder / path.name, None
    if stack.mapping:
        return None
    world = load_world(stack.world)
    _save_plan(world, folder / "map")
    return folder / "map", world.start


def _save_plan(world: World, folder: Path) -> None:
    """Save the world's floor plan as a map; places and zones drawn on it in an earlier run are kept."""
    if (folder / MAP_YAML).is_file():
        known, grid = load_map(folder, lambda _: None), clear_erased(world.grid, load_erased(folder))
        if known.cells.shape == grid.cells.shape and (known.cells == grid.cells).all():
            return
    forget(folder)  # places and zones were drawn on another world's plan
    save_map(folder, world.grid)
    save_places(folder, {place.name: place for place in world.places})


def _process(name: str, values: Mapping[str, object], folder: Path, stack: Stack) -> Process:
    path = folder / f"{name}.yaml"
    write_text(path, yaml.safe_dump({f"/**/{name}": {"ros__parameters": dict(values)}}, sort_keys=False))
    named = namespace_arguments(stack.namespace)
    priority = _PRIORITIES.get(name, 0) if stack.urgent else 0
    module = _PAGE_MODULE if name == _PAGE else f"waychair.ros.nodes.{name}_node"
    if stack.fleet and name == _NAVIGATOR:
        module = _FLEET_MODULE
    return Process(
        name,
        module,
        ("--ros-args", *named, "--params-file", str(path)),
        priority,
        vital=name not in (_PAGE, _CELLS, _GLOVE),
    )
