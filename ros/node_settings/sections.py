"""The nodes that `waychair up` starts, and the part `nodes` of a configuration file: a section for each of them.

A node's section holds the node's own settings. Those that it shares with the chair, with mapping or with the simulation
are in the parts of these.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, get_type_hints

from waychair.config import Settings
from waychair.ros.node_settings.bridge import BridgeNodeSettings
from waychair.ros.node_settings.cells import CellsNodeSettings
from waychair.ros.node_settings.glove import GloveNodeSettings
from waychair.ros.node_settings.mapper import MapperNodeSettings
from waychair.ros.node_settings.navigator import NavigatorNodeSettings
from waychair.ros.node_settings.page import PageNodeSettings
from waychair.ros.node_settings.simulator import SimulatorNodeSettings
from waychair.runtime.pilot import PilotSettings

NODES: Mapping[str, type[Settings]] = MappingProxyType(
    {
        "bridge": BridgeNodeSettings,
        "cells": CellsNodeSettings,
        "glove": GloveNodeSettings,
        "mapper": MapperNodeSettings,
        "navigator": NavigatorNodeSettings,
        "page": PageNodeSettings,
        "simulator": SimulatorNodeSettings,
    }
)
"""The settings of each node by the node's name."""

_IN_OTHER_PARTS: Mapping[str, frozenset[str]] = MappingProxyType(
    {
        "bridge": frozenset(entry.name for entry in dataclasses.fields(PilotSettings)),
        "cells": frozenset(("perceive",)),
        "glove": frozenset(),
        "mapper": frozenset(("localiser", "live")),
        "navigator": frozenset(entry.name for entry in dataclasses.fields(PilotSettings)),
        "page": frozenset(),
        "simulator": frozenset(("plant_model", "sensors")),
    }
)


@functools.cache
def nodes_part() -> type[Settings]:
    """Return the class of the part `nodes`: a field for each node, with the node's own settings."""
    sections = [(name, _own(name, kind)) for name, kind in NODES.items()]
    fields = [(name, own, dataclasses.field(default_factory=own)) for name, own in sections]
    return _settings_class("NodesSettings", fields)


def _own(name: str, kind: type[Settings]) -> type[Settings]:
    """Return a class with the settings of a node that are in no other part."""
    types = get_type_hints(kind)
    fields = []
    for entry in dataclasses.fields(kind):
        if entry.name in _IN_OTHER_PARTS[name]:
            continue
        if entry.default_factory is not dataclasses.MISSING:
            field: Any = dataclasses.field(default_factory=entry.default_factory)
        else:
            field = dataclasses.field(default=entry.default, metadata=entry.metadata)
        fields.append((entry.name, types[entry.name], field))
    return _settings_class(kind.__name__, fields)


def _settings_class(name: str, fields: list[tuple[str, type, Any]]) -> type[Settings]:
    made: type[Settings] = dataclasses.make_dataclass(name, fields, bases=(Settings,), frozen=True, slots=True)
    return made
