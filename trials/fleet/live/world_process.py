"""The process of a simulated world with all its chairs' bodies, plants, sensors and boards: `python -m ... FOLDER`.

It keeps real time as long as its chairs answer in time, and runs slower while they do not; it goes on without a chair whose
process is dead, as a building does. The boards are part of it: a chair's board lives on when the chair's computer dies.
After a restart all chairs stand where they were.
"""

from __future__ import annotations

import json
import math
import os
import signal
import sys
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from waychair.calibration.fits.dac import DEFAULT
from waychair.errors import WaychairError
from waychair.files import write_json
from waychair.firmware_bridge.board import HostBoard, board_program
from waychair.garbage import present_left_out
from waychair.runtime.fleet.network.zenoh_transport import LocalBus
from waychair.runtime.processes import CANNOT_START, beats, signalled
from waychair.simulation.fleet import ChairPlan, FleetSimulator
from waychair.simulation.pacing import PaceMode, Pacer
from waychair.simulation.scene.seeds import chair_seed
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import BEAT_NS, DriveSetup, board_settings
from waychair.trials.fleet.fleet_drive import FleetScene, stands
from waychair.trials.fleet.live.live_plan import GONE_S, WORLD, read_plan
from waychair.trials.fleet.live.wire import ChairStep, WorldMoment, WorldStep, decoded, encoded, packed_sensor
from waychair.types import Pose2

LAG = 6
"""Steps of 10 ms that a chair's answers may be behind before the world waits for it; its board falls silent after 10."""

SILENT_S = 10.0
"""s without an answer after which a chair's process is not waited for: on a busy computer one that lives may take long."""

BEGINS_S, BEGINS_AGAIN_S = 120.0, 2.0
"""s for which a new world waits for the first words of its chairs, and one that was started again."""

MOMENT_STEPS = 10
"""Steps between two moments that are told and saved."""

_SAVED = "world.json"


@dataclass(slots=True)
class _Line:
    """The world's end of one chair's cable: its board, its last answered step, and when that came."""

    board: HostBoard
    answered: int = 0
    heard_s: float = -math.inf


@dataclass(slots=True)
class LiveWorld:
    """The simulator with its cables, for one process."""

    simulator: FleetSimulator
    lines: list[_Line]
    bus: LocalBus
    boot: int
    since_ns: int  # time of the fleet at which this simulator began
    step: int = 0
    pacer: Pacer = field(default_factory=lambda: Pacer(PaceMode.REALTIME))

    def hear(self) -> None:
        """Give the boards what their chairs sent."""
        for key, data in self.bus.received():
            _, _, name = key.partition("/")
            told = decoded(ChairStep, data)
            k = int(name) - 1
            if told is None or not 0 <= k < len(self.lines):
                continue
            line = self.lines[k]
            line.heard_s = time.monotonic()
            if told.boot == 0:
                line.answered = self.step  # the chair is there, and begins with the next step
            if told.boot == self.boot:
                line.answered = max(line.answered, told.step)
                if told.cable:
                    line.board.transport.write(told.cable)

    def is_held_up(self) -> bool:
        """Return whether a chair's process lives, and has not answered the last steps yet."""
        now_s = time.monotonic()
        for k, line in enumerate(self.lines, start=1):
            patience_s = SILENT_S if self.bus.is_there(f"chair{k}") else GONE_S
            if now_s - line.heard_s < patience_s and line.answered < self.step - LAG:
                return True
        return False

    def advance(self) -> None:
        """Let a step pass, and tell each chair what it senses."""
        self.step += 1
        heard = self.simulator.advance(BEAT_NS)
        for k, (line, messages) in enumerate(zip(self.lines, heard, strict=True), start=1):
            sensors = [packed_sensor(message) for message in messages]
            told = WorldStep(self.boot, self.step, self.simulator.now_ns, sensors, line.board.transport.read())
            self.bus.put(f"world/{k}", encoded(told))

    def moment(self) -> WorldMoment:
        """Return the truth now."""
        simulator, chairs = self.simulator, self.simulator.chairs
        count = len(chairs)
        between = [simulator.between(a, b) for a in range(count) for b in range(a + 1, count)]
        kinds = [contact.kind.value for chair in chairs for contact in chair.contact_reports]
        people = kinds.count("person")
        poses = [chair.truth() for chair in chairs]
        return WorldMoment(
            self.boot,
            self.since_ns + simulator.now_ns,
            self.pacer.real_time_factor,
            [(pose.x, pose.y, pose.theta) for pose in poses],
            [not stands(simulator, k) for k in range(count)],
            [_finite(chair.person_distance()) for chair in chairs],
            [(person.pose.x, person.pose.y) for person in simulator.people],
            _finite(min(between, default=math.inf)),
            (len(simulator.chair_contacts), people, len(kinds) - people),
        )


def serve(folder: Path) -> None:
    """Be the world of a plan until SIGTERM or SIGINT; raises as `LocalBus` and `FleetSimulator`."""
    plan = read_plan(folder)
    scene = plan.scene()
    stopped, beat, wake = signalled(signal.SIGINT, signal.SIGTERM), beats(), threading.Event()
    poses, since_ns = saved_poses(folder, scene)
    chairs = [
        ChairPlan(scene.body, randomised_settings(chair_seed(scene.seed, k)), pose) for k, pose in enumerate(poses)
    ]
    setup = DriveSetup(scene.mapped, scene.places, scene.body, DEFAULT)
    with ExitStack() as stack:
        simulator = FleetSimulator(scene.world, chairs, scene.seed)
        lines = []
        for chair in simulator.chairs:
            board = stack.enter_context(HostBoard(board_program(), board_settings(setup)))
            chair.wire(board)
            lines.append(_Line(board))
        bus = LocalBus(plan.bus, WORLD, hears=("cable/*",), wake=wake)
        stack.callback(bus.close)
        stack.enter_context(present_left_out())
        world = LiveWorld(simulator, lines, bus, int.from_bytes(os.urandom(6), "big"), since_ns)
        begins_by_s = time.monotonic() + (BEGINS_AGAIN_S if since_ns else BEGINS_S)
        while not stopped():
            if beat is not None:
                beat()  # also while it waits for its chairs
            wake.clear()
            world.hear()
            if time.monotonic() < begins_by_s and any(line.heard_s == -math.inf for line in lines):
                wake.wait(0.1)
                continue
            begins_by_s = 0.0
            if world.is_held_up():
                wake.wait(0.02)
                continue
            world.advance()
            if world.step % MOMENT_STEPS == 0:
                moment = world.moment()
                bus.put("moment", encoded(moment))
                write_json(folder / _SAVED, {"poses": moment.poses, "now_ns": moment.now_ns}, lasting=False)
            world.pacer.pace(simulator.now_ns)


def saved_poses(folder: Path, scene: FleetScene) -> tuple[list[Pose2], int]:
    """Return where the chairs were when an earlier world of this folder ended, and its time [ns]; else their starts, and 0."""
    try:
        values = json.loads((folder / _SAVED).read_text(encoding="utf-8"))
        poses = np.array(values["poses"], np.float64).reshape(len(scene.starts), 3).tolist()
        return [Pose2(*pose) for pose in poses], int(values["now_ns"])
    except (OSError, ValueError, KeyError, TypeError):
        return [scene.places[start].pose for start in scene.starts], 0


def _finite(metres: float) -> float:
    return metres if math.isfinite(metres) else -1.0


def main() -> None:
    """Run the process."""
    try:
        serve(Path(sys.argv[1]))
    except WaychairError as error:
        print(f"waychair: the world: {error}", file=sys.stderr)
        sys.exit(CANNOT_START)


if __name__ == "__main__":
    main()
