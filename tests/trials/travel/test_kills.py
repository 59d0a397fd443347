"""A computer that dies in any phase of a journey: the board lets go of the lines, the chair stands, and nothing is decided."""

from __future__ import annotations

import pytest

from tests.runtime.riding import coarse_arcs
from waychair.control.journey.journey import JourneyPhase
from waychair.firmware_bridge.protocol import Holder
from waychair.runtime.journeys import TravelState
from waychair.simulation.plan.world import load_levels
from waychair.simulation.simulator import Simulator
from waychair.trials.travel.journeys import journey

STEP_NS, RELEASED_NS, STANDS_NS = 10_000_000, 150_000_000, 2_000_000_000
AFTER_S = 1.0
"""s; into the phase: the chair drives by then."""


class Killed(Exception):
    """The computer's process is gone."""


@pytest.mark.nightly
@pytest.mark.parametrize(
    "phase", [JourneyPhase.DRIVE, JourneyPhase.WAIT, JourneyPhase.ENTER, JourneyPhase.RIDE, JourneyPhase.LEAVE]
)
def test_the_lines_are_released_within_150_ms_of_a_kill_in_every_phase(phase: JourneyPhase) -> None:
    since_ns: list[int] = []

    def kill(state: TravelState, simulator: Simulator) -> None:
        if state.journey is None or state.journey.phase is not phase:
            return
        since_ns.append(simulator.now_ns)
        if simulator.now_ns - since_ns[0] < AFTER_S * 1e9:
            return
        died_ns = simulator.now_ns
        while simulator.now_ns - died_ns < RELEASED_NS:  # nobody sends heartbeats or commands any more
            simulator.advance(STEP_NS)
        assert simulator.lines is not None
        assert simulator.lines.holder is not Holder.BOARD
        while simulator.now_ns - died_ns < STANDS_NS:
            simulator.advance(STEP_NS)
        assert abs(simulator.twist().v) + abs(simulator.twist().omega) < 0.02
        assert simulator.contacts == 0
        raise Killed

    levels = load_levels("two_floors")
    with coarse_arcs(), pytest.raises(Killed):
        journey(levels, ("ground", "lift"), ("upper", "lift"), seed=1, people=False, on_tick=kill)
