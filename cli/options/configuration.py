"""Configuration files: `waychair config` prints them, --config reads them.

A file has up to four parts at its top level, `PARTS`. A file without them is flat: it holds the settings of the part
that the command reads first, as `waychair map` writes config.yaml beside a map.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, cast, get_args

from waychair.config import Settings, dump, from_mapping
from waychair.errors import ConfigError
from waychair.yaml_files import load_yaml

if TYPE_CHECKING:
    from waychair.offline.recording_settings import RecordingSettings
    from waychair.runtime.chair import ChairSettings
    from waychair.simulation.simulator import SimulationSettings

S = TypeVar("S", bound=Settings)

PartName = Literal["map", "chair", "simulation", "nodes"]
PARTS: tuple[PartName, ...] = get_args(PartName)

_LIKE_A_PART = 0.7
"""Least similarity of an unknown key to a part's name at which it counts as a misspelt one."""

_ABOUT: Mapping[PartName, str] = {
    "map": "map, localize, demo, up --mapping: from a recording or a drive to a map",
    "chair": "plan, navigate, page, demo, barn, up: the chair that drives",
    "simulation": "navigate, page, demo, up --sim: the simulated sensors and plant",
    "nodes": "up: the ROS nodes' own parameters",
}


@dataclass(frozen=True, slots=True)
class Configuration:
    """The parts of a file; a part that the file lacks has its defaults. `where` names the file, empty for none."""

    where: str = ""
    parts: Mapping[str, Settings] = field(default_factory=dict)

    @property
    def map(self) -> RecordingSettings:
        """The settings of mapping and localising."""
        return cast("RecordingSettings", self._part("map"))

    @property
    def chair(self) -> ChairSettings:
        """The settings of the chair."""
        return cast("ChairSettings", self._part("chair"))

    @property
    def simulation(self) -> SimulationSettings:
        """The settings of the simulated sensors and plant."""
        return cast("SimulationSettings", self._part("simulation"))

    @property
    def nodes(self) -> Settings:
        """The settings of the ROS nodes, a section for each."""
        return self._part("nodes")

    def _part(self, name: PartName) -> Settings:
        return self.parts[name] if name in self.parts else _class_of(name)()


def load_configuration(path: Path | None) -> Configuration:
    """Return the parts of a file for a command that drives or plans, all defaults without a file.

    A flat file holds the part `chair`.

    Raises:
        ConfigError: the file is missing or not YAML, or a key or value is wrong.
    """
    if path is None:
        return Configuration()
    values = _values(path)
    if not _has_parts(values):
        _refuse_other_part(values, "chair", _class_of("chair"), path)
        return Configuration(str(path), {"chair": from_mapping(_class_of("chair"), values, str(path))})
    return Configuration(str(path), _loaded_parts(values, path))


def load_recording_settings(path: Path | None, kind: type[S]) -> S:
    """Return the settings for a recording of one command, of the class `kind`; all defaults without a file.

    A flat file holds settings of that class; else they are in the part `map`.

    Raises:
        ConfigError: as `load_configuration`.
    """
    if path is None:
        return kind()
    values = _values(path)
    if not _has_parts(values):
        _refuse_other_part(values, "map", kind, path)
        return from_mapping(kind, values, str(path))
    return Configuration(str(path), _loaded_parts(values, path)).map.narrowed(kind)


def configuration_text(part: PartName | None = None) -> str:
    """Return a file with the defaults, units and meanings of one part, or of all."""
    texts = []
    for name in PARTS if part is None else (part,):
        lines = dump(_class_of(name)()).splitlines()
        texts.append("\n".join([f"{name}:  # {_ABOUT[name]}", *(f"  {line}" for line in lines)]) + "\n")
    return "".join(texts)


def part_from_text(text: str) -> PartName:
    """Return the part of this name.

    Raises:
        ConfigError: there is none.
    """
    for name in PARTS:
        if text == name:
            return name
    raise ConfigError(f"there is no part '{text}': take {_listed_parts()}")


def _class_of(name: PartName) -> type[Settings]:
    """Return the class of a part; imported late, as few commands read all of them."""
    if name == "map":
        from waychair.offline.recording_settings import RecordingSettings

        return RecordingSettings
    if name == "chair":
        from waychair.runtime.chair import ChairSettings

        return ChairSettings
    if name == "simulation":
        from waychair.simulation.simulator import SimulationSettings

        return SimulationSettings
    from waychair.ros.node_settings.sections import nodes_part

    return nodes_part()


def _values(path: Path) -> Mapping[str, Any]:
    values = load_yaml(path, ConfigError)
    if values is None:
        return {}
    if not isinstance(values, Mapping):
        raise ConfigError(f"{path} must hold `key: value` lines, not a {type(values).__name__}")
    return values


def _has_parts(values: Mapping[Any, Any]) -> bool:
    return any(key in PARTS for key in values)


def _loaded_parts(values: Mapping[Any, Any], path: Path) -> dict[str, Settings]:
    """Return all parts of a file, also those that the command does not read, so that no mistake in one stays hidden."""
    for key in values:
        if key not in PARTS:
            raise ConfigError(f"{path}: '{key}' is none of its parts, {_listed_parts()}: put it into one of them")
    parts: dict[str, Settings] = {}
    for name in PARTS:
        if name not in values:
            continue
        part = {} if values[name] is None else values[name]
        if not isinstance(part, Mapping):
            raise ConfigError(f"{path}: {name} must hold `key: value` lines, not {part!r}")
        parts[name] = from_mapping(_class_of(name), part, f"{path}: {name}")
    return parts


def _refuse_other_part(values: Mapping[Any, Any], name: PartName, kind: type[Settings], path: Path) -> None:
    """Refuse a flat file of another part, and one with a misspelt part.

    Raises:
        ConfigError: either is the case.
    """
    unknown = [str(key) for key in values if str(key) not in _keys(kind)]
    for key in unknown:
        if difflib.get_close_matches(key, PARTS, n=1, cutoff=_LIKE_A_PART):
            raise ConfigError(f"{path}: there is no part '{key}': take {_listed_parts()}")
    if not unknown or len(unknown) < len(values):
        return
    for other in PARTS:
        if other != name and (shared := [key for key in unknown if key in _keys(_class_of(other))]):
            raise ConfigError(
                f"{path}: '{shared[0]}' belongs to the part '{other}', but this command reads the part '{name}' of a file "
                f"without parts: put the lines under '{other}:'"
            )


def _keys(kind: type[Settings]) -> set[str]:
    return {entry.name for entry in fields(kind)}


def _listed_parts() -> str:
    return f"{', '.join(PARTS[:-1])} or {PARTS[-1]}"
