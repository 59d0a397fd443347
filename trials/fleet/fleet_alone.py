"""Two whole chairs in one run that cannot hear each other: each drives by its own eyes, and one backs out for the other."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.simulation.network import NetworkFaults, SeededNetwork
from waychair.simulation.scene.seeds import seed_from_names
from waychair.trials.fleet.fleet_drive import FleetRun, drive_fleet
from waychair.trials.fleet.fleet_over_network import NetworkedRiders, over_network
from waychair.trials.fleet.fleet_scenes import SCENARIOS

SCENES = ("shared_run", "swap_in_t")
"""Scenes of two chairs whose ways lead through one run, in both directions, with a person about."""

LONGEST_S = 420.0
"""s of a run: at 0.3 m/s, with one chair that waits aside."""

TOGETHER_AT_S = (60.0, 150.0)
"""s between which the network is whole again in every other run."""


@dataclass(slots=True)
class AloneRun:
    """The drives of two chairs that were cut off from each other from the start.

    Attributes:
        run: contacts, arrivals, times.
        alone_s: from a chair's first wish until it drove by its own eyes, the longest.
        together_s: from the network's return until no chair drove by its own eyes any more; nan where it did not return.
        backed_out: times that each chair has backed out.
    """

    run: FleetRun
    alone_s: float
    together_s: float
    backed_out: tuple[int, ...]


@dataclass(slots=True)
class _Watch:
    """The times [ms] of changes between the order and the own eyes."""

    heal_ms: int | None
    wished: dict[int, int] = field(default_factory=dict)
    alone: dict[int, int] = field(default_factory=dict)
    together: int | None = None
    riders: NetworkedRiders | None = None

    def cut(self, now_ms: int, network: SeededNetwork) -> None:
        if self.heal_ms is not None and now_ms >= self.heal_ms:
            network.heal()
        else:
            network.part([[0]])

    def __call__(self, now_ms: int, riders: NetworkedRiders) -> None:
        self.riders = riders
        for number, driver in riders.drivers.items():
            if riders.wishes(number):
                self.wished.setdefault(number, now_ms)
            if driver.authority.alone:
                self.alone.setdefault(number, now_ms)
        is_whole = self.heal_ms is not None and now_ms >= self.heal_ms
        if is_whole and self.together is None and not any(each.authority.alone for each in riders.drivers.values()):
            self.together = now_ms


def drive_alone(seed: int) -> AloneRun:
    """Let two chairs that cannot hear each other drive through one run, each to its goal."""
    dice = np.random.default_rng(seed_from_names("fleet alone", "cut", seed))
    scenario = SCENARIOS[SCENES[seed % len(SCENES)]](seed)
    heals = round(1e3 * float(dice.uniform(*TOGETHER_AT_S))) if seed // len(SCENES) % 2 else None
    watch = _Watch(heals)
    keeper = over_network(NetworkFaults(loss=0.05, delay_ms=10.0, drift_ppm=200.0), watch.cut, watch)
    run = drive_fleet(replace(scenario.scene, time_limit_s=LONGEST_S), keeper=keeper)
    assert watch.riders is not None
    alone_ms = [watch.alone[number] - since for number, since in watch.wished.items() if number in watch.alone]
    together_s = math.nan if watch.together is None or heals is None else (watch.together - heals) / 1e3
    backed_out = tuple(driver.alone.retreats for driver in watch.riders.drivers.values())
    return AloneRun(run, max(alone_ms, default=0) / 1e3, together_s, backed_out)
