"""The runtime of behaviour networks beside the plain interpreter: every port of every cell at every innervation."""

from __future__ import annotations

import math
import random
from typing import Any

from evaluation.behaviours.plain_cells import PlainCells
from evaluation.behaviours.random_networks import SENSORS, random_network, random_values
from waychair.control.behaviours.cell_network import wire
from waychair.control.behaviours.runtime import Innervation, Runtime

LITERAL_EVERY = 4
"""One network in so many runs with the printed text of step 1."""


def differing_ports(seed: int, innervations: int) -> tuple[int, int, list[str]]:
    """Return the number of ports compared and of those that differ, and the first ones by name."""
    network, rng = random_network(seed), random.Random(seed + 1_000_003)
    literal = seed % LITERAL_EVERY == 0
    runtime, plain = Runtime(wire(network, SENSORS), literal=literal), PlainCells(network, SENSORS, literal)
    compared, differing, named, now_ns = 0, 0, list[str](), 0
    for k in range(innervations):
        now_ns += rng.choice([50_000_000, 50_000_000, 50_000_000, 10_000_000, 700_000_000])
        heard = random_values(rng, now_ns)
        done = runtime.innervate(now_ns, heard)
        plain.innervate(now_ns, heard)
        count, wrong = _compared(done, plain)
        compared, differing = compared + count, differing + len(wrong)
        named += [f"seed {seed}, innervation {k}: {each}" for each in wrong][: 5 - len(named)]
    return compared, differing, named


def _compared(done: Innervation, plain: PlainCells) -> tuple[int, list[str]]:
    wrong = [] if list(done.ran) == plain.at.order else [f"the order {done.ran} and {plain.at.order}"]
    for name, port in done.ports.items():
        shown = plain.shown(name)
        pairs = (
            ("EB", port.eb, plain.at.EB.get(name)),
            ("IB", port.ib, plain.at.IB.get(name)),
            ("RS", port.rs, None if port.rs is None else plain.at.RS[name]),
            ("AB", port.ab, plain.AB[name]),
            ("EO", port.eo, plain.EO[shown]),
            ("stamp", port.eo_stamp_ns, plain.written[shown]),
            ("fault", port.fault, plain.trouble[name].fault),
        )
        wrong += [
            f"{label} of {name}: {first} and {second}" for label, first, second in pairs if _differ(first, second)
        ]
    if any(_differ(done.actions.get(name), plain.at.AO.get(name)) for name in {*done.actions, *plain.at.AO}):
        wrong.append(f"AO: {dict(done.actions)} and {plain.at.AO}")
    return 7 * len(done.ports) + 1, wrong


def _differ(first: Any, second: Any) -> bool:
    """Return whether two values differ; nan is equal to nan."""
    if type(first) is not type(second):
        return True
    both_nan = isinstance(first, float) and math.isnan(first) and math.isnan(second)
    return not (both_nan or first == second)
