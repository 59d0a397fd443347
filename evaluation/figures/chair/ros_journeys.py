"""Journeys over two storeys by the nodes of a chair, of which one is killed with -9 in every phase of a journey.

A rider beside it does what the chair's sentences ask for: says the storey, opens the lift's door, resets, asks for the goal
again. `JOURNEY_KILLS` takes a sample.
"""

from __future__ import annotations

import contextlib
import os
import random
import signal
import tempfile
import time
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from evaluation.runs.live_stack import LiveStack, SeenMessages, held_at, until_released
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.journey.journey import JourneyPhase
from waychair.errors import RosError
from waychair.files import write_json
from waychair.firmware_bridge.protocol import Holder
from waychair.maps.building.building import goals
from waychair.ros import topics
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.chair import read_drive_state
from waychair.ros.messages.floor import read_floor, read_journey_state
from waychair.ros.messages.lifts import LiftRequest, MotionState, RequestType, lift_request, read_lift_state
from waychair.ros.messages.reports import read_diagnostics
from waychair.ros.messages.wire import serialised
from waychair.simulation.plan.world import load_levels
from waychair.trials.travel.world_building import building_of_world
from waychair.types import Json

KILLS = int(os.environ.get("JOURNEY_KILLS", "50"))
WORLD = "two_floors"
NODES = ("navigator", "mapper", "bridge")
LATER_S = {
    JourneyPhase.DRIVE: 2.0,
    JourneyPhase.CALL: 0.3,
    JourneyPhase.WAIT: 4.0,
    JourneyPhase.ENTER: 2.0,
    JourneyPhase.RIDE: 8.0,
    JourneyPhase.WHICH: 1.0,
    JourneyPhase.SWITCH: 0.0,
    JourneyPhase.RELOCALISE: 0.3,
    JourneyPhase.LEAVE: 2.0,
}
"""s; a kill comes at a random moment up to so long after its phase has begun, or after the chair moves in it."""

_DRIVES = (JourneyPhase.DRIVE, JourneyPhase.ENTER, JourneyPhase.LEAVE)

RESTED_MS, STUCK_S = 150.0, 150.0
"""Bar of the time to rest [ms]; longest time [s] in which a rider brings the chair to the next kill."""

_DOMAIN = 88
_AGAIN_S = 2.0
"""s between two acts of the rider."""

_IDLE = ("", "refused", JourneyPhase.FAILED, JourneyPhase.ARRIVED)


@dataclass(frozen=True, slots=True)
class JourneyKill:
    """A kill: the node, the phase told then, the time until the computer had let go of the lines [ms], 0 if it held none; the
    time until the next drive [s], None if there was none; and whether a drive that the kill had ended went on by itself.
    """

    node: str
    phase: str
    rested_ms: float
    next_s: float | None
    resumed: bool


@dataclass(slots=True)
class _Seen:
    """What the nodes have told, and ticks of the bridge in which the computer drove on another storey's map."""

    floors: SeenMessages = field(default_factory=SeenMessages)
    journeys: SeenMessages = field(default_factory=SeenMessages)
    lifts: SeenMessages = field(default_factory=SeenMessages)
    level: str = ""
    contacts: int = 0
    wrong_ticks: int = 0


class Rider:
    """A rider of a chair whose nodes are killed, beside a building's lift."""

    def __init__(self, stack: LiveStack, names: dict[str, str], rng: random.Random) -> None:
        """`names`: the goal to travel to on each storey."""
        self._stack, self._names, self._rng = stack, names, rng
        self.seen = seen = _Seen()
        stack.listen(topics.FLOOR, read_floor, seen.floors)
        stack.listen(topics.JOURNEY, read_journey_state, seen.journeys)
        stack.listen(topics.LIFT_STATES, read_lift_state, seen.lifts)
        stack.listen(topics.DIAGNOSTICS, self._take_reports, SeenMessages())
        stack.listen(topics.DRIVE_STATE, self._judge, SeenMessages())
        node, topic = stack.client.node, topics.LIFT_REQUESTS
        self._presses = node.create_publisher(interface_type(topic.type), topic.name, topics.profile(topic.qos))
        self._acted_s = 0.0
        self._wanted = next(reversed(names))

    def _take_reports(self, message: object) -> None:
        """Take the true level and the contacts; the level changes while the chair rests in a lift."""
        for report in read_diagnostics(message):
            if report.name.endswith("simulator: simulation") and report.values:
                told = dict(report.values)
                self.seen.level, self.seen.contacts = told["level"], int(told["contacts"])

    def _judge(self, message: object) -> None:
        """Count a tick of the bridge in which the computer drives on the map of another level."""
        floor = self.seen.floors.last
        wrong = floor is not None and bool(self.seen.level) and floor.storey != self.seen.level
        self.seen.wrong_ticks += wrong and read_drive_state(message).driving

    @property
    def phase(self) -> str:
        """The phase of the journey as the navigator told it last."""
        return "" if self.seen.journeys.last is None else self.seen.journeys.last.phase

    def until_phase(self, phase: str) -> None:
        """Travel to and fro, with all the help that the chair asks for, until a journey is in a phase."""

        def there() -> bool:
            self._help()
            return self.phase == phase and (phase not in _DRIVES or self._stack.moves)

        self._stack.until(there, f"the phase {phase}", STUCK_S)

    def _help(self) -> None:
        """Do what the chair's state asks for, every now and then."""
        seen, floor, state = self.seen, self.seen.floors.last, self._stack.state
        told = seen.journeys.last
        if time.monotonic() - self._acted_s < _AGAIN_S or floor is None or state is None or not seen.level:
            return
        self._acted_s = time.monotonic()
        with contextlib.suppress(RosError):  # the node that would answer is not back yet
            if state.waits:
                self._stack.client.confirm(5.0, goal_id=state.goal_id)
            elif told is not None and told.asks and told.phase not in _IDLE:
                self._stack.client.say_storey(seen.level)
            elif told is not None and told.phase == JourneyPhase.HELD:
                self._reset()
                self._stack.client.go_on(5.0)
            elif told is None or told.phase in _IDLE:
                self._set_off(floor.certain)

    def _set_off(self, certain: bool) -> None:
        """Ask for the goal of the storey on which the chair is not; a lift's door is opened, and its storey said, before."""
        self._reset()
        self._open()
        if not certain:
            self._stack.client.say_storey(self.seen.level)
            return
        if self._wanted == self.seen.level and self.phase == JourneyPhase.ARRIVED:
            self._wanted = next(each for each in self._names if each != self.seen.level)
        self._stack.client.travel_to(self._names[self._wanted])

    def _reset(self) -> None:
        state = self._stack.state
        if state is not None and state.halts:
            self._stack.client.reset_faults(5.0)

    def _open(self) -> None:
        """Press the button that opens the door of a car that stands, as somebody in it does."""
        state = self.seen.lifts.last
        if state is not None and state.motion is MotionState.STOPPED:
            self.press(self.seen.level)

    def press(self, storey: str) -> None:
        """Press a storey's button in the lift, or in the hall there."""
        lift = self.seen.lifts.last
        if lift is not None:
            now_ns = self._stack.client.node.get_clock().now().nanoseconds
            asked = LiftRequest(now_ns, lift.lift, "somebody", RequestType.HUMAN, storey)
            self._presses.publish(serialised(lift_request(asked)))

    def next_kill(self, k: int) -> JourneyKill:
        """Travel to the moment of kill `k`, and kill; one after which the rider cannot go on has no next drive."""
        phase, node = tuple(LATER_S)[k % len(LATER_S)], NODES[(k + k // len(LATER_S)) % len(NODES)]
        try:
            self.until_phase(phase)
            self._stack.spin(self._rng.uniform(0.0, LATER_S[phase]))
            return self.kill(node)
        except AssertionError as stuck:
            print(stuck, flush=True)
            return JourneyKill(node, self.phase, 0.0, None, False)

    def kill(self, node: str) -> JourneyKill:
        """Kill a node; while it comes back, somebody may call the car to the other storey."""
        stack, phase = self._stack, self.phase
        pid, dead_ns = stack.pids[node], time.time_ns()
        held = held_at(stack, dead_ns)
        os.kill(pid, signal.SIGKILL)
        gone_ns = until_released(stack, dead_ns, patience_s=5.0) if held else dead_ns
        called = self._rng.random() < 0.5
        stack.until(lambda: stack.pids[node] != pid, f"another {node}")
        if node == "navigator":
            self.seen.journeys.all.clear()  # its journey has ended with it
        if called and self.seen.level:
            self.press(next(each for each in self._names if each != self.seen.level))
        stack.spin(4.0)
        took = any(lines.holder is Holder.BOARD and lines.stamp_ns > gone_ns for _, lines in stack.lines.since(dead_ns))
        began_s, back_ns = time.monotonic(), time.time_ns()

        def drives() -> bool:
            self._help()
            state = stack.state
            return (
                state is not None and state.driving and state.stamp_ns > back_ns
            )  # not the last word of a bridge that was killed

        next_s: float | None = None
        try:
            stack.until(drives, "the next drive", STUCK_S)
            next_s = time.monotonic() - began_s
        except AssertionError as stuck:
            print(stuck, flush=True)
        return JourneyKill(node, phase, (gone_ns - dead_ns) / 1e6, next_s, held and took)


def journeys_killed(out: Path) -> Json:
    """In each phase a node killed: at rest within 150 ms, no drive by itself, never one on another storey's map, none stuck."""
    kills: list[JourneyKill] = []
    seen: list[_Seen] = []
    rng = random.Random(3)
    levels = tuple(level.without_people() for level in load_levels(WORLD))
    with tempfile.TemporaryDirectory(prefix="waychair-") as name:
        building = building_of_world(levels, Path(name) / "site", CHAIR_A)
        names = {
            building.hgraph.storey_of(ref.submap): goal
            for goal, ref in goals(building.hgraph).items()
            if goal.endswith(("entrance", "office"))
        }
        start = levels[0].start
        where = "--map", str(building.map_folder(levels[0].level)), "--start", f"{start.x},{start.y},{start.theta}"
        while len(kills) < KILLS:
            folder = out.with_suffix("") / f"from_kill_{len(kills)}"
            with LiveStack(folder, _DOMAIN, "--no-camera", "--no-people", *where, world=WORLD) as stack:
                rider = Rider(stack, names, rng)
                seen.append(rider.seen)
                while len(kills) < KILLS:
                    kills.append(rider.next_kill(len(kills)))
                    print(f"  {kills[-1]}", flush=True)
                    write_json(out.with_suffix("") / "kills.json", {"kills": [asdict(each) for each in kills]})
                    if kills[-1].next_s is None:
                        break  # another chair takes the next ones
    return _summary(kills, seen)


def _summary(kills: list[JourneyKill], seen: list[_Seen]) -> Json:
    rested = np.array([each.rested_ms for each in kills])
    next_s = [each.next_s for each in kills if each.next_s is not None]
    resumed, stuck = sum(each.resumed for each in kills), len(kills) - len(next_s)
    wrong, contacts = sum(each.wrong_ticks for each in seen), sum(each.contacts for each in seen)
    return {
        "passed": bool((rested <= RESTED_MS).all()) and not (resumed or wrong or contacts or stuck),
        "kills": len(kills),
        "by_node": dict(Counter(each.node for each in kills)),
        "by_phase": dict(Counter(each.phase for each in kills)),
        "while_driving": int((rested > 0.0).sum()),
        "rested_ms": round(float(rested.max()), 1),
        "resumed": resumed,
        "drives_on_a_wrong_map": wrong,
        "contacts": contacts,
        "stuck": stuck,
        "next_drive_median_s": round(float(np.median(next_s)), 1) if next_s else None,
    }
