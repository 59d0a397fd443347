"""The simulated rider of a chair among others."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count

from tests.runtime.fleet.test_fleet_member import PLACES, ROOMS, WAYS
from tests.runtime.riding import FAR, Ride
from waychair.calibration.chair_body import CHAIR_A
from waychair.runtime.fleet.chain_driving import ChainDriver
from waychair.trials.fleet.fleet_drive import AGAIN_AFTER_S, MOST_TRIES, ChairRun, Rider
from waychair.types import Scan


@contextmanager
def riding() -> Iterator[tuple[Ride, Rider, Callable[[float], None]]]:
    """Give a ride, its rider, who has been driving to its goal for three seconds, and a function that lets them go on."""
    with Ride() as ride:
        driver = ChainDriver(WAYS, 1, CHAIR_A, PLACES)
        driver.stand_in((WAYS.slots[ROOMS[0]][0],))
        rider = Rider(1, ride.chair, ride.setup, driver, [ROOMS[3]], ChairRun(1))

        def follow(seconds: float) -> None:
            for _ in range(round(10 * seconds)):
                rider.state = ride.tick(2)
                rider.follow(None, ride.simulator.now_ns // 1_000_000)

        ride.tick(30)
        assert rider.wish(0, count(1)) is not None
        rider.follow((FAR,), 0)
        follow(3.0)
        yield ride, rider, follow


def test_a_rider_asks_again_only_once_the_chair_is_ready() -> None:
    with riding() as (ride, rider, follow):
        ride.change = lambda messages: tuple(each for each in messages if not isinstance(each, Scan))
        follow(AGAIN_AFTER_S + 2.0)
        assert (len(rider.run.ends), rider.run.again) == (1, 0)
        ride.change = lambda messages: messages
        follow(2.0)
        assert (len(rider.run.ends), rider.run.again) == (1, 1)


def test_a_rider_who_resets_a_chair_asks_again_at_once() -> None:
    with riding() as (ride, rider, follow):
        ride.chair.stop()
        follow(2.0)
        rider.reset(ride.simulator.now_ns // 1_000_000)
        follow(1.0)
        assert (len(rider.run.ends), rider.run.again) == (1, 1)
        assert ride.chair.navigator.active


def test_a_rider_asks_again_after_any_number_of_faults_at_one_place() -> None:
    with riding() as (ride, rider, follow):
        for times in range(1, MOST_TRIES + 2):
            ride.chair.stop()
            follow(1.0)
            rider.reset(ride.simulator.now_ns // 1_000_000)
            follow(0.5)
            assert rider.run.again == times
        assert ride.chair.navigator.active
