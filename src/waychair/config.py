"""Configuration: frozen dataclasses of `setting`s, read strictly from YAML and written with their units.

    @dataclass(frozen=True, slots=True)
    class GridSettings(config.Settings):
        resolution: float = config.setting(0.05, "m", "side of a cell", low=0.005, high=1.0)

An unknown key, a wrong type or an impossible value raises a `ConfigError` that names the key and what is allowed. Keys of
earlier versions are explained by `removed_settings`.
"""

from __future__ import annotations

import dataclasses
import difflib
import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import msgspec
import yaml

from waychair.errors import ConfigError
from waychair.files import write_text
from waychair.pose_text import ImpossiblePose, NoPoseText, angle_from_text
from waychair.removed_settings import RemovedKey, RemovedSettings, removed_keys_sentence
from waychair.yaml_files import load_yaml

T = TypeVar("T")
S = TypeVar("S", bound="Settings")

RADIANS = "rad"
"""The unit of angles; their values may be written with `deg` in a file."""


def setting(default: T, unit: str, about: str, *, low: float = -math.inf, high: float = math.inf) -> T:
    """Return a dataclass field with its unit, its meaning and its closed range of possible values."""
    metadata = {"unit": unit, "about": about, "low": low, "high": high}
    return dataclasses.field(default=default, metadata=metadata)


def given(default: T) -> T:
    """Return a dataclass field that the program fills: files cannot set it, and no list of settings shows it."""
    return dataclasses.field(default=default, metadata=GIVEN)


GIVEN: Mapping[str, Any] = MappingProxyType({"given": True})
"""The metadata of a field that is `given`."""


def settable_fields(settings: Settings | type[Settings]) -> list[dataclasses.Field[Any]]:
    """Return the fields that files may set: all but those that are `given`."""
    return [entry for entry in dataclasses.fields(settings) if not entry.metadata.get("given")]


@dataclass(frozen=True, slots=True)
class Settings:
    """Base class of all configurations. It rejects impossible values on construction."""

    def __post_init__(self) -> None:
        check_ranges(self)


def check_ranges(values: Any) -> None:
    """Check the numbers of a dataclass whose fields were made by `setting`.

    Raises:
        ConfigError: a number is not finite or out of its range.
    """
    for entry in dataclasses.fields(values):
        value = getattr(values, entry.name)
        if isinstance(value, bool) or not isinstance(value, int | float):
            continue
        low, high = entry.metadata.get("low", -math.inf), entry.metadata.get("high", math.inf)
        if not (math.isfinite(value) and low <= value <= high):
            unit = entry.metadata.get("unit", "")
            degrees = unit == RADIANS and low <= math.radians(value) <= high
            advice = f"; for {value:g} degrees write {value:g}deg or {math.radians(value):.4g}" if degrees else ""
            raise ConfigError(
                f"{entry.name} = {value} is impossible: it must lie in [{low:g}, {high:g}] {unit}{advice}"
            )


def with_angles(kind: Any, values: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return nested values for a dataclass of `setting`s, with the texts of angles (`90deg`) as radians.

    Raises:
        ConfigError: such a text is no angle, or more than a full turn. `where` names the source.
    """
    entries = {entry.name: entry for entry in dataclasses.fields(kind)}
    result = dict(values)
    for key, value in values.items():
        entry = entries.get(key)
        if entry is None:
            continue
        inner = entry.default_factory
        if dataclasses.is_dataclass(inner) and isinstance(value, Mapping):
            result[key] = with_angles(inner, value, f"{where}: {key}")
        elif entry.metadata.get("unit") == RADIANS and isinstance(value, str):
            try:
                result[key] = angle_from_text(value)
            except ImpossiblePose as error:
                raise ConfigError(f"{where}: {key}: {error}") from error
            except NoPoseText as error:
                raise ConfigError(
                    f"{where}: {key} is '{value}'; it must be radians, or degrees such as 90deg"
                ) from error
    return result


def from_mapping(cls: type[S], values: Mapping[str, Any], where: str = "configuration") -> S:
    """Return settings from nested mappings; missing keys keep their defaults. `where` names the source in errors.

    Raises:
        ConfigError: unknown key (with the nearest known one), wrong type, impossible value.
    """
    _refuse_unknown_keys(cls, values, where)
    try:
        return msgspec.convert(with_angles(cls, values, where), cls)
    except (msgspec.ValidationError, ConfigError) as error:
        raise ConfigError(f"{where}: {error}") from error


def load(cls: type[S], path: Path) -> S:
    """Return settings from a YAML file; an empty file gives the defaults.

    Raises:
        ConfigError: the file is missing, is not YAML, or holds something that `from_mapping` refuses.
    """
    values = load_yaml(path, ConfigError)
    if values is None:
        values = {}
    if not isinstance(values, dict):
        raise ConfigError(f"{path} must hold `key: value` lines, not a {type(values).__name__}")
    return from_mapping(cls, values, str(path))


def changed_values(settings: Settings) -> dict[str, Any]:
    """Return the values that differ from their class's defaults, nested as in a file."""
    usual, changed = type(settings)(), {}
    for entry in dataclasses.fields(settings):
        value, default = getattr(settings, entry.name), getattr(usual, entry.name)
        if value == default:
            continue
        changed[entry.name] = changed_values(value) if isinstance(value, Settings) else value
    return changed


def with_values(settings: S, values: Mapping[str, Any]) -> S:
    """Return settings with nested values, such as `changed_values` of another class; those it lacks have no effect."""
    known = {entry.name for entry in dataclasses.fields(settings)}
    new = {}
    for key in known.intersection(values):
        value, old = values[key], getattr(settings, key)
        new[key] = with_values(old, value) if isinstance(old, Settings) else value
    return dataclasses.replace(settings, **new)


def dump(settings: Settings) -> str:
    """Return YAML text of all values, each with its unit and meaning as a comment; `load` reads it back."""
    return "\n".join(_lines(settings, "")) + "\n"


def save(settings: Settings, path: Path) -> None:
    """Write `dump` to a file."""
    write_text(path, dump(settings))


def _lines(settings: Settings, indent: str) -> list[str]:
    lines = []
    for entry in settable_fields(settings):
        value = getattr(settings, entry.name)
        key = entry.name if yaml.safe_load(entry.name) == entry.name else f"'{entry.name}'"  # e.g. `off` is a bool
        if isinstance(value, Settings):
            lines += [f"{indent}{key}:", *_lines(value, indent + "  ")]
            continue
        text = yaml.safe_dump(_plain(value), default_flow_style=True, width=10_000).removesuffix("...\n").strip()
        comment = ", ".join(filter(None, (entry.metadata.get("unit"), entry.metadata.get("about"))))
        lines.append(f"{indent}{key}: {text}" + (f"  # {comment}" if comment else ""))
    return lines


def _plain(value: Any) -> Any:
    if isinstance(value, enum.Enum):
        return value.value
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def _refuse_unknown_keys(cls: type[Settings], values: Mapping[str, Any], where: str) -> None:
    found = _Unknown(cls, where)
    found.search(cls, values, ())
    if found.removed:
        raise ConfigError(f"{where}: {removed_keys_sentence(found.removed)}")
    if found.unknown:
        raise ConfigError(found.unknown)


class _Unknown:
    """The unknown keys of a file: those of former settings, and a sentence about the first other one."""

    def __init__(self, root: type[Settings], where: str) -> None:
        self.removed: list[RemovedKey] = []
        self.unknown = ""
        self._root, self._where = root, where
        self._table: RemovedSettings | None = None  # read at the first unknown key

    def search(self, cls: type[Settings], values: Mapping[str, Any], section: tuple[str, ...]) -> None:
        """Note the unknown keys of a section, and of the sections in it.

        Raises:
            ConfigError: a section holds a plain value.
        """
        known = {entry.name: entry for entry in settable_fields(cls)}
        for key, value in values.items():
            if key not in known:
                self._note(cls, key, value, section)
                continue
            inner = settings_class(known[key])
            if inner is None:
                continue
            if not isinstance(value, Mapping):
                raise ConfigError(f"{self._prefix(section)}: {key} must hold `key: value` lines, not {value!r}")
            self.search(inner, value, (*section, key))

    def _note(self, cls: type[Settings], key: object, value: Any, section: tuple[str, ...]) -> None:
        if self._table is None:
            self._table = RemovedSettings(self._root)
        removed = self._table.find(cls, str(key), value, section)
        self.removed += removed
        if not removed and not self.unknown:
            near = difflib.get_close_matches(str(key), [entry.name for entry in settable_fields(cls)], n=1, cutoff=0.0)
            hint = f"did you mean '{near[0]}'?" if near else "it takes no keys"
            self.unknown = f"{self._prefix(section)}: unknown key '{key}'; {hint}"

    def _prefix(self, section: tuple[str, ...]) -> str:
        return ": ".join((self._where, *section))


def settings_class(entry: dataclasses.Field[Any]) -> type[Settings] | None:
    """Return the class of a field that holds nested settings, None for a plain value."""
    inner = entry.default_factory
    return inner if isinstance(inner, type) and issubclass(inner, Settings) else None
