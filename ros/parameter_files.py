"""ROS parameter files of users, read before any node starts: every node that they name exists, every value is possible.

ROS itself ignores a mistyped node's name in silence, and each node would refuse a bad value by itself (ros2/rcl #954).
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from waychair.config import Settings
from waychair.errors import ConfigError
from waychair.ros.parameters import ROS_PARAMETERS, leaves
from waychair.yaml_files import load_yaml

VALUES = "ros__parameters"
"""The key above a node's parameters."""

_RECORDER = "recorder"
"""A node that is no part of a run; the file of all nodes may hold its parameters, too."""

_ANY = ("*", "**")
"""Words that stand for one, and for any number of names in a node's full name."""


@dataclass(frozen=True, slots=True)
class NodeParameters:
    """Parameters by dotted name for the nodes whose full name fits `pattern`, such as /**/navigator."""

    pattern: str
    values: Mapping[str, object]

    @property
    def last(self) -> str:
        """The last word of the pattern: a node's name, or * or **."""
        return self.pattern.rpartition("/")[2]

    def fits(self, full_name: str) -> bool:
        """Return whether a node's full name, such as /left_chair/navigator, fits the pattern."""
        parts = {"*": r"/\w+", "**": r"(/\w+)*"}
        words = self.pattern.strip("/").split("/")
        return re.fullmatch("".join(parts.get(word, "/" + re.escape(word)) for word in words), full_name) is not None


def read_parameter_file(path: Path) -> tuple[NodeParameters, ...]:
    """Return the parameters in a ROS parameter file, in its order; later ones outweigh earlier ones.

    Raises:
        ConfigError: the file is missing or no YAML, or it has another structure.
    """
    root = load_yaml(path, ConfigError)
    if root is None:
        return ()
    if not isinstance(root, Mapping):
        raise ConfigError(f"{path} must hold a node's name, then `{VALUES}:`, then `name: value` lines")
    return tuple(_nodes(path, root, ""))


def parameters_of_nodes(
    path: Path, nodes: Mapping[str, type[Settings]], started: Sequence[str], namespace: str
) -> dict[str, dict[str, object]]:
    """Return the parameters that a file gives each started node.

    `nodes` are the settings of all nodes that there are, `started` the names of those of this run, in `namespace`.

    Raises:
        ConfigError: as `read_parameter_file`; or the file names a node that there is none of, or names it in another
            namespace; or no node has a parameter that is given to all.
    """
    prefix = "/" + namespace.strip("/") if namespace.strip("/") else ""
    found: dict[str, dict[str, object]] = {name: {} for name in started}
    for given in read_parameter_file(path):
        here = [name for name in nodes if given.fits(f"{prefix}/{name}")]
        if given.last == _RECORDER:
            continue
        if not here:
            raise ConfigError(f"{path}: {_unknown_node(given, nodes, started, prefix)}")
        known = {name: set(leaves(nodes[name]())) for name in here}
        for key, value in given.values.items():
            takers = here if given.last not in _ANY else _takers(path, given, key, known)
            for name in takers:
                if name in found:
                    found[name][key] = value
    return found


def _nodes(path: Path, values: Mapping[Any, Any], above: str) -> Iterator[NodeParameters]:
    """Yield the nodes of a mapping whose keys are names of nodes or namespaces."""
    for key, value in values.items():
        pattern = f"{above}/{str(key).strip('/')}"
        if not isinstance(value, Mapping):
            raise ConfigError(f"{path}: '{key}' needs `{VALUES}:` below it, then `name: value` lines")
        inner = {name: below for name, below in value.items() if name != VALUES}
        if VALUES in value:
            below = value[VALUES]
            if not isinstance(below, Mapping | None):
                raise ConfigError(f"{path}: {pattern} must hold `name: value` lines below `{VALUES}:`")
            yield NodeParameters(pattern, dict(_flat(below or {}, "")))
        elif not inner:
            raise ConfigError(f"{path}: '{key}' needs `{VALUES}:` below it, then `name: value` lines")
        yield from _nodes(path, inner, pattern)


def _flat(values: Mapping[Any, Any], above: str) -> Iterator[tuple[str, object]]:
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def _takers(path: Path, given: NodeParameters, key: str, known: Mapping[str, set[str]]) -> list[str]:
    """Return the nodes that have a parameter which is given to all.

    Raises:
        ConfigError: there is none.
    """
    if key.startswith(ROS_PARAMETERS):
        return list(known)
    takers = [name for name, keys in known.items() if key in keys]
    if not takers:
        near = difflib.get_close_matches(key, sorted(set().union(*known.values())), n=1, cutoff=0.0)[0]
        raise ConfigError(f"{path}: {given.pattern}: no node has the parameter '{key}'; did you mean '{near}'?")
    return takers


def _unknown_node(
    given: NodeParameters, nodes: Mapping[str, type[Settings]], started: Sequence[str], prefix: str
) -> str:
    """Return the sentence about a node that there is none of in this run."""
    there = ", ".join(f"{prefix}/{name}" for name in started)
    near = difflib.get_close_matches(given.last, nodes, n=1, cutoff=0.0)[0]
    return f"no node is called '{given.pattern}'; did you mean '/**/{near}'? This run's nodes are {there}"
