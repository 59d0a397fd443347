"""A peer's process: ten steps a second, and one at once when a Request or an Answer has come."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module

from waychair.calibration.chair_body import CHAIR_A
from waychair.planning.fleet.peers.election import ranked
from waychair.planning.fleet.peers.messages import building_of
from waychair.planning.fleet.peers.peer import Fleet, Own, Peer, PeerStep
from waychair.planning.fleet.ways import ways_of
from waychair.runtime.fleet.audit_file import AuditFile
from waychair.runtime.fleet.chain_geometry import drivable
from waychair.runtime.fleet.electorate_file import kept_electorate
from waychair.runtime.fleet.fleet_file import FleetFile
from waychair.runtime.fleet.network.zenoh_transport import ZenohTransport
from waychair.runtime.fleet.peer_post import PeerPost

SPEED = 0.45
"""m/s; mean speed of a chair from room to room, by which the warden foresees times."""

STEP_S = 0.1

PARKED_NS = 500_000_000
"""A peer that ends in good order says for so long that it is parked, so that it is not counted any more."""

LOADED_AT_ONCE = 2
"""Peers that load the warden's planner when they start: the first warden, and the next one. It takes 60 MB, and a few seconds."""

Beside = Callable[[int, list[tuple[int, bytes]], ZenohTransport], None]
"""A call beside a peer's step: the time [ns], the messages with the numbers of their senders, and the peer's transport."""


def fleet_of(file: FleetFile) -> Fleet:
    """Return what all peers of a site know; each of them plans for chairs of body A.

    Raises:
        TrafficError: the building's traffic graph is missing or damaged.
    """
    graph = file.traffic_graph()
    ways = drivable(ways_of(graph, SPEED), CHAIR_A)
    return Fleet(building_of(graph), ways, frozenset(file.chairs), frozenset(file.voters))


def load_planner(fleet: Fleet) -> None:
    """Load the warden's planner now: later the first Request, or the take-over from a warden that is gone, would wait for it."""
    import_module("waychair.planning.fleet.peers.networked_warden")
    import_module("waychair.planning.fleet.warden").warm_up(fleet.ways)


def new_boot() -> int:
    """Return a random number for a start of the program."""
    return int.from_bytes(os.urandom(7), "big") + 1


def clock_ns() -> int:
    """Return a monotonic clock that runs while the computer sleeps, so that leases lapse."""
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME)


def beside_nothing(now_ns: int, heard: list[tuple[int, bytes]], transport: ZenohTransport) -> None:
    """Do nothing beside a peer's step."""


def serve(
    file: FleetFile,
    lan: bool,
    stopped: Callable[[], bool],
    own: Callable[[], Own] = Own,
    told: Callable[[PeerStep], None] = lambda step: None,
    mode: str = "peer",
    beside: Beside = beside_nothing,
) -> None:
    """Be a peer of a fleet until `stopped`, and say so then; a voter without a chair has nothing of its `own`.

    `told` hears each step: its authority and notices. `beside` is called after each step with all messages, the own ones among
    them, to speak and hear beside the peer.

    Raises:
        FleetError: the network cannot be joined, or the log not be opened.
        TrafficError: the building's traffic graph is missing or damaged.
        MissingExtra: the extra [fleet] is not installed.
    """
    fleet = fleet_of(file)
    if file.number in ranked(fleet.district, fleet.numbers)[:LOADED_AT_ONCE]:
        load_planner(fleet)
    peer = Peer(fleet, file.number, new_boot(), electorate=kept_electorate(file.electorate, fleet.numbers))
    log = None if file.log is None else AuditFile(file.log)
    transport = ZenohTransport(file, fleet.building, lan, mode)
    post = PeerPost(transport, log, file.electorate)
    ends_ns: int | None = None
    try:
        while ends_ns is None or clock_ns() < ends_ns:
            if ends_ns is None and stopped():
                ends_ns = clock_ns() + PARKED_NS
            now_ns, heard = post.begin(clock_ns()), transport.received()
            step = peer.step(now_ns, replace(own(), parked=ends_ns is not None), heard)
            told(replace(step, notices=post.pass_on(step)))
            beside(now_ns, [*heard, *((file.number, data) for to, _, data in step.send if to is None)], transport)
            transport.wait(STEP_S)
    finally:
        transport.close()
        if log is not None:
            log.close()
