"""A drive of a simulated driver without sight along a route: led by the glove from waypoint to waypoint, within the guard."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

from waychair.calibration.fits.dac import DEFAULT
from waychair.control.haptics.profile import HapticsProfile
from waychair.errors import WorldError
from waychair.simulation.follower import StallCheck
from waychair.simulation.plan.world import World
from waychair.simulation.simulator import Simulator
from waychair.trials.drive import DriveSetup, simulated_chair
from waychair.trials.guiding.helped_chair import HelpedChair
from waychair.trials.guiding.live_haptics import HapticOptions, open_haptics
from waychair.types import FloatArray, HelpLevel, Place, Pose2, SensorMessage

APART = 1.5
"""m; waypoints nearer to the one before are passed over, but for the last: a driver is led by few, long legs."""

REACHED = 0.5
"""m; tolerance of a waypoint."""


@contextmanager
def blind_drive(
    simulator: Simulator, world: World, route: FloatArray, driver: str = "default", seed: int = 0
) -> Iterator[Iterator[SensorMessage]]:
    """Yield the messages of a drive along a route (N, 2) [m, map], by the whole chair with board and glove.

    Their iterator raises WorldError where the chair touches something or makes no progress for a minute, and where no steps
    lead to a waypoint.

    Raises:
        BoardBuildError: a firmware cannot be built: no C compiler.
        ConfigError: there is no such driver.
    """
    body = simulator.body
    options = HapticOptions(HapticsProfile(speech=False), driver=driver)
    setup = DriveSetup(world.grid, {}, body, DEFAULT)
    with (
        open_haptics(options, body, world.grid, seed=seed, apart=False) as parts,
        simulated_chair(setup, simulator, haptics=parts.guide) as chair,
    ):
        yield _messages(HelpedChair(simulator, chair, parts), waypoints(route, simulator.truth()))


def waypoints(route: FloatArray, start: Pose2) -> tuple[Place, ...]:
    """Return the places of a route (N, 2) [m] to which a driver is led in turn, each with the heading of its arrival."""
    places: list[Place] = []
    last = start.x, start.y
    for number, (x, y) in enumerate(route.tolist(), 1):
        if math.dist((x, y), last) < APART and number < len(route):
            continue
        heading = math.atan2(y - last[1], x - last[0])
        places.append(Place(f"waypoint {number}", Pose2(x, y, heading), REACHED, math.pi))
        last = x, y
    return tuple(places)


def _messages(helped: HelpedChair, places: tuple[Place, ...]) -> Iterator[SensorMessage]:
    guide, progress = helped.parts.guide, StallCheck(helped.simulator)
    assert guide is not None
    for messages, _ in helped.begin(HelpLevel.GUIDE):
        yield from messages
    for place in places:
        helped.chair.lead(place)
        while guide.leader.goal is not None:
            yield from helped.tick()[0]
            progress.check()
        if not guide.leader.arrived:
            raise WorldError(f"the driver was not led to {place.name} of the route: {guide.leader.reason}")
