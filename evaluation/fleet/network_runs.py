"""Runs of graph chairs over a seeded network, and deliberate bugs in each rule, which the runs have to find."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import msgspec
import numpy as np

from waychair.errors import WaychairError
from waychair.maps.traffic.corridors import corridor_graph, load_corridors
from waychair.planning.fleet.peers import alone, claims, election, memory, networked_warden, peer
from waychair.planning.fleet.peers.messages import ALONE, Electorate, Letter, State
from waychair.planning.fleet.warden import ChairReport
from waychair.simulation.network import NetworkFaults
from waychair.trials.fleet import fleet_networked, fleet_situations
from waychair.trials.fleet.fleet_invariants import Invariants, storm, summary, troubles
from waychair.trials.fleet.fleet_networked import TICK_MS, NetworkedChairs
from waychair.trials.fleet.fleet_situations import SITUATIONS

PLANS = ("T", "I", "2bconR", "Rectangle", "3tie", "4cross", "9cube", "2d-grid")
MINUTES = 10.0
STORM_MINUTES, STORM_WISH_MS = 5.0, 120_000
"""Length of a run in which the links change every few seconds, and ms until its last wishes."""

ARRIVES_MS = 300_000
"""ms within which those who are still under way then have to arrive: the plans are up to 190 m long, and people stop chairs."""

FEWEST, MOST = 3, 8


class NetworkRun(NamedTuple):
    """The result of one seed; `digest` is a hash of all bytes sent."""

    seed: int
    faults: tuple[str, ...]
    arrivals: int
    without_warden_s: float
    digest: str
    cpu_s: float


def storm_run(seed: int) -> NetworkRun:
    """Return a run in which the links change every few seconds."""
    return network_run(seed, stormy=True)


def network_run(seed: int, stormy: bool = False) -> NetworkRun:
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
    minutes = STORM_MINUTES if stormy else MINUTES
    if stormy:
        world = NetworkedChairs(graph, chairs, seed, faults, storm(chairs, seed, STORM_WISH_MS), STORM_WISH_MS)
    else:
        world = NetworkedChairs(graph, chairs, seed, faults, troubles(chairs, seed))
    watch = Invariants()
    world.run(round(minutes * 60_000), watch)
    until_ms = world.now_ms + ARRIVES_MS
    while world.now_ms < until_ms and any(chair.wish is not None for chair in world.chairs.values()):
        world.run(world.now_ms + 1_000, watch)
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
    """Put a bug in place, in every module of the peers that knows the rule by this name."""
    right = getattr(mutant.place, mutant.name)
    modules = (alone, claims, election, memory, networked_warden, peer)
    places = [mutant.place, *(each for each in modules if getattr(each, mutant.name, None) is right)]
    for place in places:
        setattr(place, mutant.name, mutant.bug)
    try:
        yield
    finally:
        for place in places:
            setattr(place, mutant.name, right)


def killed_by(mutant: Mutant, seeds: range) -> int | None:
    """Return the first seed whose runs or situations find a bug, None if none does."""
    with with_bug(mutant):
        for seed in seeds:
            try:
                if any(faults(seed) for faults in (*SITUATIONS, _storm_faults, _run_faults)):
                    return seed
            except (AssertionError, AttributeError, LookupError, TypeError, ValueError, WaychairError):
                return seed
    return None


def situations_run(seed: int) -> tuple[str, ...]:
    """Return the faults of all situations, each with the name of its situation and the seed."""
    return tuple(f"{each.__name__}, seed {seed}: {said}" for each in SITUATIONS for said in each(seed))


def _storm_faults(seed: int) -> tuple[str, ...]:
    return storm_run(seed).faults


def _run_faults(seed: int) -> tuple[str, ...]:
    return network_run(seed).faults


def _report_of_all(order: Any, number: int, each: Any) -> ChairReport:
    """Everything that a chair wants counts as free."""
    chain = order.chains[number]
    found = _right_report(order, number, each)
    more = max(min(each.state.visit + each.state.wants - chain.visit, len(chain.spots) - 1), 0)
    return replace(found, visits=chain.visit + more, behind=found.behind + more - (found.visits - chain.visit))


def _report_without_rear(order: Any, number: int, each: Any) -> ChairReport:
    """A rear counts as gone as soon as the front has entered the next spot."""
    found = _right_report(order, number, each)
    return replace(found, behind=max(found.visits - each.state.visit, 0))


def _kept_front(order: Any, chair: int, now_ms: int) -> claims.Claim:
    """A chair that keeps its stance claims its last spot only."""
    right = _right_kept(order, chair, now_ms)
    return replace(right, spots=right.spots[-1:])


def _all_that_are_heard(own: Any, term: Any, known: Any, now_ns: int) -> set[int]:
    """Everybody who is heard counts as a follower."""
    fresh = {number for number, each in known.items() if now_ns - each.heard_ns < election.FOLLOWED_NS}
    return {own.number, *fresh}


def _followers_for_ever(own: Any, term: Any, known: Any, now_ns: int) -> set[int]:
    """Everybody who has ever followed counts as a follower."""
    return {own.number, *(number for number, each in known.items() if each.state.follows == term)}


def _next_epoch(own: Any, before: Any, known: Any) -> Any:
    """The epochs of two wardens can be equal."""
    right = _right_standing(own, before, known)
    return replace(right, term=msgspec.structs.replace(right.term, epoch=right.term.epoch // election.EPOCHS))


def _alone_at_once(self: Any, now_ns: int, own: Any) -> None:
    """A chair without a warden drives by its own eyes at once, and tells nobody before."""
    _right_mode(self, now_ns, own)
    if not self.has_warden():
        self._times.alone = now_ns - peer.ANNOUNCED_NS
        self._mode = ALONE


def _authority_unseen(self: Any, now_ns: int, own: Any) -> Any:
    """Nobody looks before it enters."""
    return replace(_right_authority(self, now_ns, own), look=False)


def _state_out_of_order(self: Any, letter: Letter, state: State, now_ns: int) -> None:
    self.known[letter.sender] = election.Known(letter.sender, letter.boot, letter.sent_ns, now_ns, state)


def _way_unseen(ways: Any, front: int, goal: str, taken: Any) -> tuple[int, ...]:
    return _right_way(ways, front, goal, ())


def _first_of_all(own: Any, before: Any, known: Any, now_ns: int) -> Any:
    """Every peer follows the first that it hears, at once, and forgets that it followed another one."""
    fresh = election.Allegiance(before.term if before.term and before.term.warden == own.number else None)
    return _right_followed(own, fresh, known, now_ns)


def _electorate_at_once(own: Any, term: Any, known: Any, followed_by: Any) -> Any:
    """All who are parked leave at once, and all who are back come, whoever knows the electorate before."""
    away = {number for number, each in known.items() if each.state.parked}
    members = tuple(sorted((set(own.electorate.members) | set(followed_by)) - away)) or own.electorate.members
    if members == own.electorate.members and own.electorate.epoch == term.epoch:
        return None
    change = own.electorate.change + 1 if own.electorate.epoch == term.epoch else 0
    return Electorate(term.epoch, change, members)


def _followed_in_any_electorate(own: Any, before: Any, known: Any, now_ns: int) -> Any:
    """Everybody counts as knowing the same electorate."""
    version = own.electorate.version
    abreast = {
        number: replace(each, state=msgspec.structs.replace(each.state, electors=version))
        for number, each in known.items()
    }
    return _right_followed(own, before, abreast, now_ns)


def _peer_that_forgets(fleet: Any, number: int, boot: int, electorate: Any) -> peer.Peer:
    """A peer begins with everybody each time it starts."""
    return peer.Peer(fleet, number, boot)


_right_report: Callable[..., ChairReport] = networked_warden._report
_right_kept: Callable[..., claims.Claim] = claims.kept
_right_way: Callable[..., tuple[int, ...]] = alone.way_by_eye
_right_followed: Callable[..., Any] = election.followed
_right_standing: Callable[..., Any] = election.standing
_right_mode: Callable[..., None] = peer.Peer._choose_mode
_right_authority: Callable[..., Any] = peer.Peer._authority

MUTANTS = (
    Mutant("a majority is more than half", networked_warden, "is_majority", lambda electorate, voters: True),
    Mutant("a warden counts those who follow it", networked_warden, "followers", _all_that_are_heard),
    Mutant("a warden counts followers for a second", networked_warden, "followers", _followers_for_ever),
    Mutant("a peer follows one warden at a time", peer, "followed", _first_of_all),
    Mutant("no two wardens have one epoch", election, "standing", _next_epoch),
    Mutant("a warden that cannot be followed begins a new epoch", peer.Peer, "_is_passed", lambda self, now_ns: False),
    Mutant("an electorate changes by one", networked_warden, "next_electorate", _electorate_at_once),
    Mutant("nobody follows in an older electorate", peer, "followed", _followed_in_any_electorate),
    Mutant("an electorate outlives a restart", fleet_situations, "Peer", _peer_that_forgets),
    Mutant("a chair enters first in its queue", networked_warden, "_report", _report_of_all),
    Mutant("a spot is taken until the rear has left", networked_warden, "_report", _report_without_rear),
    Mutant("a warden begins again from all that chairs hold", networked_warden, "kept", _kept_front),
    Mutant("a chair without order stays taken", networked_warden, "_with_closed", lambda office, state, now: state),
    Mutant("what was not entered is given back", peer.Peer, "_give_back", lambda self: None),
    Mutant("an older State is nothing", memory.HeardOthers, "take_state", _state_out_of_order),
    Mutant("a silent chair is missed", networked_warden, "SILENT_NS", 10**12),
    Mutant("a chair that misses another one looks", peer.Peer, "_authority", _authority_unseen),
    Mutant("alone mode is announced", peer.Peer, "_choose_mode", _alone_at_once),
    Mutant("alone mode looks first", fleet_networked, "way_by_eye", _way_unseen),
)
"""A bug in each rule."""
