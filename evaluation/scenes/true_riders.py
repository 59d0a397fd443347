"""The lag and the nudge that a simulated driver truly has on its chair, measured from true poses and without the learner.

The driver is sent ahead, nudged, stopped, and turned to both sides, in an empty room and with nobody who leads.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.dac import DEFAULT
from waychair.control.haptics.patterns import vocabulary
from waychair.control.haptics.symbols import Symbol
from waychair.firmware_bridge.glove.bridge import GloveBridge
from waychair.firmware_bridge.glove.fitting import Fitting
from waychair.firmware_bridge.glove.layouts import layout_named
from waychair.firmware_bridge.glove.program import GloveConfig, HostGlove, glove_program
from waychair.firmware_bridge.transports import Reconnecting
from waychair.simulation.plan.floor_plan import FloorPlan, walls_round
from waychair.simulation.plan.world import World, world_from_plan
from waychair.simulation.rider.blind_driver import BlindDriver
from waychair.simulation.rider.driver_presets import driver_named
from waychair.simulation.simulator import Simulator
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import TICK_NS, DriveSetup, simulated_chair
from waychair.trials.guiding.helped_chair import HelpedChair
from waychair.trials.guiding.live_haptics import HapticParts, learnt_words, used_to
from waychair.types import FloatArray, HelpLevel

NUDGES = (Symbol.NUDGE_LEFT, Symbol.NUDGE_RIGHT) * 4

SETS_OUT = (Symbol.FORWARD, Symbol.SWIVEL_LEFT, Symbol.SWIVEL_RIGHT)

STEADY_S = (1.2, 2.2)
"""s after a symbol's end in which the chair moves steadily; a straight line through its way, or its turn, gives the lag."""

RESTS_S = 2.0
"""s from the end of a warning until the chair is at rest."""

NUDGED_S, BESIDE_S = 1.5, 0.3
"""s after a nudge's end in which its whole turn is made, and before and after that, where the drift is measured."""

MOVES = 0.1
"""m/s, rad/s; a slower chair does not do as it was told."""

LENGTH, WIDTH = 14.0, 7.0
"""m; of the room."""


@dataclass(frozen=True, slots=True)
class TrueRider:
    """What one driver truly did: the lags to symbols from rest [s], and the turn by each nudge [rad], to the side that was told.

    A symbol that the driver took for something else has no lag, and after such a FORWARD there are no nudges.
    """

    lags_s: tuple[float, ...]
    nudges: tuple[float, ...]


def true_rider(body: ChairBody, driver: str, seed: int, motors: str = "glove_3x3") -> TrueRider:
    """Let a driver on a chair of this seed answer the symbols of these motors, and return what it did; raises as `guided_trial`."""
    world = _room()
    simulator = Simulator(world, body, randomised_settings(seed), seed)
    layout, words, config = layout_named(motors), vocabulary(motors), GloveConfig(layout=motors)
    model = used_to(driver_named(driver), simulator.settings.plant)
    setup = DriveSetup(world.grid, {}, body, DEFAULT)
    poses: list[tuple[float, float, float, float]] = []
    with HostGlove(glove_program(), config) as glove, simulated_chair(setup, simulator) as chair:
        rider = BlindDriver(layout, learnt_words(words), model, seed)
        helped = HelpedChair(simulator, chair, HapticParts(None, glove, lambda _: rider))
        bridge = GloveBridge(Reconnecting(lambda: glove.transport), config.device_id, layout, Fitting())

        def run(seconds: float) -> None:
            for _ in range(round(seconds * 1e9 / TICK_NS)):
                bridge.tick(simulator.now_ns, armed=True)
                helped.tick()
                pose = simulator.truth()
                poses.append((simulator.now_ns * 1e-9, pose.x, pose.y, pose.theta))

        def told(symbol: Symbol) -> float:
            """Play a symbol, and return when its pattern ends [s]."""
            pattern, began_s = words.patterns[symbol], simulator.now_ns * 1e-9
            assert bridge.play(pattern.steps(), 100, 500, simulator.now_ns) == ""
            run(1e-3 * pattern.duration_ms)
            return began_s + 1e-3 * pattern.duration_ms

        for _ in helped.begin(HelpLevel.INFORM):
            bridge.tick(simulator.now_ns, armed=True)
        begun_s, ends_s = [], []
        for symbol in SETS_OUT:
            begun_s.append(told(symbol))
            run(STEADY_S[1])
            for nudge in NUDGES if symbol is Symbol.FORWARD else ():
                ends_s.append(told(nudge))
                run(NUDGED_S + BESIDE_S)
            told(Symbol.WARNING)
            run(RESTS_S)
    way = np.array(poses)
    lags = [_lag(way, symbol, begun) for symbol, begun in zip(SETS_OUT, begun_s, strict=True)]
    turns = [_left(symbol) * _turn(way, end) for symbol, end in zip(NUDGES, ends_s, strict=True)]
    return TrueRider(tuple(lag for lag in lags if lag is not None), () if lags[0] is None else tuple(turns))


def _room() -> World:
    """Return an empty room with the chair at one end, facing the other."""
    plan = FloorPlan(
        name="empty room",
        size=(LENGTH + 0.4, WIDTH + 0.4),
        start=(2.0, 0.2 + WIDTH / 2, 0.0),
        walls=walls_round((LENGTH, WIDTH), corner=(0.2, 0.2)),
    )
    return world_from_plan(plan, plan.name)


def _left(symbol: Symbol) -> float:
    """Return 1 for a symbol to the left, -1 for one to the right."""
    return 1.0 if symbol in (Symbol.SWIVEL_LEFT, Symbol.NUDGE_LEFT) else -1.0


def _lag(poses: FloatArray, symbol: Symbol, ended_s: float) -> float | None:
    """Return the time [s] from a pattern's end until a chair that moves steadily would have set out at that speed.

    None: it does not do as it was told.
    """
    times = poses[:, 0] - ended_s
    if symbol is Symbol.FORWARD:
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, 1:3], axis=0).T))])
    else:
        way = _left(symbol) * np.unwrap(poses[:, 3])
    steady = (times >= STEADY_S[0]) & (times <= STEADY_S[1])
    speed, offset = np.polyfit(times[steady], way[steady], 1)
    return float((np.interp(0.0, times, way) - offset) / speed) if speed > MOVES else None


def _turn(poses: FloatArray, ended_s: float) -> float:
    """Return the turn [rad] within `NUDGED_S` of a pattern's end, less the drift before and after."""
    times, heading = poses[:, 0] - ended_s, np.unwrap(poses[:, 3])
    before, begin, end, after = np.interp([-BESIDE_S, 0.0, NUDGED_S, NUDGED_S + BESIDE_S], times, heading)
    drift = ((begin - before) + (after - end)) / (2.0 * BESIDE_S)
    return math.remainder(float(end - begin - drift * NUDGED_S), math.tau)
