"""Configuration: strict YAML in, documented YAML out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from waychair import config
from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.config import Settings, given, setting
from waychair.errors import ConfigError
from waychair.offline.mapping import MappingSettings


@dataclass(frozen=True, slots=True)
class Inner(Settings):
    speed: float = setting(0.8, "m/s", "largest speed", low=0.0, high=2.0)


@dataclass(frozen=True, slots=True)
class Outer(Settings):
    name: str = setting("A", "", "who")
    count: int = setting(3, "", "how many", low=1, high=9)
    loud: bool = setting(False, "", "whether it beeps")
    inner: Inner = field(default_factory=Inner)


@pytest.mark.parametrize("settings", [Outer(), Outer("x: y # z", 9, True, Inner(0.0)), CHAIR_B, MappingSettings()])
def test_a_dumped_configuration_is_read_back_unchanged(settings: Settings, tmp_path: Path) -> None:
    path = tmp_path / "settings.yaml"
    config.save(settings, path)
    assert config.load(type(settings), path) == settings


def test_a_dump_gives_unit_and_meaning_of_every_value() -> None:
    text = config.dump(Outer())
    assert "speed: 0.8  # m/s, largest speed" in text
    assert "count: 3  # how many" in text


def test_missing_keys_keep_their_defaults_also_in_an_empty_file(tmp_path: Path) -> None:
    (tmp_path / "empty.yaml").write_text("")
    assert config.load(Outer, tmp_path / "empty.yaml") == Outer()
    assert config.from_mapping(Outer, {"inner": {"speed": 1}}) == Outer(inner=Inner(1.0))


def test_an_unknown_key_names_the_nearest_known_one() -> None:
    with pytest.raises(ConfigError, match="unknown key 'cuont'; did you mean 'count'"):
        config.from_mapping(Outer, {"cuont": 3})
    with pytest.raises(ConfigError, match="inner: unknown key 'sped'; did you mean 'speed'"):
        config.from_mapping(Outer, {"inner": {"sped": 3}})


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"count": 0}, "count = 0"),
        ({"count": 10}, "count = 10"),
        ({"count": "many"}, "count"),
        ({"count": 2.5}, "count"),
        ({"inner": {"speed": 2.01}}, "speed = 2.01"),
        ({"inner": {"speed": math.nan}}, "speed = nan"),
        ({"inner": {"speed": math.inf}}, "speed = inf"),
        ({"inner": 3}, "inner"),
        ({"loud": "perhaps"}, "loud"),
    ],
)
def test_impossible_values_are_refused_by_name(values: dict[str, object], named: str) -> None:
    with pytest.raises(ConfigError, match=named.replace(".", r"\.")):
        config.from_mapping(Outer, values)


def test_values_at_the_limits_are_accepted() -> None:
    assert Outer(count=1).count == 1
    assert Outer(count=9, inner=Inner(2.0)).inner.speed == 2.0


@pytest.mark.parametrize("text", ["{", "- 1\n- 2", "just words", "\x00"])
def test_an_invalid_file_gives_one_sentence(text: str, tmp_path: Path) -> None:
    path = tmp_path / "broken.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        config.load(Outer, path)
    assert "\n" not in str(caught.value)
    assert "broken.yaml" in str(caught.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.yaml"):
        config.load(Outer, tmp_path / "none.yaml")


def test_the_two_chairs_have_the_sizes_of_the_design() -> None:
    assert (CHAIR_A.length, CHAIR_A.width, CHAIR_A.axle_from_rear) == (1.00, 0.60, 0.25)
    assert (CHAIR_B.length, CHAIR_B.width) == (1.10, 0.70)
    assert CHAIR_B.circumscribed_radius == pytest.approx(math.hypot(0.85, 0.35))
    assert ChairBody().outline().min(axis=0).tolist() == [-0.25, -0.3]
    assert ChairBody().outline().max(axis=0).tolist() == [0.75, 0.3]


@dataclass(frozen=True, slots=True)
class Limits(Settings):
    fastest: float = setting(0.8, "m/s", "highest speed")
    measured: float = given(0.3)


def test_a_field_that_the_program_fills_is_in_no_file() -> None:
    assert "measured" not in config.dump(Limits(measured=0.5))
    with pytest.raises(ConfigError, match="unknown key 'measured'; did you mean 'fastest'"):
        config.from_mapping(Limits, {"measured": 0.5})
