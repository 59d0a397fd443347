"""Effects of controllers beyond gains and ramps, on the motion of a kinematic chair."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import ConfigError
from waychair.simulation.plant.kinematic_chair import KinematicChair
from waychair.simulation.plant.motor_controller import MotorController
from waychair.simulation.plant.plant import PlantSettings, families
from waychair.simulation.plant.plant_families import (
    CASTER_TRAIL,
    FAMILIES,
    Casters,
    Heat,
    ParkingBrake,
    PlantFamily,
    cut_speed_and_turn,
    stick_response,
    voltage,
)
from waychair.types import Pose2, WheelSpeeds

QUIET = PlantSettings(
    speed_noise=0.0,
    slip_noise=0.0,
    left_wheel_scale=1.0,
    right_wheel_scale=1.0,
    forward_skew=0.0,
    turn_skew=0.0,
    delay_s=0.0,
)
SHARES = st.floats(0.0, 1.0)
DEFLECTIONS = st.floats(-1.0, 1.0)


def _of(family: PlantFamily) -> PlantSettings:
    return dataclasses.replace(QUIET, family=family)


def _speeds(family: PlantFamily, forward_volts: float, turn_volts: float, steps: int = 1000) -> WheelSpeeds:
    """Return rim speeds after this number of steps without load."""
    controller = MotorController(CHAIR_A.track, _of(family))
    for _ in range(steps):
        wheels = controller.step(forward_volts, turn_volts)
    return wheels


def _forward(wheels: WheelSpeeds) -> float:
    return 0.5 * (wheels.left + wheels.right)


def _difference(wheels: WheelSpeeds) -> float:
    return wheels.right - wheels.left


@given(deflection=DEFLECTIONS, curve=SHARES)
def test_the_s_curve_is_odd_and_stays_within_the_stick_and_keeps_its_ends(deflection: float, curve: float) -> None:
    answer = stick_response(deflection, curve)
    assert answer == -stick_response(-deflection, curve)
    assert abs(answer) <= 1.0 + 1e-12
    assert answer * deflection >= 0.0
    assert stick_response(1.0, curve) == pytest.approx(1.0)
    assert stick_response(deflection, 0.0) == deflection


@given(low=SHARES, high=SHARES, curve=SHARES)
def test_the_s_curve_never_falls(low: float, high: float, curve: float) -> None:
    low, high = sorted((low, high))
    assert stick_response(low, curve) <= stick_response(high, curve) + 1e-12


def test_an_s_curve_chair_is_slower_near_the_middle_and_as_fast_at_the_end() -> None:
    straight, curved = PlantFamily(), FAMILIES["s_curve"]
    assert _forward(_speeds(curved, 1.65 + 0.3, 1.65)) < 0.7 * _forward(_speeds(straight, 1.65 + 0.3, 1.65))
    assert _forward(_speeds(curved, 1.65 + 1.2, 1.65)) == pytest.approx(_forward(_speeds(straight, 1.65 + 1.2, 1.65)))


@given(forward=DEFLECTIONS, turn=DEFLECTIONS)
def test_speed_and_turn_reduce_each_other_and_neither_changes_its_sign(forward: float, turn: float) -> None:
    cut_forward, cut_turn = cut_speed_and_turn(forward, turn, FAMILIES["turn_cut"])
    assert abs(cut_forward) <= abs(forward)
    assert abs(cut_turn) <= abs(turn)
    assert cut_forward * forward >= 0.0
    assert cut_turn * turn >= 0.0
    assert cut_speed_and_turn(forward, turn, PlantFamily()) == (forward, turn)


def test_a_turn_costs_speed_and_speed_costs_turn() -> None:
    cut, full = FAMILIES["turn_cut"], PlantFamily()
    both, straight, spin = _speeds(cut, 2.85, 0.45), _speeds(cut, 2.85, 1.65), _speeds(cut, 1.65, 0.45)
    assert _forward(both) == pytest.approx(0.6 * _forward(straight), rel=1e-3)
    assert _difference(both) == pytest.approx(0.5 * _difference(spin), rel=1e-3)
    assert straight == _speeds(full, 2.85, 1.65)
    assert spin == _speeds(full, 1.65, 0.45)


@pytest.mark.parametrize("dial", [0.2, 0.5, 1.0])
def test_the_dial_scales_speed_and_turn_alike(dial: float) -> None:
    turned, full = _speeds(PlantFamily(dial=dial), 2.5, 1.2), _speeds(PlantFamily(), 2.5, 1.2)
    assert _forward(turned) == pytest.approx(dial * _forward(full), rel=1e-3)
    assert _difference(turned) == pytest.approx(dial * _difference(full), rel=1e-3)


def test_a_drive_profile_softens_the_ramps_too() -> None:
    soft = PlantFamily(profile_ramp=0.5)
    assert _forward(_speeds(soft, 2.85, 1.65, 100)) == pytest.approx(
        _forward(_speeds(PlantFamily(), 2.85, 1.65, 100)) / 2, rel=1e-6
    )


@given(load=SHARES, more=SHARES, charge=SHARES)
def test_voltage_falls_with_load_and_discharge_and_never_exceeds_that_of_a_full_battery(
    load: float, more: float, charge: float
) -> None:
    sag = dataclasses.replace(FAMILIES["sag"], charge=charge)
    load, more = sorted((load, more))
    assert 0.7 < voltage(more, sag) <= voltage(load, sag) <= 1.0
    assert voltage(load, sag) <= voltage(load, dataclasses.replace(sag, charge=1.0))
    assert voltage(load, PlantFamily(charge=charge)) == 1.0


def test_an_old_battery_makes_the_chair_slower_and_load_slower_still() -> None:
    tired = FAMILIES["sag"]
    fast, slow = _forward(_speeds(PlantFamily(), 2.5, 1.65)), _forward(_speeds(tired, 2.5, 1.65))
    assert slow == pytest.approx((1.0 - 0.12 * 0.7) * fast, rel=1e-3)
    loaded = MotorController(CHAIR_A.track, _of(tired))
    for _ in range(1000):
        wheels = loaded.step(2.5, 1.65, 1.0)
    assert _forward(wheels) == pytest.approx((1.0 - 0.12 * 0.7 - 0.10) * fast, rel=1e-3)


@pytest.mark.parametrize("release_s", [0.2, 0.35, 0.5])
@pytest.mark.parametrize("volts", [(2.2, 1.65), (1.0, 1.65), (1.65, 2.2)])
def test_nothing_moves_until_the_parking_brake_has_opened(release_s: float, volts: tuple[float, float]) -> None:
    controller = MotorController(CHAIR_A.track, _of(PlantFamily(brake_release_s=release_s)))
    opens = round(release_s / 0.005)
    wheels = [controller.step(*volts) for _ in range(opens + 5)]
    assert wheels[: opens - 1] == [WheelSpeeds()] * (opens - 1)
    assert wheels[opens] != WheelSpeeds()


def test_the_brake_closes_only_at_rest_after_its_time_and_a_tap_on_the_stick_does_not_open_it() -> None:
    controller = MotorController(CHAIR_A.track, _of(FAMILIES["brake_release"]))
    for _ in range(20):
        controller.step(2.2, 1.65)
    for _ in range(100):
        controller.step(1.65, 1.65)
    assert controller.braked
    for _ in range(400):
        wheels = controller.step(2.2, 1.65)
    assert not controller.braked
    rest = 0
    while not controller.braked:
        wheels = controller.step(1.65, 1.65)
        rest = rest + 1 if max(abs(wheels.left), abs(wheels.right)) < 0.01 else 0
        assert rest <= 101
    assert rest >= 99
    assert controller.step(1.65, 1.65) == WheelSpeeds()


def test_a_pause_shorter_than_the_brakes_time_needs_no_second_opening() -> None:
    brake = ParkingBrake(PlantFamily(brake_release_s=0.2), 0.01)
    for _ in range(20):
        brake.step(True, 0.0)
    assert not brake.shut
    for _ in range(49):
        brake.step(False, 0.0)
    assert not brake.step(True, 0.0)
    for _ in range(49):
        assert not brake.step(False, 0.0)
    assert brake.step(False, 0.0)


def test_a_chair_without_a_brake_starts_at_once() -> None:
    assert _speeds(PlantFamily(), 2.2, 1.65, 1) != WheelSpeeds()


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_casters_yaw_the_chair_once_at_a_start_in_reverse_and_to_the_side_of_the_last_turn(side: float) -> None:
    casters = Casters(PlantFamily(caster_flip=0.2))
    casters.step(0.5, side, 0.01)
    assert sum(0.01 * casters.step(0.5, 0.0, 0.01) for _ in range(300)) == 0.0
    assert sum(0.01 * casters.step(-0.5, 0.0, 0.01) for _ in range(300)) == pytest.approx(side * 0.2)
    assert sum(0.01 * casters.step(-0.5, 0.0, 0.01) for _ in range(300)) == 0.0
    assert sum(0.01 * casters.step(0.5, 0.0, 0.01) for _ in range(300)) == pytest.approx(side * 0.2)


@given(step=st.floats(0.001, 0.02), speed=st.floats(0.05, 1.5))
def test_a_swing_of_the_casters_yaws_by_the_same_angle_at_any_speed_and_step(step: float, speed: float) -> None:
    casters = Casters(PlantFamily(caster_flip=0.12))
    steps = math.ceil(0.5 / (speed * step))
    assert sum(step * casters.step(-speed, 0.0, step) for _ in range(steps)) == pytest.approx(0.12)


def test_a_caster_in_the_middle_of_its_swing_stands_across() -> None:
    casters, step = Casters(PlantFamily(caster_flip=0.12)), CASTER_TRAIL / 50
    half = sum(step * casters.step(-1.0, 0.0, step) for _ in range(185))  # 3.7 trails of distance
    assert half == pytest.approx(0.06, rel=1e-6)


def test_a_chair_with_such_casters_starts_in_reverse_at_an_angle_and_its_encoders_measure_it() -> None:
    def yaw(family: PlantFamily) -> tuple[float, float]:
        chair = KinematicChair(CHAIR_A, _of(family), np.random.default_rng(0))
        for _ in range(600):
            chair.step(1.2, 1.65, lambda _pose: True)
        left, right = (ticks * math.tau * CHAIR_A.wheel_radius / CHAIR_A.ticks_per_turn for ticks in chair.ticks)
        return chair.pose.theta, (right - left) / CHAIR_A.track

    assert yaw(PlantFamily()) == (0.0, 0.0)
    true, seen = yaw(FAMILIES["caster_flip"])
    assert abs(true) == pytest.approx(0.12, rel=0.02)
    assert seen == pytest.approx(true, abs=2e-3)


def test_sustained_load_reduces_the_power_and_rest_restores_it() -> None:
    fading = PlantFamily(thermal_fade=0.4, thermal_from=0.1, thermal_full=0.5, thermal_s=10.0)
    heat = Heat(fading, 0.01)
    work = [heat.step(1.0) for _ in range(6000)]
    assert work[0] == 1.0
    assert all(later <= earlier for earlier, later in itertools.pairwise(work))
    assert work[-1] == pytest.approx(0.6)
    # 1 - exp(-t / 10 s) reaches 0.1 after 1.05 s
    assert work[100] == 1.0
    assert work[110] < 1.0
    assert [heat.step(0.0) for _ in range(6000)][-1] == 1.0


def test_continuous_light_load_costs_no_power() -> None:
    heat = Heat(PlantFamily(thermal_fade=0.4, thermal_from=0.1, thermal_full=0.5, thermal_s=1.0), 0.01)
    assert min(heat.step(0.3) for _ in range(3000)) == 1.0


def test_a_kinematic_chair_that_fades_is_slower_after_five_minutes_at_full_speed() -> None:
    chair = KinematicChair(CHAIR_A, _of(FAMILIES["thermal_fade"]), np.random.default_rng(0))
    speeds = []
    for _ in range(60_000):
        chair.step(2.85, 1.65, lambda _pose: True)
        speeds.append(chair.twist.v)
    assert max(speeds) > 1.4
    assert speeds[-1] < 0.9 * max(speeds)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", FAMILIES)
def test_every_family_moves_the_chair_differently_from_the_nominal_one(name: str) -> None:
    def way(settings: PlantSettings) -> Pose2:
        chair = KinematicChair(CHAIR_A, settings, np.random.default_rng(0))
        for volts in ((1.0, 1.65), (2.4, 1.2), (2.85, 1.65)):
            for _ in range(2000):
                chair.step(*volts, lambda _pose: True)
        return chair.pose

    nominal, other = way(QUIET), way(families(QUIET)[name])
    assert math.dist((nominal.x, nominal.y), (other.x, other.y)) > 0.05


def test_impossible_families_are_refused() -> None:
    with pytest.raises(ConfigError, match="dial"):
        PlantFamily(dial=0.1)
    with pytest.raises(ConfigError, match="charge"):
        PlantFamily(charge=1.5)
