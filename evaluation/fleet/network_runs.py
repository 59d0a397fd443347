"""Runs of graph chairs over a seeded network, and deliberate bugs in each rule, which the runs have to find."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from waychair.errors import WaychairError
from waychair.maps.traffic.corridors import corridor_graph, load_corridors
from waychair.planning.fleet.peers import alone, claims, election, networked_warden, peer
from waychair.planning.fleet.peers.messages import Answer, Letter, State
from waychair.planning.fleet.warden import Report
from waychair.simulation.network import NetworkFaults
from waychair.trials.fleet import fleet_networked
from waychair.trials.fleet.fleet_invariants import Invariants, summary, troubles
from waychair.trials.fleet.fleet_networked import TICK_MS, NetworkedChairs

PLANS = ("T", "I", "2bconR", "Rectangle", "3tie", "4cross", "9cube", "2d-grid")
MINUTES = 10.0
FEWEST, MOST = 3, 8


class NetworkRun(NamedTuple):
    """The result of one seed; `digest` is a hash of all bytes sent."""

    seed: int
    faults: tuple[str, ...]
    arrivals: int
    without_warden_s: float
    digest: str
    cpu_s: float


def network_run(seed: int) -> NetworkRun:
    """Let 3 to 8 chairs drive for ten minutes among people, over a network with all its troubles."""
    rng = np.random.default_rng([seed, 0x5EED])
    graph = corridor_graph(load_corridors(PLANS[seed % len(PLANS)]), rooms=True, bays=bool(rng.random() < 0.5))
    chairs = int(rng.integers(FEWEST, MOST + 1))
    faults = NetworkFaults(
        loss=float(rng.uniform(0.0, 0.2)),
        doubled=float(rng.uniform(0.0, 0.2)),
        delay_ms=float(rng.uniform(1.0, 80.0)),
        late=0.02,
        drift_ppm=200.0,
    )
    begun = time.process_time()
    world = NetworkedChairs(graph, chairs, seed, faults, troubles(chairs, seed))
    watch = Invariants()
    world.run(round(MINUTES * 60_000), watch)
    watch.end(world)
    found = summary(world, watch)
    return NetworkRun(
        seed,
        tuple(watch.faults),
        int(found["arrivals"]),
        found["without_warden_s"],
        world.sent.hexdigest(),
        time.process_time() - begun,
    )


def warden_killed(seed: int) -> float:
    """Return how long [s] nobody orders after the warden was killed at a random moment; infinite if for good."""
    rng = np.random.default_rng([seed, 0xDEAD])
    graph = corridor_graph(load_corridors("T"), rooms=True)
    world = NetworkedChairs(graph, int(rng.integers(FEWEST, MOST + 1)), seed, NetworkFaults(loss=0.02, drift_ppm=200.0))
    world.run(int(rng.integers(8_000, 40_000)))
    granting = [chair for chair in world.chairs.values() if chair.peer is not None and chair.peer.grants]
    if not granting:
        return math.inf
    granting[0].peer = None
    begun_ms = world.now_ms
    while world.now_ms - begun_ms < 20_000:
        world.run(world.now_ms + TICK_MS)
        if any(chair.peer is not None and chair.peer.grants for chair in world.chairs.values()):
            return (world.now_ms - begun_ms) / 1e3
    return math.inf


@dataclass(frozen=True, slots=True)
class Mutant:
    """A deliberate bug: the rule that it breaks, and the attribute that it puts something else for."""

    rule: str
    place: Any
    name: str
    bug: Any


@contextmanager
def with_bug(mutant: Mutant) -> Iterator[None]:
    """Put a bug in place."""
    right = getattr(mutant.place, mutant.name)
    setattr(mutant.place, mutant.name, mutant.bug)
    try:
        yield
    finally:
        setattr(mutant.place, mutant.name, right)


def killed_by(mutant: Mutant, seeds: range) -> int | None:
    """Return the first seed whose run finds a bug, None if none does."""
    with with_bug(mutant):
        for seed in seeds:
            try:
                if network_run(seed).faults:
                    return seed
            except (AssertionError, AttributeError, LookupError, TypeError, ValueError, WaychairError):
                return seed
    return None


def _report_of_all(order: Any, number: int, each: Any) -> Report:
    """Everything that a chair wants counts as free."""
    chain = order.chains[number]
    found = _right_report(order, number, each)
    more = max(min(each.state.visit + each.state.wants - chain.visit, len(chain.spots) - 1), 0)
    return replace(found, visits=chain.visit + more, behind=found.behind + more - (found.visits - chain.visit))


def _report_without_rear(order: Any, number: int, each: Any) -> Report:
    """A rear counts as gone as soon as the front has entered the next spot."""
    found = _right_report(order, number, each)
    return replace(found, behind=max(found.visits - each.state.visit, 0))


def _claim_of_front(state: State, with_released: bool) -> claims.Claim | None:
    return claims.Claim(state.entered[-1:], state.visit, state.ready_ms) if state.entered else None


def _answer_of_any_term(self: Any, letter: Letter, answer: Answer) -> None:
    """An answer of any warden, to any boot and stance, is taken."""
    if answer.chair == self.number:
        self._heard.answer = answer


def _state_out_of_order(self: Any, letter: Letter, state: State, now_ns: int) -> None:
    self._heard.known[letter.sender] = election.Known(letter.sender, letter.boot, letter.sent_ns, now_ns, state)


def _way_unseen(ways: Any, front: int, goal: str, taken: Any) -> tuple[int, ...]:
    return _right_way(ways, front, goal, ())


def _first_of_all(own: Any, before: Any, known: Any, now_ns: int) -> Any:
    """Every peer follows the first that it hears, at once, and forgets that it followed another one."""
    fresh = election.Allegiance(before.term if before.term and before.term.warden == own.number else None)
    return _right_followed(own, fresh, known, now_ns)


_right_report: Callable[..., Report] = networked_warden._report
_right_way: Callable[..., tuple[int, ...]] = alone.way_by_eye
_right_followed: Callable[..., Any] = election.followed

MUTANTS = (
    Mutant("a majority is more than half", networked_warden, "is_majority", lambda electorate, voters: True),
    Mutant("a chair enters first in its queue", networked_warden, "_report", _report_of_all),
    Mutant("a spot is taken until the rear has left", networked_warden, "_report", _report_without_rear),
    Mutant("a warden takes over all that chairs hold", networked_warden, "claim_of", _claim_of_front),
    Mutant(
        "a chair that keeps no order stays taken", networked_warden, "_with_closed", lambda office, state, now: state
    ),
    Mutant("what was not entered is given back", peer.Peer, "_give_back", lambda self: None),
    Mutant("an answer is for one boot, stance and term", peer.Peer, "_take_answer", _answer_of_any_term),
    Mutant("an older State is nothing", peer.Peer, "_take_state", _state_out_of_order),
    Mutant("who misses a chair looks", peer.Peer, "_misses_somebody", lambda self, now_ns: False),
    Mutant("alone mode is announced", peer, "ANNOUNCED_NS", -1),
    Mutant("alone mode looks first", fleet_networked, "way_by_eye", _way_unseen),
    Mutant("a peer follows one warden at a time", peer, "followed", _first_of_all),
    Mutant("there is an alone mode and a way back", peer.Peer, "_is_passed", lambda self, now_ns: False),
    Mutant("a silent chair is missed", networked_warden, "SILENT_NS", 10**12),
)
"""A bug in each rule."""
