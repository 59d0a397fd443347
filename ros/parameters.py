"""ROS parameters from a module's `Settings`: names with dots for nested settings, units and bounds as descriptions."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

import yaml

from waychair.config import Settings, from_mapping
from waychair.errors import ConfigError
from waychair.ros.interface_types import interface_type
from waychair.yaml_files import yaml_from_text

S = TypeVar("S", bound=Settings)

_SCALARS = (bool, int, float, str)
_LARGEST = 2**62  # a bound of whole numbers that has none


@dataclasses.dataclass(frozen=True, slots=True)
class Leaf:
    """One setting that is a value: its dotted name, value, and what its field says (`unit`, `about`, `low`, `high`)."""

    name: str
    value: Any
    metadata: Mapping[str, Any]

    @property
    def parameter(self) -> Any:
        """The value as ROS can hold it: scalars and lists of one kind as they are, anything else as YAML text."""
        value = list(self.value) if isinstance(self.value, tuple) else self.value
        if isinstance(value, _SCALARS):
            return value
        if isinstance(value, list) and value and isinstance(value[0], _SCALARS) and len(set(map(type, value))) == 1:
            return value
        return yaml.safe_dump(_plain(value), default_flow_style=True, width=sys.maxsize).removesuffix("...\n").strip()

    @property
    def is_text(self) -> bool:
        """Whether ROS holds it as YAML text."""
        return isinstance(self.parameter, str) and not isinstance(self.value, str)


def leaves(settings: Settings, prefix: str = "") -> dict[str, Leaf]:
    """All values of settings, by dotted name."""
    found: dict[str, Leaf] = {}
    for entry in dataclasses.fields(settings):
        name, value = f"{prefix}{entry.name}", getattr(settings, entry.name)
        if isinstance(value, Settings):
            found.update(leaves(value, f"{name}."))
        else:
            found[name] = Leaf(name, value, entry.metadata)
    return found


def settings_from_parameters(kind: type[S], values: Mapping[str, Any], where: str) -> S:
    """Settings from parameters by dotted name; those that are not given keep their defaults.

    Raises:
        ConfigError: a name that there is not (with the nearest one), a wrong type, or an impossible value.
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


def descriptor(leaf: Leaf, *, dynamic: bool) -> Any:
    """rcl_interfaces/ParameterDescriptor: what the setting is for, its unit and bounds, and whether it may change."""
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
    """rclpy gives arrays as array.array."""
    return value if isinstance(value, str | bytes) or not isinstance(value, Iterable) else list(value)


def _plain(value: Any) -> Any:
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value
