"""Strict YAML reading: every defect raises the caller's error, in one sentence."""

from __future__ import annotations

from pathlib import Path

import pytest

from waychair.errors import ConfigError, WaychairError
from waychair.yaml_files import MAX_DEPTH, compose_yaml, load_yaml, quoted, yaml_from_text


def written(folder: Path, text: str) -> Path:
    path = folder / "a.yaml"
    path.write_bytes(text.encode())
    return path


def test_values_are_those_of_yaml_and_an_empty_file_has_none(tmp_path: Path) -> None:
    assert load_yaml(written(tmp_path, "a: [1, 2.5, x, &b {c: null}, *b]\n"), ConfigError) == {
        "a": [1, 2.5, "x", {"c": None}, {"c": None}]
    }
    assert load_yaml(written(tmp_path, "# nothing\n"), ConfigError) is None
    assert compose_yaml(written(tmp_path, ""), ConfigError) is None


def test_nesting_up_to_the_limit_is_read(tmp_path: Path) -> None:
    assert load_yaml(written(tmp_path, "[" * MAX_DEPTH + "]" * MAX_DEPTH), ConfigError)
    with pytest.raises(ConfigError, match="more than 50 nested lists"):
        load_yaml(written(tmp_path, "[" * (MAX_DEPTH + 1) + "]" * (MAX_DEPTH + 1)), ConfigError)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[" * 100_000, r"a\.yaml, line 1: more than 50 nested lists or mappings; correct the YAML there"),
        ("- " * 100_000, "more than 50 nested lists"),
        ("a: {b: &c [*c]}", r"line 1: '\*c' contains itself"),
        ("a: 1\nb: 2\na: 3\n", "line 3: 'a' is given twice"),
        ("- {x: {y: 1, y: 2}}\n", "line 1: 'y' is given twice"),
        ("a: 1\nb: 2024-13-45\n", "line 2: '2024-13-45' is not a valid value"),
        ("a: " + "9" * 5000, r"line 1: '9+\.\.\.9+' is not a valid value"),
        ("a: -9223372036854775808", "is not a valid value"),
        ("a: 1\n---\nb: 2\n", "line 2: expected a single document"),
        ("a: *b", "line 1: found undefined alias"),
        ("a: [1", "correct the YAML there"),
        ("a: \x07", "is not YAML: it holds the character 0x07"),
        ("a: !!python/name:os.system x", "could not determine a constructor"),
        ("? [a]\n: 1\n", "unhashable"),
    ],
)
def test_every_defect_is_named_in_one_short_sentence(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said) as caught:
        load_yaml(written(tmp_path, text), ConfigError)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


def test_a_file_that_is_not_text_or_is_unreadable_is_named(tmp_path: Path) -> None:
    (tmp_path / "image").write_bytes(b"\x89PNG\xff")
    with pytest.raises(ConfigError, match="not UTF-8 text; give the other one"):
        load_yaml(tmp_path / "image", ConfigError, "give the other one")
    with pytest.raises(ConfigError, match=r"cannot read .*none: No such file or directory; check its name"):
        load_yaml(tmp_path / "none", ConfigError)
    with pytest.raises(ConfigError, match="give a file"):
        load_yaml(tmp_path, ConfigError)


def test_a_text_is_read_like_a_file() -> None:
    assert yaml_from_text("[1, 2]", "the parameter", WaychairError) == [1, 2]
    with pytest.raises(WaychairError, match="the parameter, line 1"):
        yaml_from_text("{a: 1, a: 2}", "the parameter", WaychairError)


def test_a_long_value_is_shortened_in_quotes() -> None:
    assert quoted([1.5, "x"]) == "[1.5, 'x']"
    assert len(quoted("9" * 5000)) < 80
