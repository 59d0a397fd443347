"""A simulated chair behind real cables: the shipped firmware, a plant on its lines, sensors that print text lines."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

from waychair.calibration.chair_body import CHAIR_A, ChairBody
from waychair.calibration.drives.board_drive import BoardDrive, DriveLimits
from waychair.calibration.drives.measured_speeds import EncoderSpeeds, SpeedMeter
from waychair.calibration.drives.sensor_lines import text_from_message
from waychair.firmware_bridge.board import BoardInputs, BoardSettings, HostBoard, LineState
from waychair.firmware_bridge.protocol import Family
from waychair.firmware_bridge.transports import DescriptorTransport
from waychair.simulation.plant.plant import PlantSettings, randomised, volts_from_joystick
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.trials.open_hall import open_hall
from waychair.trials.simulated_drive import with_few_beams
from waychair.types import ImuSample, JoystickInput, Scan, WheelTicks

SEED = 4
PLANT = randomised(PlantSettings(), SEED)
STEP_MS = 10


class BoardRig:
    """A chair, by default "ward 3", with an eight-pin joystick; a context manager, and the clock of its drives.

    Time passes in `wait_until`. Each of `events` runs once, at its time [ms] after the lines were first held.
    """

    def __init__(
        self,
        program: Path,
        settings: SimulatorSettings | None = None,
        side: float = 40.0,
        chair_id: str = "ward 3",
        body: ChairBody = CHAIR_A,
    ) -> None:
        settings = settings or with_few_beams(SimulatorSettings(plant=PLANT))
        self.board = HostBoard(program, BoardSettings(chair_id=chair_id, family=Family.EIGHT_PIN_3V3))
        self.simulator = Simulator(open_hall(side), body, settings, SEED)
        self.stick = JoystickInput(0)
        self.inputs: dict[str, object] = {}
        self.events: list[tuple[int, Callable[[], None]]] = []
        self.lines: list[LineState] = []
        self.silent_sensors = False
        self._began_ms: int | None = None
        ours, theirs = socket.socketpair()
        self._printer = ours
        self.sensors = DescriptorTransport(theirs.detach())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.board.close()
        self._printer.close()
        self.sensors.close()

    def now_ns(self) -> int:
        return self.simulator.now_ns

    def wait_until(self, moment_ns: int) -> None:
        while self.simulator.now_ns < moment_ns:
            self._step()

    def drive(self, meter: SpeedMeter | None = None, limits: DriveLimits | None = None) -> BoardDrive:
        """Return a drive with a board that was greeted, but not armed."""
        return BoardDrive(
            self.board.transport,
            self.sensors,
            meter or EncoderSpeeds(CHAIR_A),
            "ward 3",
            family=Family.EIGHT_PIN_3V3,
            clock=self,
            limits=limits,
        )

    def pull_sensors(self) -> None:
        """Unplug the sensors' cable."""
        self._printer.close()

    def _step(self) -> None:
        now_ms = self.simulator.now_ns // 1_000_000 + STEP_MS
        forward, turn = volts_from_joystick(PLANT, self.stick.forward, self.stick.turn)
        around = BoardInputs(round(1e3 * forward), round(1e3 * turn), 1650)
        inputs = replace(around, **self.inputs)  # type: ignore[arg-type]
        state = self.board.step(now_ms, inputs)
        self.lines.append(state)
        self.simulator.drive(1e-3 * state.forward_mv, 1e-3 * state.turn_mv)
        messages = self.simulator.advance(STEP_MS * 1_000_000)
        if not self.silent_sensors and self._printer.fileno() >= 0:
            told = [message for message in messages if isinstance(message, WheelTicks | ImuSample | Scan)]
            with contextlib.suppress(BrokenPipeError):  # the cable is closed
                self._printer.sendall("".join(text_from_message(message) + "\n" for message in told).encode())
        if state.holder.name == "BOARD" and self._began_ms is None:
            self._began_ms = now_ms
        while self.events and self._began_ms is not None and now_ms >= self._began_ms + self.events[0][0]:
            self.events.pop(0)[1]()
