"""The computer's side of a session with a board: greeting, numbered commands, telemetry and the end.

A session lasts from a greeting that both sides accept to the loss of the cable, a silent board, or a board that no
longer echoes commands (it was reset and waits for a greeting). Then the board is greeted again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from waychair.firmware_bridge.advice import fault_names, handshake_problem
from waychair.firmware_bridge.caps import Caps
from waychair.firmware_bridge.protocol import (
    SETPOINT_MAX,
    BoardState,
    BoardTelemetry,
    Command,
    Decoder,
    Family,
    GuardBit,
    HelloReply,
    Holder,
    Limit,
    Message,
    encode,
    hello,
)
from waychair.firmware_bridge.transports import Reconnecting
from waychair.topics import TELEMETRY
from waychair.types import GuardReport, JoystickInput, Telemetry

GREETING_NS = 500_000_000
"""Time after which an unanswered greeting is repeated."""

UNHEARD_NS = 200_000_000
"""Time without an echo in telemetry after which commands do not reach the board, or are rejected there."""

SILENT = "the board is silent: check its cable and its power, and that its firmware is of this version"

_REMEMBERED = 256
"""Number of commands whose echo is recognised: five seconds."""


@dataclass(slots=True)
class _Commands:
    """The times [ns] of the last commands by number, and of the last new echo, with its round trip."""

    sent_ns: dict[int, int] = field(default_factory=dict)
    echoed_ns: int = 0
    round_trip_ns: int | None = None

    def forget(self) -> None:
        """Forget the commands, because the session ended."""
        self.sent_ns.clear()
        self.round_trip_ns = None


class BoardSession:
    """A session with one board; `reply` and `board` are its last handshake reply and its last telemetry.

    `echoes` tells whether that telemetry echoes a command of this session; a board that was reset echoes none. `judge`
    gets a reply that the protocol accepts, and returns why the board cannot be used, or "".
    """

    def __init__(
        self, cable: Reconnecting, chair_id: str, family: int, judge: Callable[[HelloReply], str] = lambda reply: ""
    ) -> None:
        """
        Raises:
            BridgeError: the chair's name is longer than 16 bytes.
        """
        self.reply: HelloReply | None = None
        self.board: BoardTelemetry | None = None
        self.telemetry: Telemetry | None = None
        self.echoes = False
        self._cable = cable
        self._hello = hello(chair_id, Family(family))
        self._judge = judge
        self._decoder = Decoder()
        self._connections = 0
        self._sequence = 0
        self._refusal = ""
        self._greeted_ns: int | None = None
        self._heard_ns: int | None = None
        self._commands = _Commands()

    def listen(self, now_ns: int) -> None:
        """Read the board's messages; open a lost cable again and greet the board when it is due."""
        if not self._cable.poll(now_ns):
            self._end()
            return
        if self._cable.connections != self._connections:
            self._connections = self._cable.connections
            self._decoder, self._refusal, self._greeted_ns = Decoder(), "", None
            self._end()
        for received in self._decoder.feed(self._cable.read()):
            self._handle(received.message, now_ns)
        greeted = self._greeted_ns is not None and 0 <= now_ns - self._greeted_ns < GREETING_NS
        if self.problem(now_ns) and not greeted:
            self._end()
            self._greeted_ns = now_ns
            self._cable.write(self._greeting())

    def command(self, forward: int, turn: int, flags: int, now_ns: int) -> bool:
        """Send set-points [1/10000 of the swing] and flags; return whether the cable took them."""
        return self._send(Command(forward, turn, flags, _stamp_us(now_ns)), now_ns)

    def limit(self, caps: Caps, now_ns: int) -> bool:
        """Send caps of the rider's own stick; return whether the cable took them."""
        return self._send(Limit(*caps.setpoints(), caps.flags(), _stamp_us(now_ns)), now_ns)

    def _send(self, message: Command | Limit, now_ns: int) -> bool:
        sequence = self._next()
        self._commands.sent_ns[sequence] = now_ns
        self._commands.sent_ns.pop((sequence - _REMEMBERED) & 0xFFFF, None)
        return self._cable.write(encode(message, sequence))

    def problem(self, now_ns: int) -> str:
        """Return why the board cannot be reached now, with a remedy; empty if it can."""
        if self._cable.closed:
            return self._cable.reason
        if self._refusal:
            return self._refusal
        if self.reply is None or self.board is None or TELEMETRY.is_stale(self._heard_ns, now_ns):
            return SILENT
        if now_ns - self._commands.echoed_ns > UNHEARD_NS:
            return "the board does not hear the computer: check the cable between them"
        return ""

    def _greeting(self) -> bytes:
        return encode(self._hello, self._next())

    def _next(self) -> int:
        self._sequence = (self._sequence + 1) & 0xFFFF
        return self._sequence

    def _end(self) -> None:
        """End the session: forget the board's messages, but keep a refusal until the next reply."""
        self.reply = self.board = self.telemetry = self._heard_ns = None
        self._commands.forget()

    def _handle(self, message: Message, now_ns: int) -> None:
        if isinstance(message, HelloReply):
            self._refusal = handshake_problem(message, self._hello) or self._judge(message)
            self.reply = None if self._refusal else message
            self._heard_ns = self._commands.echoed_ns = now_ns
        elif isinstance(message, BoardTelemetry) and self.reply is not None and _is_sane(message):
            self._heard_ns = now_ns
            self._note_echo(message, now_ns)
            self.board = message
            self.telemetry = _telemetry(message, self.reply, self._commands.round_trip_ns, now_ns)

    def _note_echo(self, message: BoardTelemetry, now_ns: int) -> None:
        sent_ns = self._commands.sent_ns.get(message.echo_sequence)
        self.echoes = sent_ns is not None and _stamp_us(sent_ns) == message.echo_stamp_us
        fresh = self.board is None or self.board.echo_sequence != message.echo_sequence
        if sent_ns is not None and self.echoes and fresh:
            self._commands.round_trip_ns, self._commands.echoed_ns = now_ns - sent_ns, now_ns


def _is_sane(message: BoardTelemetry) -> bool:
    """Return whether state and holder are valid: one damaged frame in 65536 has the right checksum."""
    return message.state <= max(BoardState) and message.holder <= max(Holder)


def _telemetry(board: BoardTelemetry, reply: HelloReply, round_trip_ns: int | None, now_ns: int) -> Telemetry:
    """Return telemetry in volts and names; the stick as parts of the swing, turn positive to the left."""
    forward = (board.joystick_forward_mv - board.reference_mv) / reply.swing_mv
    turn = (board.reference_mv - board.joystick_turn_mv) / reply.swing_mv
    return Telemetry(
        stamp_ns=now_ns,
        forward_volts=board.forward_mv / 1000.0,
        turn_volts=board.turn_mv / 1000.0,
        joystick=JoystickInput(now_ns, forward, turn),
        faults=fault_names(board.faults),
        state=BoardState(board.state).name,
        holder=Holder(board.holder).name,
        round_trip_ns=round_trip_ns,
        guard=_guard(board),
    )


def _guard(board: BoardTelemetry) -> GuardReport | None:
    """Return how the board's guard acts; None without one."""
    bits = GuardBit(board.guard_bits & sum(GuardBit))
    if board.state != BoardState.GUARD and not bits:
        return None
    caps = (board.front_cap, board.rear_cap, board.left_cap, board.right_cap)
    front, rear, left, right = (cap / SETPOINT_MAX for cap in caps)
    return GuardReport(
        (front, rear, left, right),
        capped=GuardBit.CAPPED in bits,
        warns=GuardBit.WARNS in bits,
        overridden=GuardBit.OVERRIDDEN in bits,
        lost=GuardBit.LOST in bits,
    )


def _stamp_us(now_ns: int) -> int:
    return now_ns // 1000 & 0xFFFFFFFF
