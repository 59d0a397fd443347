"""A bridge, a cable that can be pulled, and the shipped firmware as a program, all on one simulated clock."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

from waychair.calibration.fits.dac import DEFAULT, DacModel
from waychair.errors import TransportError
from waychair.firmware_bridge.board import BoardInputs, BoardSettings, HostBoard, LineState, at_rest
from waychair.firmware_bridge.bridge import Bridge, BridgeSettings
from waychair.firmware_bridge.protocol import BoardState, BoardTelemetry, Family, Holder
from waychair.firmware_bridge.transports import Reconnecting, Transport
from waychair.types import SentCommand, WheelSpeeds

MS = 1_000_000
TICK_MS = 50
BEAT_MS = 10
NEUTRAL_MV = 1650
GOOD = WheelSpeeds(0.3, 0.3)
BOARD = BoardSettings(family=Family.EIGHT_PIN_3V3, dac_bits=8)


class Bridged:
    """A computer that sends `speeds` at 20 Hz and beats in between; `lines` are the voltages at the chair's controller."""

    def __init__(
        self,
        program: Path,
        board: BoardSettings = BOARD,
        settings: BridgeSettings | None = None,
        calibration: DacModel = DEFAULT,
        chair_id: str = "A",
    ) -> None:
        self.board = HostBoard(program, board)
        self.inputs: BoardInputs = at_rest(board.family)
        self.plugged = True
        self.cable = Reconnecting(self._connect)
        self.bridge = Bridge(self.cable, calibration, chair_id, settings)
        self.now_ms = 0
        self.lines: LineState = self.board.step(0, self.inputs)
        self.sent: list[SentCommand] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.board.close()

    @property
    def now_ns(self) -> int:
        return self.now_ms * MS

    def _connect(self) -> Transport:
        if not self.plugged:
            raise TransportError("cannot open the serial port: is the board plugged in?")
        return self.board.transport

    def send(self, speeds: WheelSpeeds | None, age_ms: int = 0) -> SentCommand:
        """One tick of the control loop."""
        self.sent.append(self.bridge.send(speeds, self.now_ns - age_ms * MS, self.now_ns))
        return self.sent[-1]

    def live(self, ms: int, *, beats: bool = True) -> LineState:
        """Let time pass for the board, with or without the bridge's heartbeat."""
        for _ in range(ms):
            self.now_ms += 1
            self.lines = self.board.step(self.now_ms, self.inputs)
            if beats and self.now_ms % BEAT_MS == 0:
                self.bridge.beat(self.now_ns)
        return self.lines

    def run(self, ms: int, speeds: WheelSpeeds | None) -> SentCommand:
        """Run control ticks for this time; return the last `Sent`."""
        for _ in range(ms // TICK_MS):
            sent = self.send(speeds)
            self.live(TICK_MS)
        return sent

    def drive(self, speeds: WheelSpeeds = GOOD) -> SentCommand:
        """Through greeting and hold, up to the command."""
        self.run(2300, speeds)
        sent = self.run(400, speeds)
        assert sent.active, sent.reason
        assert (self.lines.state, self.lines.holder) == (BoardState.DRIVE, Holder.BOARD)
        return sent

    def push_stick(self, forward: float, turn: float = 0.0) -> None:
        """The rider's hand, as parts of the swing of 1.2 V; turn positive to the left."""
        forward_mv, turn_mv = NEUTRAL_MV + round(1200 * forward), NEUTRAL_MV - round(1200 * turn)
        self.inputs = replace(self.inputs, joystick_forward_mv=forward_mv, joystick_turn_mv=turn_mv)

    @property
    def joystick_is_live(self) -> bool:
        """Whether the lines have the voltages of the rider's stick, and the rider holds them."""
        stick = (self.inputs.joystick_forward_mv, self.inputs.joystick_turn_mv)
        return self.lines.holder is Holder.JOYSTICK and (self.lines.forward_mv, self.lines.turn_mv) == stick

    @property
    def last_report(self) -> BoardTelemetry:
        """Return the last telemetry of the board."""
        report = self.bridge._session.board
        assert report is not None
        return report
