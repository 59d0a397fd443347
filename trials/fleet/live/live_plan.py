"""The plan of a simulated fleet of processes, in a file that all of them read: scene, ports, and each one's fleet file."""

from __future__ import annotations

import json
import socket
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from waychair.errors import FleetError
from waychair.files import write_json, write_text
from waychair.maps.traffic.traffic_files import write_traffic
from waychair.runtime.fleet.fleet_file import FleetFile, load_fleet

if TYPE_CHECKING:
    from waychair.trials.fleet.fleet_drive import FleetScene

PLAN = "live.json"

WORLD = "world"
"""Name of the world's program."""

GONE_S = 1.0
"""s without a word after which a program counts as gone that the bus knows no more."""

DESK = 90
"""Number of the voter on whose computer the staff's page is."""

ROUTER = 91
"""Number of the router through which chairs talk that cannot reach each other."""


@dataclass(frozen=True, slots=True)
class LivePlan:
    """A fleet of processes: the scene's world, chairs and seed, and the ports on this computer.

    `bus`: where the programs of the simulation are joined. `ports` are those of the peers, by their numbers. With `routed`
    the chairs talk through a router only.
    """

    world: str
    chairs: int
    seed: int
    bus: int
    ports: dict[str, int]
    voters: tuple[int, ...] = ()
    routed: bool = False

    @property
    def numbers(self) -> range:
        """The numbers of the chairs."""
        return range(1, self.chairs + 1)

    @property
    def mode(self) -> str:
        """How chairs join their network."""
        return "client" if self.routed else "peer"

    def scene(self) -> FleetScene:
        """Return the scene, the same in every process."""
        # late: it takes 100 MB, for which a peer without a chair has no use
        from waychair.trials.fleet.fleet_demo import demo_scene

        return demo_scene(self.world, self.chairs, self.seed)


def new_plan(
    folder: Path, world: str, chairs: int, seed: int, voters: Sequence[int] = (), routed: bool = False
) -> LivePlan:
    """Return a plan with free ports, and write it and all fleet files into a folder.

    Raises:
        OutputError: the folder cannot be written.
        TrafficError: there is no such world.
    """
    every = (*voters, ROUTER) if routed else tuple(voters)
    numbers = [*range(1, chairs + 1), *every]
    bus, *ports = _free_ports(len(numbers) + 1)
    by_number = dict(zip(map(str, numbers), ports, strict=True))
    plan = LivePlan(world, chairs, seed, bus, by_number, every, routed)
    graph = plan.scene().graph
    folder.mkdir(parents=True, exist_ok=True)
    write_traffic(folder / "building.traffic", graph)
    for number in numbers:
        others = [each for each in numbers if each != number]
        if routed and number != ROUTER:
            others = [ROUTER]
        write_text(fleet_path(folder, number), _fleet_yaml(plan, number, others))
    write_json(folder / PLAN, asdict(plan))
    return plan


def read_plan(folder: Path) -> LivePlan:
    """Return the plan of a folder.

    Raises:
        FleetError: there is none.
    """
    try:
        values = json.loads((folder / PLAN).read_text(encoding="utf-8"))
        return LivePlan(**{**values, "voters": tuple(values["voters"])})
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise FleetError(f"{folder} holds no fleet of processes ({error}): start it by `waychair fleet demo`") from None


def fleet_path(folder: Path, number: int) -> Path:
    """Return the path of a peer's fleet file."""
    return folder / f"fleet{number}.yaml"


def fleet_file(folder: Path, number: int) -> FleetFile:
    """Return a peer's fleet file; raises as `load_fleet`."""
    return load_fleet(fleet_path(folder, number))


def _fleet_yaml(plan: LivePlan, number: int, others: Sequence[int]) -> str:
    ends = ", ".join(f"tcp/127.0.0.1:{plan.ports[str(each)]}" for each in others)
    return (
        f"building: building.traffic\nnumber: {number}\nchairs: {list(plan.numbers)}\nvoters: {list(plan.voters)}\n"
        f"endpoints: [{ends}]\nlisten: tcp/127.0.0.1:{plan.ports[str(number)]}\nlog: waits{number}.jsonl\n"
    )


def _free_ports(count: int) -> list[int]:
    """Return free ports of this computer."""
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]
