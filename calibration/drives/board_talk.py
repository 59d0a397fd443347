"""The talk between a calibration drive and its board: a greeting, then a command and the answers in each period."""

from __future__ import annotations

import time
from typing import Protocol

from waychair.errors import BridgeError, CalibrationMismatch, TransportError
from waychair.firmware_bridge.advice import handshake_problem
from waychair.firmware_bridge.protocol import (
    BoardTelemetry,
    Command,
    CommandFlag,
    Decoder,
    Family,
    Hello,
    HelloReply,
    Message,
    encode,
    hello,
)
from waychair.firmware_bridge.transports import Transport

PERIOD_NS = 20_000_000
"""Time between two commands (50 Hz)."""

ANSWER_S = 2.0  # the board answers the greeting within this time

_RELEASE_COMMANDS = 3


class Clock(Protocol):
    """The source of time of a drive; tests replace it by a simulated clock."""

    def now_ns(self) -> int:
        """Return a time [ns] that never steps back."""

    def wait_until(self, moment_ns: int) -> None:
        """Return at this moment, or at once if it has passed."""


class MonotonicClock:
    """The computer's monotonic clock."""

    def now_ns(self) -> int:
        """Return the monotonic time [ns]."""
        return time.monotonic_ns()

    def wait_until(self, moment_ns: int) -> None:
        """Sleep until this moment."""
        time.sleep(max(0.0, (moment_ns - self.now_ns()) * 1e-9))


class BoardTalk:
    """The talk with one board. `telemetry` is its last one, None before the first; it was heard at `heard_ns`."""

    def __init__(self, board: Transport, clock: Clock) -> None:
        self.telemetry: BoardTelemetry | None = None
        self.heard_ns = self._due_ns = clock.now_ns()
        self._board = board
        self._clock = clock
        self._decoder = Decoder()
        self._sequence = 0

    @property
    def closed(self) -> bool:
        """Whether the cable was lost."""
        return self._board.closed

    def greet(self, chair_id: str, family: Family | None) -> HelloReply:
        """Greet the board as a computer of this chair and joystick family (None: the board's); return its reply.

        Raises:
            BridgeError: the board does not answer, or it refuses (with its reason).
            CalibrationMismatch: the board belongs to another chair.
            TransportError: the cable was lost.
        """
        ours = hello(chair_id, family or Family.HALL_5V)
        reply = self._reply(ours)
        if family is None and reply.family != ours.family and reply.family in set(Family):
            ours = hello(chair_id, Family(reply.family))
            reply = self._reply(ours)
        _check_reply(reply, ours)
        return reply

    def exchange(self, forward: int, turn: int) -> None:
        """Send set-points [1/10000 of the swing], wait a period, and read the board's messages."""
        now_ns = self._clock.now_ns()
        self._send(Command(forward, turn, CommandFlag.ENABLE, now_ns // 1000 & 0xFFFFFFFF))
        self._due_ns = max(self._due_ns + PERIOD_NS, now_ns)
        self._clock.wait_until(self._due_ns)
        self._listen()

    def release(self) -> None:
        """Release the lines to the rider's joystick. May be called twice, and after the cable was lost."""
        for _ in range(_RELEASE_COMMANDS):
            self._send(Command(0, 0, 0, 0))

    def _reply(self, ours: Hello) -> HelloReply:
        self._send(ours)
        deadline_ns = self._clock.now_ns() + round(ANSWER_S * 1e9)
        while self._clock.now_ns() < deadline_ns and not self._board.closed:
            self._due_ns = self._clock.now_ns() + PERIOD_NS
            self._clock.wait_until(self._due_ns)
            replies = [message for message in self._listen() if isinstance(message, HelloReply)]
            if replies:
                self.heard_ns = self._clock.now_ns()
                return replies[-1]
        if self._board.closed:
            raise TransportError("the cable to the board was lost: plug it in and start again")
        raise BridgeError(f"no board answered within {ANSWER_S:g} s: check its port and its power")

    def _listen(self) -> list[Message]:
        messages = [received.message for received in self._decoder.feed(self._board.read())]
        for message in messages:
            if isinstance(message, BoardTelemetry):
                self.telemetry = message
                self.heard_ns = self._clock.now_ns()
        return messages

    def _send(self, message: Message) -> None:
        self._board.write(encode(message, self._sequence))
        self._sequence += 1


def _check_reply(reply: HelloReply, ours: Hello) -> None:
    """Check the board's reply.

    Raises:
        CalibrationMismatch: the board belongs to another chair.
        BridgeError: the board is incompatible.
    """
    why = handshake_problem(reply, ours)
    if why:
        raise CalibrationMismatch(why) if reply.chair_id != ours.chair_id else BridgeError(why)
