"""ROS parameters from `Settings`: dotted names for nested settings, with descriptors for meaning, unit and bounds."""

from __future__ import annotations

import dataclasses
import enum
import math
import sys
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

import yaml

from waychair.config import Settings, from_mapping, settable_fields
from waychair.errors import ConfigError
from waychair.ros.interface_types import interface_type
from waychair.yaml_files import yaml_from_text

S = TypeVar("S", bound=Settings)

ROS_PARAMETERS = ("use_sim_time", "start_type_description_service", "qos_overrides.")
"""Prefixes of the parameters that every ROS node has."""

_SCALARS = (bool, int, float, str)
_LARGEST = 2**62  # stands for an infinite bound of whole numbers


@dataclasses.dataclass(frozen=True, slots=True)
class LeafSetting:
    """One setting with a plain value: its dotted name, value, and metadata (`unit`, `about`, `low`, `high`)."""

    name: str
    value: Any
    metadata: Mapping[str, Any]

    @property
    def parameter(self) -> Any:
        """Return the value as a ROS parameter: scalars and uniform lists as they are, anything else as YAML text."""
        value = list(self.value) if isinstance(self.value, tuple) else self.value
        if isinstance(value, _SCALARS):
            return value
        if isinstance(value, list) and value and isinstance(value[0], _SCALARS) and len(set(map(type, value))) == 1:
            return value
        return yaml.safe_dump(_plain(value), default_flow_style=True, width=sys.maxsize).removesuffix("...\n").strip()

    @property
    def is_text(self) -> bool:
        """Return whether the ROS parameter is YAML text."""
        return isinstance(self.parameter, str) and not isinstance(self.value, str)


def leaves(settings: Settings, prefix: str = "") -> dict[str, LeafSetting]:
    """Return all plain values of nested settings, by dotted name."""
    found: dict[str, LeafSetting] = {}
    for entry in settable_fields(settings):
        name, value = f"{prefix}{entry.name}", getattr(settings, entry.name)
        if isinstance(value, Settings):
            found.update(leaves(value, f"{name}."))
        else:
            found[name] = LeafSetting(name, value, entry.metadata)
    return found


def changed_parameters(settings: Settings, prefix: str = "") -> dict[str, object]:
    """Return the values that differ from the defaults of their class, as ROS parameters by dotted name."""
    usual, found = leaves(type(settings)(), prefix), leaves(settings, prefix)
    changed = {name: leaf.parameter for name, leaf in found.items() if leaf.value != usual[name].value}
    return {name: value.value if isinstance(value, enum.Enum) else value for name, value in changed.items()}


def settings_from_parameters(kind: type[S], values: Mapping[str, Any], where: str) -> S:
    """Return settings from parameters by dotted name; missing ones keep their defaults. `where` names the node.

    Raises:
        ConfigError: an unknown name (with the nearest one), a wrong type, or an impossible value.
    """
    texts = {name for name, leaf in leaves(kind()).items() if leaf.is_text}
    nested: dict[str, Any] = {}
    for name, value in values.items():
        *above, last = name.split(".")
        place = nested
        for part in above:
            place = place.setdefault(part, {})
            if not isinstance(place, dict):
                raise ConfigError(f"{where}: {name} is impossible: '{part}' is a value, not a group")
        place[last] = _from_text(name, value, where) if name in texts else _listed(value)
    return from_mapping(kind, nested, where)


def descriptor(leaf: LeafSetting, *, dynamic: bool) -> Any:
    """Return a rcl_interfaces/ParameterDescriptor with a setting's meaning, unit and bounds, and whether it may change."""
    about, unit = leaf.metadata.get("about", ""), leaf.metadata.get("unit", "")
    described = interface_type("rcl_interfaces/msg/ParameterDescriptor")(
        description=f"{about} [{unit}]" if unit else about, read_only=not dynamic, dynamic_typing=leaf.is_text
    )
    low, high = leaf.metadata.get("low", -math.inf), leaf.metadata.get("high", math.inf)
    if (math.isinf(low) and math.isinf(high)) or isinstance(leaf.value, bool):
        return described
    if isinstance(leaf.value, float):
        largest = sys.float_info.max
        bounds = interface_type("rcl_interfaces/msg/FloatingPointRange")
        described.floating_point_range = [
            bounds(from_value=float(max(low, -largest)), to_value=float(min(high, largest)))
        ]
    elif isinstance(leaf.value, int):
        bounds = interface_type("rcl_interfaces/msg/IntegerRange")
        described.integer_range = [
            bounds(from_value=round(max(low, -_LARGEST)), to_value=round(min(high, _LARGEST)), step=1)
        ]
    return described


def _from_text(name: str, value: Any, where: str) -> Any:
    if not isinstance(value, str):
        return _listed(value)
    return yaml_from_text(value, f"{where}: {name}", ConfigError)


def _listed(value: Any) -> Any:
    """Return the value with rclpy's array.array as a list."""
    return value if isinstance(value, str | bytes) or not isinstance(value, Iterable) else list(value)


def _plain(value: Any) -> Any:
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value
