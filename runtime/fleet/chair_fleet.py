"""The fleet of a real chair, from `waychair up --fleet` to its navigator's process: by the environment, as paths are told."""

from __future__ import annotations

import os
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from waychair.errors import FleetError, MissingExtra
from waychair.install_advice import install_command
from waychair.planning.fleet.peers.peer import Fleet
from waychair.runtime.fleet.audit_file import AuditFile
from waychair.runtime.fleet.fleet_file import FleetFile, load_fleet, open_to_lan
from waychair.runtime.fleet.network.fleet_keys import checked_keys
from waychair.runtime.fleet.network.peer_process import fleet_of, load_planner
from waychair.runtime.fleet.network.zenoh_transport import ZenohTransport

FLEET, LAN = "WAYCHAIR_FLEET", "WAYCHAIR_FLEET_LAN"
"""Environment variables with the path of the fleet's file, and 1 where the chair talks to other computers."""


class ChairFleet(NamedTuple):
    """A chair's part of its fleet: the knowledge of all, its number, its end of the network, its log, and the file of its electorate."""

    fleet: Fleet
    number: int
    transport: ZenohTransport
    log: AuditFile | None
    memory: Path | None


def fleet_environment(path: Path, lan: bool) -> dict[str, str]:
    """Return the variables for a chair's navigator, after all checks that need no network.

    Raises:
        FleetError: the file, its number or its keys are wrong.
        TrafficError: the building's traffic graph is missing or damaged.
        MissingExtra: the extra [fleet] is not installed.
    """
    file = _chairs_file(path)
    open_to_lan(file, lan)
    if file.keys is not None:
        checked_keys(file.keys, file.name(file.number))
    file.traffic_graph()
    if find_spec("zenoh") is None:
        raise MissingExtra(f"chairs that talk need the extra [fleet]: {install_command('fleet')}")
    return {FLEET: str(path.resolve()), LAN: "1" if lan else ""}


def joined_fleet(environment: Mapping[str, str] = os.environ) -> ChairFleet:
    """Return the fleet of the environment, joined.

    Raises as `fleet_environment`, and FleetError where a port is taken, or the log cannot be opened.
    """
    path = environment.get(FLEET, "")
    if not path:
        raise FleetError(f"no fleet is named: give `waychair up --fleet`, or set {FLEET}")
    file = _chairs_file(Path(path))
    fleet = fleet_of(file)
    load_planner(fleet)
    log = None if file.log is None else AuditFile(file.log)
    transport = ZenohTransport(file, fleet.building, lan=environment.get(LAN) == "1")
    return ChairFleet(fleet, file.number, transport, log, file.electorate)


def _chairs_file(path: Path) -> FleetFile:
    file = load_fleet(path)
    if file.number not in file.chairs:
        raise FleetError(
            f"{path}: number {file.number} is a voter's: give the number of this chair, one of {list(file.chairs)}"
        )
    return file
