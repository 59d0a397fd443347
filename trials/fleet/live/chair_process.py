"""The process of one whole chair of a simulated fleet, with its peer and its rider: `python -m ... FOLDER NUMBER`.

The chair's clock is the world's. While the world is silent the clock goes on by itself, so that the chair notices. Where the
chair is, and what its rider has still to do, is in a file, from which a restarted process goes on.
"""

from __future__ import annotations

import itertools
import json
import math
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from waychair.calibration.fits.dac import DEFAULT
from waychair.control.safety.stops import halt_as_told
from waychair.errors import TransportError, WaychairError
from waychair.files import write_json
from waychair.firmware_bridge.transports import Reconnecting
from waychair.garbage import present_left_out
from waychair.runtime.chair import Chair
from waychair.runtime.fleet.audit_file import AuditFile
from waychair.runtime.fleet.chain_driving import ChainDriver
from waychair.runtime.fleet.fleet_member import FleetMember, MemberStep
from waychair.runtime.fleet.network.peer_process import clock_ns, fleet_of, load_planner, new_boot
from waychair.runtime.fleet.network.zenoh_transport import LocalBus, ZenohTransport
from waychair.runtime.fleet.prompt_answers import PromptAnswers
from waychair.runtime.fleet.spot_sight import SpotSight
from waychair.runtime.processes import CANNOT_START, beats, signalled
from waychair.trials.drive import BEAT_NS, TICK_NS, DriveSetup, calibration_of
from waychair.trials.fleet.fleet_drive import ChairRun, Rider
from waychair.trials.fleet.live.live_plan import GONE_S, WORLD, LivePlan, fleet_file, read_plan
from waychair.trials.fleet.live.wire import ChairStep, ChairWord, WorldStep, decoded, encoded, sensor_from
from waychair.types import Pose2, Scan, SensorMessage

WORLD_SILENT_S = 10.0
"""s without a step of a world that is there after which the chair's clock goes on by itself: a busy computer may take long."""

ORDER_S, WORD_S = 0.1, 0.1
"""s between two steps of the peer, and between two words to the others of the simulation."""

RESETS_AFTER_S = 2.0
"""s; the simulated rider resets a chair that has not been ready for so long, as it was switched off or its board was."""

HERE = ChairStep(0, 0, b"")
"""A chair's word to a world that begins: it is there."""

_STILL = 0.02  # m/s or rad/s


class _Cable:
    """The chair's end of its cable: bytes that have come, and bytes to go with the next answer."""

    def __init__(self) -> None:
        self._came, self._going = bytearray(), bytearray()
        self.closed = False

    def write(self, data: bytes) -> bool:
        """Take bytes to be sent."""
        if not self.closed:
            self._going += data
        return not self.closed

    def read(self) -> bytes:
        """Return the bytes that have come."""
        data = bytes(self._came)
        self._came.clear()
        return data

    def feed(self, data: bytes) -> None:
        """Take bytes that have come."""
        self._came += data

    def taken(self) -> bytes:
        """Return the bytes to be sent."""
        data = bytes(self._going)
        self._going.clear()
        return data

    def fileno(self) -> int:
        """Return -1: there is no descriptor."""
        return -1

    def close(self) -> None:
        """Close this end."""
        self.closed = True


@dataclass(slots=True)
class _Progress:
    """What outlives a chair's process: pose and spots, None at first, and the record of its rider."""

    path: Path
    pose: Pose2 | None = None
    entered: tuple[int, ...] = ()
    run: ChairRun = field(default_factory=lambda: ChairRun(0))

    def save(self) -> None:
        """Write the file, without waiting for the disk."""
        pose = self.pose or Pose2()
        run = self.run
        values = {
            "pose": [pose.x, pose.y, pose.theta],
            "entered": list(self.entered),
            "reached": run.reached,
            "took_s": run.took_s,
            "ends": run.ends,
            "again": run.again,
        }
        write_json(self.path, values, lasting=False)


def _progress(path: Path, goals: int) -> _Progress:
    """Return what the file of an earlier process tells; a fresh one without it."""
    run = ChairRun(goals)
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        x, y, theta = map(float, values["pose"])
        entered = tuple(int(each) for each in values["entered"])
        run.reached = int(values["reached"])
        run.took_s, run.ends = [float(each) for each in values["took_s"]], [str(each) for each in values["ends"]]
    except (OSError, ValueError, KeyError, TypeError):
        return _Progress(path, run=ChairRun(goals))
    if not entered or not all(map(math.isfinite, (x, y, theta))):
        return _Progress(path, run=ChairRun(goals))
    return _Progress(path, Pose2(x, y, theta), entered, run)


@dataclass(slots=True)
class _Clock:
    """The chair's time [ns], how much later it is than the world's, and that world's boot and last step; `steps` of all worlds."""

    now_ns: int = 0
    later_ns: int = 0
    boot: int = 0
    step: int = 0
    steps: int = 0


class LiveFleetChair:
    """One chair with its member of the fleet, fed with steps of the world."""

    def __init__(
        self, folder: Path, plan: LivePlan, number: int, transport: ZenohTransport, put: Callable[[str, bytes], None]
    ) -> None:
        scene = plan.scene()
        self.number = number
        self._put = put
        index = number - 1
        file = fleet_file(folder, number)
        fleet, log = fleet_of(file), None if file.log is None else AuditFile(file.log)
        load_planner(fleet)
        self._goals = scene.goals[index]
        self.progress = _progress(folder / f"chair{number}.json", len(self._goals))
        start = self.progress.pose or scene.places[scene.starts[index]].pose
        setup = DriveSetup(scene.mapped, scene.places, scene.body, DEFAULT, zones=scene.zones)
        self._cable = _Cable()
        self._cable.close()
        self.chair = Chair(
            grid=setup.grid,
            places=setup.places,
            calibration=calibration_of(setup),
            cable=Reconnecting(self._connect),
            start=start,
            settings=setup.chair,
            model=setup.calibration,
            zones=setup.zones,
        )
        driver = ChainDriver(fleet.ways, number, scene.body, dict(scene.places))
        entered = self.progress.entered or scene.starts[index]
        self.member = FleetMember(fleet, number, new_boot(), driver, entered, transport, log, file.electorate)
        left = self._goals[self.progress.run.reached :]
        self.rider = Rider(number, self.chair, setup, driver, left, self.progress.run)
        self._sight = SpotSight(fleet.ways, scene.mapped, scene.body)
        self._clock = _Clock()
        self._heard: list[SensorMessage] = []
        self._last: MemberStep | None = None
        self._unready_ns: int | None = None
        self._numbers = itertools.count(1)
        self._notices: list[str] = []

    def _connect(self) -> _Cable:
        if self._clock.boot == 0:
            raise TransportError("the simulated world has not begun")
        self._cable = _Cable()
        return self._cable

    @property
    def has_begun(self) -> bool:
        """Whether a world has been there."""
        return self._clock.boot != 0

    def take(self, step: WorldStep) -> None:
        """Take a step of the world, run a tick if one is due, and answer."""
        clock = self._clock
        if step.boot != clock.boot:
            self._cable.close()  # another world has another board
            clock.later_ns = 0
        elif step.step <= clock.step:
            return
        clock.boot, clock.step = step.boot, step.step
        clock.later_ns = max(clock.later_ns, clock.now_ns - step.now_ns)
        clock.now_ns = step.now_ns + clock.later_ns
        self._cable.feed(step.cable)
        self._heard += [sensor_from(kind, values, self._clock.later_ns) for kind, values in step.sensors]
        self.chair.beat(self._clock.now_ns)
        self._clock.steps += 1
        if self._clock.steps % (TICK_NS // BEAT_NS) == 0:
            self.tick()
        self._put(f"cable/{self.number}", encoded(ChairStep(clock.boot, clock.step, self._cable.taken())))

    def tick_alone(self) -> None:
        """Let a tick pass without the world."""
        self._clock.now_ns += TICK_NS
        self.tick()
        self._put(f"cable/{self.number}", encoded(HERE))

    def tick(self) -> None:
        """Run one tick of the chair."""
        rider, last = self.rider, self._last
        wait = None if last is None else last.wait
        rider.held = wait is not None and rider.state is not None and _stands(rider)
        others = [halt_as_told("fleet_waits", wait.sentence)] if rider.held and wait is not None else []
        heard, self._heard = tuple(self._heard), []
        rider.state = self.chair.step(self._clock.now_ns, heard, others)
        for scan in [each for each in heard if isinstance(each, Scan)][-1:]:
            self._sight.look(scan, rider.state.map_from_base)
        self._reset()
        self.progress.pose, self.progress.entered = rider.state.map_from_base, self.member.entered
        self.progress.save()

    def _reset(self) -> None:
        """Reset faults as a rider does who sees that nothing moves."""
        if self.chair.ready or self.rider.done or self.chair.navigator.active:
            self._unready_ns = None
            return
        self._unready_ns = self._clock.now_ns if self._unready_ns is None else self._unready_ns
        if self._clock.now_ns - self._unready_ns > RESETS_AFTER_S * 1e9:
            self.rider.reset(clock_ns() // 1_000_000)
            self._unready_ns = None

    def order(self) -> None:
        """Run one step of the peer, and give the chair its authority and goals."""
        rider, now_ns = self.rider, clock_ns()
        assert rider.state is not None
        now_ms = now_ns // 1_000_000
        request = rider.wish(now_ms, self._numbers)
        if request is not None:
            self.member.want(request.goal, now_ns, request.priority)
        step = self.member.step(
            now_ns,
            rider.state.map_from_base,
            rider.count_goals(),
            sight=self._sight,
            navigation=rider.state.navigation,
        )
        rider.line = step.driven.authority.line
        self.chair.navigator.granted.authority = step.driven.authority
        rider.keep_on_chain(step.driven)
        before = rider.run.reached
        rider.follow(step.driven.goals, now_ms)
        if rider.run.reached > before:
            self.member.want(None, now_ns)
        self._notices += step.notices
        self._last = step

    def word(self) -> ChairWord:
        """Return what this process says of itself."""
        rider, last, measures = self.rider, self._last, self.member.measured()
        peer = self.member.driver.peer
        wait = None if last is None else last.wait
        waits = None
        if wait is not None:
            foreseen_ms = -1 if wait.foreseen_ms is None else wait.foreseen_ms
            waits = (-1 if wait.other is None else wait.other, wait.place, wait.reason.value, foreseen_ms)
        said = "" if last is None else last.told
        if not said and rider.state is not None:
            halts = "; ".join(halt.text for halt in rider.state.halts)
            said = rider.state.navigation.reason or halts or rider.state.navigation.stage.value
            if not self.chair.ready and halts:
                said = halts
        line = rider.line
        run = rider.run
        found = ChairWord(
            peer.boot,
            "" if rider.done else self._goals[run.reached],
            run.reached,
            run.took_s,
            run.ends,
            run.again,
            None if line is None else ((line[0][0], line[0][1]), (line[1][0], line[1][1])),
            rider.held,
            said,
            waits,
            0 if peer.allegiance.term is None else peer.allegiance.term.warden,
            (self.member.driver.authority.alone, self.member.driver.alone.retreats),
            measures.answers_ms,
            measures.ages_ms,
            list(self._notices),
        )
        self._notices.clear()
        return found


def _stands(rider: Rider) -> bool:
    assert rider.state is not None
    return max(abs(rider.state.twist.v), abs(rider.state.twist.omega)) < _STILL


def serve(folder: Path, number: int) -> None:
    """Be a chair of a plan until SIGTERM or SIGINT; raises as `LocalBus` and `ZenohTransport`."""
    plan = read_plan(folder)
    stopped, beat, wake = signalled(signal.SIGINT, signal.SIGTERM), beats(), threading.Event()
    file = fleet_file(folder, number)
    with ExitStack() as stack:
        bus = LocalBus(plan.bus, f"chair{number}", hears=(f"world/{number}",), wake=wake)
        stack.callback(bus.close)
        transport = ZenohTransport(file, file.traffic_graph().fingerprint, mode=plan.mode)
        stack.callback(transport.close)
        live = LiveFleetChair(folder, plan, number, transport, bus.put)
        bus.received()  # steps from before it could answer
        bus.put(f"cable/{number}", encoded(HERE))
        stack.enter_context(PromptAnswers(transport, lambda: live.member.answer(clock_ns())))
        stack.enter_context(present_left_out())
        heard_s = time.monotonic()
        order_s = word_s = 0.0
        while not stopped():
            wake.wait(0.02)
            wake.clear()
            for _, data in bus.received():
                step = decoded(WorldStep, data)
                if step is not None:
                    live.take(step)
                    heard_s = time.monotonic()
            now_s = time.monotonic()
            silent_s = GONE_S if live.has_begun and not bus.is_there(WORLD) else WORLD_SILENT_S
            if now_s - heard_s > silent_s:
                live.tick_alone()
                heard_s = max(heard_s + TICK_NS * 1e-9, now_s - silent_s)
            if live.rider.state is not None and (now_s - order_s >= ORDER_S or live.member.has_news):
                order_s = now_s
                live.order()
            if now_s - word_s >= WORD_S:
                word_s = now_s
                bus.put(f"word/{number}", encoded(live.word()))
                if beat is not None:
                    beat()


def main() -> None:
    """Run the process."""
    try:
        serve(Path(sys.argv[1]), int(sys.argv[2]))
    except WaychairError as error:
        print(f"waychair: chair {sys.argv[2]}: {error}", file=sys.stderr)
        sys.exit(CANNOT_START)


if __name__ == "__main__":
    main()
