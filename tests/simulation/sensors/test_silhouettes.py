"""The circles of people for lidar and sonars."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.geometry import transform_points
from waychair.simulation.scene.scene import PersonBehaviour, PersonState
from waychair.simulation.sensors.silhouettes import FULL_STRIDE_SPEED, HIP, SWING, bodies, legs, legs_of, rider_legs
from waychair.types import FloatArray, Pose2

WALKERS = (PersonBehaviour.PATH, PersonBehaviour.SOCIAL, PersonBehaviour.SUDDEN)


def _person(
    behaviour: PersonBehaviour = PersonBehaviour.PATH,
    speed: float = 1.0,
    stride: float = 0.0,
    pose: Pose2 | None = None,
) -> PersonState:
    return PersonState(pose or Pose2(3.0, 2.0, 0.7), speed, stride, 0.25, behaviour)


def _own(person: PersonState) -> FloatArray:
    """Leg centres in the person's own frame: ahead, to the left."""
    return transform_points(person.pose.inverse(), legs_of(person)[:, :2])


@pytest.mark.parametrize("behaviour", WALKERS)
def test_walkers_have_two_legs_one_to_each_side(behaviour: PersonBehaviour) -> None:
    for stride in np.linspace(0.0, 7.0, 15):
        assert _own(_person(behaviour, stride=float(stride)))[:, 1] == pytest.approx([HIP, -HIP])


def test_legs_pass_each_other_once_in_every_step() -> None:
    ahead = np.array([_own(_person(stride=float(phase)))[:, 0] for phase in np.linspace(0.0, 2 * math.pi, 41)])
    assert ahead[:, 0] == pytest.approx(-ahead[:, 1])
    assert ahead.max() == pytest.approx(SWING)
    left_leads = ahead[:, 0] > 1e-9
    assert left_leads[1:20].all()
    assert not left_leads[20:].any()


def test_a_standing_person_has_the_legs_side_by_side_and_slow_steps_are_short() -> None:
    assert _own(_person(speed=0.0, stride=1.3))[:, 0] == pytest.approx([0.0, 0.0])
    slow = _own(_person(speed=FULL_STRIDE_SPEED / 2, stride=math.pi / 2))
    assert slow[0, 0] == pytest.approx(SWING / 2)


def test_a_mover_is_one_disc_of_its_radius() -> None:
    np.testing.assert_allclose(legs_of(_person(PersonBehaviour.BOUNCE, stride=1.0)), [[3.0, 2.0, 0.25]])


def test_a_seated_person_has_shins_ahead_of_the_four_legs_of_the_chair() -> None:
    person = _person(PersonBehaviour.SEATED, speed=0.0)
    own, radii = _own(person), legs_of(person)[:, 2]
    shins = radii > 0.03
    assert shins.sum() == 2
    assert (~shins).sum() == 4
    assert own[shins, 0].min() > own[~shins, 0].max()


def test_the_number_of_circles_of_a_person_depends_on_its_behaviour_only() -> None:
    for behaviour in PersonBehaviour:
        shapes = {legs_of(_person(behaviour, speed, stride)).shape for speed in (0.0, 1.4) for stride in (0.0, 2.0)}
        assert len(shapes) == 1


def test_legs_and_bodies_of_several_people_follow_their_order() -> None:
    people = [_person(pose=Pose2(1.0, 0.0, 0.0)), _person(PersonBehaviour.BOUNCE, pose=Pose2(5.0, 5.0, 0.0))]
    np.testing.assert_array_equal(legs(people), np.vstack([legs_of(person) for person in people]))
    np.testing.assert_allclose(bodies(people), [[1.0, 0.0, 0.25], [5.0, 5.0, 0.25]])
    assert legs([]).shape == bodies([]).shape == (0, 3)


@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_B])
def test_the_riders_legs_are_over_the_foot_rests_and_clear_of_the_lidar(body: ChairBody) -> None:
    x, y, radius = rider_legs(body).T
    assert (x + radius <= body.front).all()
    assert (x > 0.3).all()
    assert (np.abs(y) + radius <= body.width / 2).all()
    gaps = np.hypot(x - body.laser_x, y - body.laser_y) - radius
    assert (gaps > 0.05).all()
    assert (gaps < 0.3).all()
