"""A site's `fleet.yaml`: which chairs share a building, which one this is, and how they reach each other.

building: ward.traffic      # a traffic graph's file, or the name of a shipped floor plan
number: 2                   # of this chair
chairs: [1, 2, 3]
voters: [9]                 # computers without a chair that vote
endpoints: []               # of others; none: all on this computer
listen: ""                  # own endpoint; none: loopback
keys: ""                    # folder of `waychair fleet keys new`; needed beyond this computer
log: ""                     # file to which this peer adds the waits under its order; none: they are not kept
"""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from waychair.errors import FleetError
from waychair.files import is_file, read_bytes
from waychair.maps.traffic.corridors import corridor_graph, floor_plan_names, load_corridors
from waychair.maps.traffic.traffic_files import read_traffic
from waychair.maps.traffic.traffic_graph import TrafficGraph

FIRST_PORT = 7450
"""Peer n of a computer listens on this port and n more; Zenoh's own routers use 7447."""

MOST_NUMBER = 999
"""The highest number of a chair; ports follow it."""


class _FleetYaml(msgspec.Struct, forbid_unknown_fields=True):
    building: str
    number: int
    chairs: list[int]
    voters: list[int] = []
    endpoints: list[str] = []
    listen: str = ""
    keys: str = ""
    log: str = ""


@dataclass(frozen=True, slots=True)
class FleetFile:
    """See the module's example; `keys` and `log` are None where there are none.

    `folder` is the one of the file itself; None for one that was never read.
    """

    building: str
    number: int
    chairs: tuple[int, ...]
    voters: tuple[int, ...] = ()
    endpoints: tuple[str, ...] = ()
    listen: str = ""
    keys: Path | None = None
    log: Path | None = None
    folder: Path | None = None

    @property
    def electorate(self) -> Path | None:
        """The file in which this peer keeps the peers that are counted, see `electorate_file.py`; None: it is not kept."""
        return None if self.folder is None else self.folder / f"electorate{self.number}.json"

    def name(self, number: int) -> str:
        """Return the name of a peer on the network and in its certificate."""
        return f"chair{number}" if number in self.chairs else f"voter{number}"

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all peers."""
        return tuple(self.name(number) for number in (*self.chairs, *self.voters))

    @property
    def own_endpoint(self) -> str:
        """The endpoint at which this peer listens."""
        return self.listen or f"tcp/127.0.0.1:{FIRST_PORT + self.number}"

    @property
    def other_endpoints(self) -> tuple[str, ...]:
        """The endpoints at which it looks for others."""
        if self.endpoints:
            return self.endpoints
        others = [number for number in (*self.chairs, *self.voters) if number != self.number]
        return tuple(f"tcp/127.0.0.1:{FIRST_PORT + number}" for number in others)

    def traffic_graph(self) -> TrafficGraph:
        """Return the traffic graph of the building.

        Raises:
            TrafficError: there is none, or it is damaged.
        """
        if self.building in floor_plan_names():
            return corridor_graph(load_corridors(self.building), rooms=True)
        return read_traffic(Path(self.building))


def load_fleet(path: Path) -> FleetFile:
    """Return a fleet's file; relative paths in it are beside it.

    Raises:
        FleetError: it cannot be read or is impossible; the message says what to do.
    """
    if not is_file(path, FleetError):
        raise FleetError(f"there is no fleet file {path}: write one with building, number and chairs")
    try:
        found = msgspec.yaml.decode(read_bytes(path, FleetError), type=_FleetYaml)
    except msgspec.MsgspecError as problem:
        raise FleetError(f"{path} is no fleet file: {problem}; give building, number and chairs") from None
    building = found.building
    if building not in floor_plan_names() and not Path(building).is_absolute():
        building = str(path.parent / building)
    fleet = FleetFile(
        building,
        found.number,
        tuple(found.chairs),
        tuple(found.voters),
        tuple(found.endpoints),
        found.listen,
        path.parent / found.keys if found.keys else None,
        path.parent / found.log if found.log else None,
        path.parent,
    )
    try:
        return checked_fleet(fleet)
    except FleetError as problem:
        raise FleetError(f"{path}: {problem}") from None


def checked_fleet(fleet: FleetFile) -> FleetFile:
    """Return a fleet's file after its checks.

    Raises:
        FleetError: numbers come twice or are out of range, or this peer's number is none of them.
    """
    numbers = (*fleet.chairs, *fleet.voters)
    if not fleet.chairs:
        raise FleetError("no chair is named: give chairs, for instance [1, 2, 3]")
    for number in numbers:
        if not 1 <= number <= MOST_NUMBER:
            raise FleetError(f"a chair has the number {number}: give numbers from 1 to {MOST_NUMBER}")
        if numbers.count(number) > 1:
            raise FleetError(f"the number {number} comes twice: give each chair and voter a number of its own")
    if fleet.number not in numbers:
        raise FleetError(
            f"number {fleet.number} is neither a chair nor a voter: add it, or give one of {list(numbers)}"
        )
    for endpoint in (fleet.own_endpoint, *fleet.other_endpoints):
        protocol, _, address = endpoint.partition("/")
        if protocol not in ("tcp", "tls") or not address.rpartition(":")[2].isdigit():
            raise FleetError(f"'{endpoint}' is no endpoint: write for instance tls/192.0.2.7:7450")
    return fleet


def open_to_lan(fleet: FleetFile, lan: bool) -> FleetFile:
    """Return the fleet if it keeps to this computer, or may leave it: with keys, and encrypted throughout.

    Raises:
        FleetError: an endpoint is beyond this computer, and `lan` was not asked for or is not secured.
    """
    endpoints = (fleet.own_endpoint, *fleet.other_endpoints)
    beyond = [endpoint for endpoint in endpoints if not is_loopback(endpoint)]
    if not lan:
        if beyond:
            raise FleetError(f"{beyond[0]} is beyond this computer: give --lan, and keys (waychair fleet keys new)")
        return fleet
    if fleet.keys is None:
        raise FleetError(
            "--lan needs keys: make them with `waychair fleet keys new`, and name their folder in the file"
        )
    if plain := [endpoint for endpoint in endpoints if not endpoint.startswith("tls/")]:
        raise FleetError(f"{plain[0]} is not encrypted: write tls/ for tcp/ at all endpoints, and give `listen`")
    return fleet


def is_loopback(endpoint: str) -> bool:
    """Return whether an endpoint is reached from this computer only."""
    host = endpoint.partition("/")[2].rpartition(":")[0].strip("[]")
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def as_number(fleet: FleetFile, number: int) -> FleetFile:
    """Return the file as another peer of the same computer reads it."""
    return checked_fleet(replace(fleet, number=number))
