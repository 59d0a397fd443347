"""Chairs by name and by file."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import msgspec
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.chair_body import BODIES, CHAIR_A, CHAIR_B
from waychair.errors import ConfigError
from waychair.simulation.plant.chair_file import CHAIRS, SimulatedChairData, load_chair, randomised_chair
from waychair.simulation.plant.mujoco_model import MujocoSettings
from waychair.simulation.plant.plant import PlantSettings, families


def test_every_built_in_body_is_a_chair_and_a_is_the_default() -> None:
    assert list(CHAIRS) == list(BODIES)
    assert all(load_chair(name).body == body for name, body in BODIES.items())
    assert load_chair() == SimulatedChairData() == CHAIRS["A"]


@pytest.mark.parametrize("name", CHAIRS)
def test_a_chair_is_read_back_from_its_values(name: str, tmp_path: Path) -> None:
    chair = randomised_chair(CHAIRS[name], 5)
    (tmp_path / "chair.yaml").write_text(yaml.safe_dump(msgspec.to_builtins(chair)))
    assert load_chair(tmp_path / "chair.yaml") == chair


@pytest.mark.parametrize("name", families())
def test_a_chair_of_each_family_is_read_back_from_its_values(name: str, tmp_path: Path) -> None:
    chair = SimulatedChairData(plant=families()[name])
    (tmp_path / "chair.yml").write_text(yaml.safe_dump(msgspec.to_builtins(chair)))
    assert load_chair(str(tmp_path / "chair.yml")) == chair


def test_a_file_needs_only_the_values_that_differ_from_chair_a(tmp_path: Path) -> None:
    path = tmp_path / "heavy.yaml"
    path.write_text("body: {chair_id: heavy}\nmujoco: {rider_mass: 120}\nplant: {family: {dial: 0.4}}\n")
    chair = load_chair(path)
    assert chair.body == dataclasses.replace(CHAIR_A, chair_id="heavy")
    assert chair.mujoco == MujocoSettings(rider_mass=120.0)
    assert chair.plant.family.dial == 0.4
    assert dataclasses.replace(chair.plant, family=PlantSettings().family) == PlantSettings()


def test_an_unknown_name_is_answered_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"no chair 'C': take one of A, B, A_mid, A_front, robot, or a .yaml file"):
        load_chair("C")


@pytest.mark.parametrize(
    ("text", "advice"),
    [
        ("plant: {forwards_gain: 1}", "did you mean 'forward_gain'"),
        ("body: {drive: sideways}", "take rear, mid or front"),
        ("mujoco: {rider_mass: 0}", "rider_mass = 0.* is impossible"),
        ("mujoco: {timestep_ms: 3}", "a whole number of it"),
        ("plant: {family: {dial: 7}}", "dial = 7.* is impossible"),
        ("plant: {family: {dail: 0.5}}", "did you mean 'dial'"),
        ("plant: 3", "must hold `key: value` lines"),
        ("- A", "must hold `key: value` lines"),
        ("body: {", "correct the YAML"),
    ],
)
def test_an_invalid_file_is_refused_with_advice(text: str, advice: str, tmp_path: Path) -> None:
    path = tmp_path / "broken.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=advice):
        load_chair(path)


def test_a_missing_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"cannot read .*missing\.yaml"):
        load_chair(tmp_path / "missing.yaml")


@given(seed=st.integers(0, 2**32))
def test_a_randomised_chair_has_the_same_body_and_a_rider_within_the_stated_range(seed: int) -> None:
    chair = randomised_chair(CHAIRS["B"], seed)
    assert chair.body == CHAIR_B
    assert chair == randomised_chair(CHAIRS["B"], seed)
    assert chair.plant != CHAIRS["B"].plant
    assert 0.75 * 75.0 <= chair.mujoco.rider_mass <= 1.25 * 75.0
    assert abs(chair.mujoco.rider_from_rear - 0.42) <= 0.03
    assert chair.mujoco.caster_radius == CHAIRS["B"].mujoco.caster_radius
