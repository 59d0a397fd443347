"""Settings of earlier versions that were removed or renamed, for clear errors about the keys of old files.

`removed_settings.tsv` beside this file holds one row for each: `ClassName.field`, its fate, its fixed value with the unit,
and the reason. The fate is `constant`, `renamed:new_field` or `moved:ClassName.field`. `ClassName.*` stands for all fields
of a class. Lines that begin with # are comments.
"""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

TABLE = Path(__file__).with_name("removed_settings.tsv")

_ALL = "*"  # stands for all fields of a class
_NAMED_AT_MOST = 5
"""Keys that a sentence names; it counts the others."""


class RemovedSetting(NamedTuple):
    """One row of the table."""

    owner: str
    field: str
    fate: str
    value: str
    reason: str


class RemovedKey(NamedTuple):
    """A key of a removed or renamed setting: its dotted name in the file, and its row; `new_name` is dotted, '' for none."""

    name: str
    setting: RemovedSetting
    new_name: str

    def sentence(self) -> str:
        """Return the fate of the key and the remedy, as a clause."""
        if self.new_name:
            return f"'{self.name}' is now called '{self.new_name}': rename it"
        reason = f" ({self.setting.reason})" if self.setting.reason else ""
        always = f": it is always {self.setting.value}" if self.setting.value else ""
        return f"'{self.name}' is no longer a setting{always}{reason}; remove the line"

    def short(self) -> str:
        """Return the key and its fate, in a few words."""
        if self.new_name:
            return f"'{self.name}' (now '{self.new_name}')"
        return f"'{self.name}' (always {self.setting.value})" if self.setting.value else f"'{self.name}' (removed)"


def removed_keys_sentence(keys: Sequence[RemovedKey]) -> str:
    """Return one sentence about the removed and renamed keys of a file, of which there is at least one."""
    if len(keys) == 1:
        return keys[0].sentence()
    named = ", ".join(key.short() for key in keys[:_NAMED_AT_MOST])
    others = len(keys) - _NAMED_AT_MOST
    more = f" and {others} more" if others > 0 else ""
    return f"{len(keys)} keys are no longer settings or have new names: {named}{more}; remove or rename their lines"


def read_table(path: Path) -> dict[tuple[str, str], RemovedSetting]:
    """Return the rows of a table by class and field.

    Raises:
        ValueError: a row has a wrong form; the shipped table is tested.
    """
    rows: dict[tuple[str, str], RemovedSetting] = {}
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        name, fate, value, reason = (*(part.strip() for part in line.split("\t")), "", "")[:4]
        owner, _, field = name.partition(".")
        kind, _, target = fate.partition(":")
        value = "" if value == "-" else value
        known = {"constant": not target, "renamed": bool(target), "moved": bool(target)}.get(kind, False)
        if not known or not (field == _ALL or field.isidentifier()) or (owner, field) in rows:
            raise ValueError(f"{path.name}, line {number}: '{line}' has a wrong form, or is there twice")
        rows[owner, field] = RemovedSetting(owner, field, fate, value, reason)
    return rows


class RemovedSettings:
    """The table, for files that hold settings of one class."""

    def __init__(self, root: type) -> None:
        """Read the table; `root` is the class of the whole file."""
        self._rows = read_table(TABLE)
        self._sections = {owner.__name__: section for owner, section in reversed(list(_classes(root, ())))}

    def find(self, owner: type, key: str, value: Any, section: tuple[str, ...]) -> list[RemovedKey]:
        """Return the removed settings behind an unknown key of the class `owner`; none for any other unknown key.

        A key with a mapping as its value may be a section whose class was removed: it gives the keys in it.
        """
        for base in owner.__mro__:
            if (row := self._row(base.__name__, key)) is not None:
                return [self._key(row, key, section)]
        if isinstance(value, Mapping):
            return self._keys_of_section(key, value, (*section, key))
        # The class itself may have another name by now; then only the field tells.
        rows = [row for row in self._rows.values() if row.field == key and row.owner not in self._sections]
        return [self._key(rows[0], key, section)] if len(rows) == 1 else []

    def _keys_of_section(self, name: str, values: Mapping[str, Any], section: tuple[str, ...]) -> list[RemovedKey]:
        """Return the keys of a section whose class was removed: the class that had all of its keys."""
        plain = {str(key) for key, value in values.items() if not isinstance(value, Mapping)}
        owners = {row.owner for row in self._rows.values()} - set(self._sections)
        fitting = [owner for owner in sorted(owners) if self._had_keys(owner, name, plain)]
        keys: list[RemovedKey] = []
        if plain and fitting:
            owner = max(fitting, key=lambda each: difflib.SequenceMatcher(None, each.lower(), name).ratio())
            rows = [(key, self._row(owner, key)) for key in map(str, values) if key in plain]
            keys = [self._key(row, key, section) for key, row in rows if row is not None]
        for key, value in values.items():
            if isinstance(value, Mapping):
                keys += self._keys_of_section(str(key), value, (*section, str(key)))
        return keys

    def _had_keys(self, owner: str, section: str, keys: set[str]) -> bool:
        """Return whether a removed class had these keys; a class without listed fields is known by its name alone."""
        if (owner, _ALL) in self._rows:
            return owner.removesuffix("Settings").lower() == section.replace("_", "")
        return all((owner, key) in self._rows for key in keys)

    def _row(self, owner: str, field: str) -> RemovedSetting | None:
        return self._rows.get((owner, field)) or self._rows.get((owner, _ALL))

    def _key(self, row: RemovedSetting, key: str, section: tuple[str, ...]) -> RemovedKey:
        _, _, target = row.fate.partition(":")
        owner, dot, field = target.rpartition(".")
        if dot:
            new_name = ".".join((*self._sections[owner], field)) if owner in self._sections else target
        else:
            new_name = ".".join((*section, target)) if target else ""
        return RemovedKey(".".join((*section, key)), row, new_name)


def _classes(root: type, section: tuple[str, ...]) -> Iterator[tuple[type, tuple[str, ...]]]:
    """Yield a dataclass and all that are nested in it, with their sections in the file."""
    yield root, section
    for entry in dataclasses.fields(root):
        inner = entry.default_factory
        if isinstance(inner, type) and dataclasses.is_dataclass(inner):
            yield from _classes(inner, (*section, entry.name))
