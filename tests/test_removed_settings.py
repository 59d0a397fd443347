"""Keys of old configuration files are explained in one sentence."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from waychair import removed_settings
from waychair.config import Settings, from_mapping, load, settable_fields, setting
from waychair.errors import ConfigError
from waychair.offline.mapping import MappingSettings
from waychair.removed_settings import TABLE, read_table

ROWS = """# a comment
BaseSettings.old\tconstant\t0.2 m\tno chair needs another one
Inner.way\trenamed:distance
Inner.far\tmoved:Outer.speed
GoneSettings.a\tconstant\t1 s
GoneSettings.b\tconstant\t-\tit follows from a
OtherSettings.a\tconstant\t7 s
EmptySettings.*\tconstant\t\tnothing used it
FormerName.thin\tconstant\t3
"""


@dataclass(frozen=True, slots=True)
class BaseSettings(Settings):
    name: str = setting("", "", "a name")


@dataclass(frozen=True, slots=True)
class Inner(Settings):
    distance: float = setting(1.0, "m", "a distance")


@dataclass(frozen=True, slots=True)
class Outer(BaseSettings):
    speed: float = setting(1.0, "m/s", "a speed")
    inner: Inner = field(default_factory=Inner)


@pytest.fixture
def table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "table.tsv"
    path.write_text(ROWS)
    monkeypatch.setattr(removed_settings, "TABLE", path)


@pytest.mark.usefixtures("table")
@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        (
            {"old": 0.3},
            "file: 'old' is no longer a setting: it is always 0.2 m (no chair needs another one); remove the line",
        ),
        ({"inner": {"way": 2}}, "file: 'inner.way' is now called 'inner.distance': rename it"),
        ({"inner": {"far": 2}}, "file: 'inner.far' is now called 'speed': rename it"),
        ({"gone": {"b": 1}}, "file: 'gone.b' is no longer a setting (it follows from a); remove the line"),
        ({"empty": {"x": 1}}, "file: 'empty.x' is no longer a setting (nothing used it); remove the line"),
        ({"thin": 1}, "file: 'thin' is no longer a setting: it is always 3; remove the line"),
        (
            {"old": 1, "gone": {"a": 1}, "inner": {"way": 2, "distance": 3.0}},
            "file: 3 keys are no longer settings or have new names: 'old' (always 0.2 m), 'gone.a' (always 1 s), 'inner.way'",
        ),
        ({"old": 1, "spede": 2}, "file: 'old' is no longer a setting"),
        ({"speed": 1, "spede": 2}, "file: unknown key 'spede'; did you mean 'speed'?"),
        ({"inner": {"wya": 2}}, "file: inner: unknown key 'wya'; did you mean 'distance'?"),
        ({"gone": {"c": 2}}, "file: unknown key 'gone'"),
        ({"gone": {}}, "file: unknown key 'gone'"),
    ],
)
def test_each_key_is_explained(values: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigError) as caught:
        from_mapping(Outer, values, "file")
    assert str(caught.value).startswith(sentence)


@pytest.mark.usefixtures("table")
def test_a_section_of_a_removed_class_is_recognised_by_its_keys_and_by_its_name() -> None:
    for name, always in (("gone", "1 s"), ("other", "7 s")):
        with pytest.raises(ConfigError, match=f"'{name}.a' is no longer a setting: it is always {always}; remove"):
            from_mapping(Outer, {name: {"a": 1}})


@pytest.mark.usefixtures("table")
def test_many_keys_are_counted_and_the_first_five_named() -> None:
    values = {"empty": dict.fromkeys("uvwxyz", 1)}
    with pytest.raises(
        ConfigError, match=r"^file: 6 keys .*'empty\.u' \(removed\), .*'empty\.y' \(removed\) and 1 more; r"
    ):
        from_mapping(Outer, values, "file")


@pytest.mark.usefixtures("table")
def test_parameters_of_a_node_are_explained_too() -> None:
    from waychair.ros.parameters import settings_from_parameters

    with pytest.raises(ConfigError, match=r"^bridge: 'inner\.way' is now called 'inner\.distance': rename it$"):
        settings_from_parameters(Outer, {"inner.way": 2}, "bridge")


def test_the_shipped_table_has_valid_rows_that_name_no_present_setting() -> None:
    rows = read_table(TABLE)
    present = {(owner.__name__, entry.name) for owner in _subclasses(Settings) for entry in settable_fields(owner)}
    assert rows
    assert not present & set(rows)


def test_every_constant_that_the_shipped_table_names_is_in_the_file_that_it_names() -> None:
    root = TABLE.resolve().parents[2]
    for row in read_table(TABLE).values():
        for constant, path in re.findall(r"\b([A-Z][A-Z_0-9]+) in ([a-z_/]+\.py)", row.reason):
            assert re.search(rf"\b{constant}\b", (root / path).read_text(encoding="utf-8")), row


def test_the_shipped_table_explains_an_old_file_in_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "config.yaml"
    path.write_text("input: {rgbd: {rate: 30.0}, coreslam: {wheel_radius: 0.077}, bag: {odom_frame: ''}}\n")
    with pytest.raises(ConfigError, match=r"config\.yaml: 3 keys are no longer settings .* remove or rename") as caught:
        load(MappingSettings, path)
    assert "\n" not in str(caught.value)


def test_a_table_with_a_wrong_row_is_refused(tmp_path: Path) -> None:
    for row in ("Inner\tconstant", "Inner.way\trenamed", "Inner.way\tgone", "Inner.a\tconstant\nInner.a\tconstant"):
        (tmp_path / "wrong.tsv").write_text(row)
        with pytest.raises(ValueError, match=r"wrong\.tsv, line [12]"):
            read_table(tmp_path / "wrong.tsv")


def _subclasses(cls: type) -> set[type]:
    return {each for sub in cls.__subclasses__() for each in (sub, *_subclasses(sub))}
