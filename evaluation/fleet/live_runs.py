"""Runs of a fleet of processes: undisturbed, with processes that are killed, and with the network gone for a while; and peers
without chairs, weighed.
"""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from waychair.runtime.fleet.fleet_watch import FleetWatch
from waychair.runtime.fleet.network.peer_process import clock_ns, fleet_of
from waychair.runtime.fleet.network.zenoh_transport import ZenohListener
from waychair.runtime.processes import Process, Supervision
from waychair.trials.fleet.live.live_fleet import LiveFleet
from waychair.trials.fleet.live.live_plan import DESK, ROUTER, fleet_file, new_plan

WORLD = "T"
STARTS_S, BACK_S, GOALS_S = 240.0, 120.0, 600.0
"""s until all chairs keep the order at the start, after a kill, and until all goals are reached, at most: the computer may be
busy.
"""

MOST_FLEETS = 8
"""Fleets in which the kills of one kind are done."""

GOES_ON_S = 5.0
"""s after the return of a killed process until the chairs should go on."""

BETWEEN_S = (15.0, 25.0)
"""s from when chairs go on to the next kill: a process that dies five times in a minute is not started again."""

PEER_MODULE = "waychair.trials.fleet.live.voter_process"

AWAY_S = (30.0, 90.0)
"""s for which the network is gone in a parted run: until the chairs drive by their own eyes, and while they meet."""

KINDS = ("chair", "peer", "world", "router")
"""What is killed: a chair's process with its peer, a voter's peer, the world, the router of chairs that talk through one."""


@dataclass
class LiveRun:
    """What was measured in one run.

    `factor`: the chairs' seconds for each real one in the slowest fleet. `ended`: why fleets ended before their goals.
    `ordered_s` and `moved_s`: s from the first sign of life of a killed process until all chairs follow a warden, and until a
    chair moves again, unless the last goal was reached; infinite: not within `BACK_S`. `told_late`: what each rider was told when
    no chair had moved `GOES_ON_S` after that return.
    """

    answers_ms: list[float] = field(default_factory=list)
    ages_ms: list[float] = field(default_factory=list)
    over_line_m: float = 0.0
    contacts: int = 0
    factor: float = float("inf")
    reached: int = 0
    ended: list[str] = field(default_factory=list)
    ordered_s: list[float] = field(default_factory=list)
    moved_s: list[float] = field(default_factory=list)
    told_late: list[dict[str, str]] = field(default_factory=list)


def quiet_run(folder: Path, chairs: int, seed: int, seconds: float) -> LiveRun:
    """Return what chairs do that nobody disturbs, for some seconds of real time once all keep the order."""
    with LiveFleet(folder, new_plan(folder, WORLD, chairs, seed)) as fleet:
        _until(fleet, lambda: _in_order(fleet), STARTS_S)
        fleet.record.answers_ms.clear()
        fleet.record.ages_ms.clear()
        _until(fleet, lambda: fleet.finished, seconds)
        return _add(fleet, LiveRun())


def kill_run(folder: Path, chairs: int, seed: int, kind: str, kills: int) -> LiveRun:
    """Return what chairs do while a process of a kind is killed some times, at random moments between, in several fleets."""
    run = LiveRun()
    for k in range(MOST_FLEETS):
        if len(run.ordered_s) < kills:
            _kill_in_fleet(folder / f"fleet{k}", chairs, seed + k * len(KINDS), kind, kills, run)
    return run


def _kill_in_fleet(folder: Path, chairs: int, seed: int, kind: str, kills: int, run: LiveRun) -> None:
    """Kill a process of a kind as often as is left to do, until all goals of a fleet are reached."""
    plan = new_plan(folder, WORLD, chairs, seed, (DESK,) if kind == "peer" else (), routed=kind == "router")
    number = {"peer": DESK, "router": ROUTER}.get(kind)
    more = () if number is None else (Process(kind, PEER_MODULE, (str(folder), str(number))),)
    moments = random.Random(seed)
    with LiveFleet(folder, plan, more=more) as fleet:
        _until(fleet, lambda: _in_order(fleet), STARTS_S)
        while len(run.ordered_s) < kills:
            _until(fleet, lambda: fleet.finished, moments.uniform(*BETWEEN_S))
            if fleet.finished or fleet.ended:
                break
            name = f"chair {moments.choice(plan.numbers)}" if kind == "chair" else kind
            _kill(fleet, name, run)
        _add(fleet, run)


@dataclass
class PartedRun(LiveRun):
    """What was measured in a run whose network was gone for a while.

    `alone_s` and `together_s`: s until all chairs that want to go drove by their own eyes, and from the network's return until
    all followed a warden again; infinite: never. `backed_out`: times that each chair has backed out.
    """

    alone_s: float = float("inf")
    together_s: float = float("inf")
    backed_out: tuple[int, ...] = ()


def parted_run(folder: Path, chairs: int, seed: int) -> PartedRun:
    """Return what chairs do that talk through a router while that is stopped for a while, without any link being closed."""
    plan, run = new_plan(folder, WORLD, chairs, seed, routed=True), PartedRun()
    away_s = random.Random(seed).uniform(*AWAY_S)
    with _router(folder) as router, LiveFleet(folder, plan) as fleet:
        _until(fleet, lambda: _in_order(fleet) and fleet.record.is_moving, STARTS_S)
        router.send_signal(signal.SIGSTOP)
        began = time.monotonic()
        run.alone_s = _or_never(_until(fleet, lambda: _all_alone(fleet), BACK_S))
        _until(fleet, lambda: fleet.finished, began + away_s - time.monotonic())
        router.send_signal(signal.SIGCONT)
        run.together_s = _or_never(_until(fleet, lambda: _in_order(fleet), BACK_S))
        _until(fleet, lambda: fleet.finished, GOALS_S)
        run.backed_out = tuple(fleet.record.words[number].by_eye[1] for number in plan.numbers)
        _add(fleet, run)
    return run


@contextmanager
def _router(folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run the router of a plan, unwatched, as a stopped one would be started anew."""
    with subprocess.Popen([sys.executable, "-m", PEER_MODULE, str(folder), str(ROUTER)]) as router:
        try:
            yield router
        finally:
            router.kill()


def _all_alone(fleet: LiveFleet) -> bool:
    """Return whether each chair that has a goal left drives by its own eyes."""
    words = [fleet.record.words[number] for number in fleet.plan.numbers]
    return all(word.by_eye[0] for word in words if word.goal)


def _kill(fleet: LiveFleet, name: str, run: LiveRun) -> None:
    """Kill a process, and take down how long after its return the chairs go on."""
    record, pid = fleet.record, fleet.pids[name]
    before = _boot_of(fleet, name)

    def goes_on() -> bool:
        return record.is_moving or fleet.finished

    os.kill(pid, signal.SIGKILL)
    back = _until(fleet, lambda: fleet.pids.get(name, pid) != pid and _boot_of(fleet, name) != before, BACK_S)
    if back is None:
        run.ordered_s.append(float("inf"))
        return
    returned = time.monotonic()
    run.ordered_s.append(_or_never(_until(fleet, lambda: _in_order(fleet), BACK_S)))
    _until(fleet, goes_on, GOES_ON_S - (time.monotonic() - returned))
    if not goes_on():
        words = sorted(record.words.items())
        run.told_late.append({f"chair {number}": word.told or word.goal or "at its goals" for number, word in words})
        _until(fleet, goes_on, BACK_S)
    if not fleet.finished:
        run.moved_s.append(time.monotonic() - returned if record.is_moving else float("inf"))


def _boot_of(fleet: LiveFleet, name: str) -> int:
    """Return what tells one start of a process from the next; for a process that says nothing, its process id."""
    record = fleet.record
    if name == "world":
        return 0 if record.moment is None else record.moment.boot
    if name.startswith("chair"):
        word = record.words.get(int(name.removeprefix("chair ")))
        return 0 if word is None else word.boot
    return fleet.pids.get(name, 0)


def _in_order(fleet: LiveFleet) -> bool:
    """Return whether all chairs are heard, and follow one warden; none drives by its own eyes."""
    words = [fleet.record.words.get(number) for number in fleet.plan.numbers]
    if any(word is None or fleet.record.is_silent(k) for k, word in enumerate(words, start=1)):
        return False
    wardens = {0 if word.by_eye[0] else word.warden for word in words if word is not None}
    return len(wardens) == 1 and 0 not in wardens


def _until(fleet: LiveFleet, holds: Callable[[], bool], seconds: float) -> float | None:
    """Watch a fleet until something holds; return after how many seconds, None if it does not within the given ones."""
    began = time.monotonic()
    while (passed := time.monotonic() - began) < seconds and not fleet.ended:
        fleet.watch()
        if holds():
            return passed
    return None


def _or_never(seconds: float | None) -> float:
    return float("inf") if seconds is None else seconds


def _add(fleet: LiveFleet, run: LiveRun) -> LiveRun:
    """Add to a run what its fleet's record tells at the end; return the run."""
    record = fleet.record
    run.answers_ms += record.answers_ms
    run.ages_ms += record.ages_ms
    run.over_line_m = max(run.over_line_m, *(chair.over_line for chair in record.run.chairs))
    run.contacts += record.run.contacts
    run.factor = min(run.factor, record.factor)
    run.reached += sum(chair.reached for chair in record.run.chairs)
    if fleet.ended:
        run.ended.append(fleet.ended)
    return run


@dataclass(frozen=True)
class Weighed:
    """Peers without chairs on this computer: processor cores of all together, and memory of each [MB], shared parts by share."""

    peers: int
    cores: float
    megabytes: float


def weighed_peers(folder: Path, peers: int, seconds: float) -> Weighed:
    """Return what some peers without chairs cost in so many seconds, once all are there."""
    voters = tuple(range(100, 100 + peers))
    new_plan(folder, WORLD, 1, 0, voters)
    table = [Process(f"peer {number}", PEER_MODULE, (str(folder), str(number))) for number in voters]
    with Supervision(table, dict(os.environ)) as running:
        _all_heard(folder, voters, running)
        pids = list(running.pids.values())
        before, began = sum(map(_cpu_s, pids)), time.monotonic()
        time.sleep(seconds)
        passed = time.monotonic() - began
        used = sum(map(_cpu_s, pids)) - before
        return Weighed(peers, used / passed, sum(map(_megabytes, pids)) / max(len(pids), 1))


def _all_heard(folder: Path, voters: tuple[int, ...], running: Supervision) -> None:
    """Wait until all peers are heard.

    Raises:
        RuntimeError: some are not within `STARTS_S`.
    """
    file = fleet_file(folder, voters[0])
    fleet = fleet_of(file)
    watch, listener = FleetWatch(fleet.building, fleet.ways), ZenohListener(file, fleet.building)
    try:
        ends = time.monotonic() + STARTS_S
        while not set(voters) <= set(watch.states):
            watch.hear(listener.received(), clock_ns())
            if time.monotonic() > ends or running.watch():
                raise RuntimeError(f"{len(watch.states)} of {len(voters)} peers are heard")
            time.sleep(0.2)
    finally:
        listener.close()


def _cpu_s(pid: int) -> float:
    """Return the processor time [s] of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(") ")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _megabytes(pid: int) -> float:
    """Return the memory [MB] of a process, parts that several share by their share."""
    found = re.search(r"^Pss:\s+(\d+) kB", Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii"), re.MULTILINE)
    return 0.0 if found is None else int(found[1]) / 1e3
