"""A drive of a simulated driver who cannot see along a route: led by the glove from waypoint to waypoint, within the guard."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

from waychair.calibration.fits.dac import DEFAULT
from waychair.control.haptics.profile import HapticsProfile
from waychair.errors import WorldError
from waychair.runtime.chair import Chair
from waychair.simulation.follower import StallCheck
from waychair.simulation.plan.world import World
from waychair.simulation.simulator import Simulator
from waychair.topics import COMMAND
from waychair.trials.drive import ARMED_S, READY_S, DriveSetup, advance_tick, simulated_chair
from waychair.trials.guiding.live_haptics import HapticOptions, HapticParts, open_haptics
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
        yield _messages(simulator, chair, parts, waypoints(route, simulator.truth()))


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


def _messages(
    simulator: Simulator, chair: Chair, parts: HapticParts, places: tuple[Place, ...]
) -> Iterator[SensorMessage]:
    guide, progress = parts.guide, StallCheck(simulator)
    assert guide is not None

    def tick() -> tuple[SensorMessage, ...]:
        messages = advance_tick(simulator, chair)
        chair.step(simulator.now_ns, messages)
        parts.beat(simulator)
        return messages

    for _ in range(round(READY_S * COMMAND.rate_hz)):
        yield from tick()
        if chair.ready:
            break
    chair.choose_level(HelpLevel.GUIDE)
    for _ in range(round(ARMED_S * COMMAND.rate_hz)):
        yield from tick()
        if chair.bridge.telemetry is not None and chair.bridge.telemetry.guard is not None:
            break
    for place in places:
        chair.lead(place)
        while guide.leader.goal is not None:
            yield from tick()
            progress.check()
        if not guide.leader.arrived:
            raise WorldError(f"the driver was not led to {place.name} of the route: {guide.leader.reason}")
