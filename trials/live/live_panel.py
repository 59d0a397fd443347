"""What a live chair shows before it has started, and the figures of the engineer's panel."""

from __future__ import annotations

import resource

from waychair.runtime.chair import ChairState
from waychair.runtime.pages.chair_port import ChairView
from waychair.slam.localising.localisation import LocalisationState
from waychair.trials.live.real_time import LoopTiming
from waychair.types import DriveMode, Twist

BEFORE_START = ChairView(
    stamp_ns=0,
    map_from_base=None,
    localisation=LocalisationState.LOST,
    health=0.0,
    mode=DriveMode.MANUAL,
    twist=Twist(),
    next_action="The chair is starting.",
)


def panel_figures(state: ChairState, timing: LoopTiming, contacts: int, cells: int) -> dict[str, float]:
    """Return the figures of a tick, units in their names; `cells` of the map."""
    telemetry = state.telemetry
    figures = {
        "tick, mean [ms CPU]": 1e3 * timing.tick_s,
        "tick, longest [ms CPU]": 1e3 * timing.longest_tick_s,
        "late ticks": float(timing.late),
        "time lost [s]": timing.lost_s,
        "forward line [V]": state.sent.forward_volts,
        "turn line [V]": state.sent.turn_volts,
        "plans of this drive": float(state.navigation.plans),
        "contacts": float(contacts),
        "cells of the map": float(cells),
        "memory, peak [MB]": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
    }
    if telemetry is not None and telemetry.round_trip_ns is not None:
        figures["board, round trip [ms]"] = telemetry.round_trip_ns * 1e-6
    return figures
