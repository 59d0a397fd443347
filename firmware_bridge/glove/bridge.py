"""The computer's side of the cable to a glove: greeting, signs of life, patterns, reports.

    cable = Reconnecting(lambda: SerialTransport("/dev/ttyUSB1"))     # or a terminal, or HostGlove.transport
    glove = GloveBridge(cable, "A", layout_named("glove_3x3"), Fitting())
    glove.tick(now_ns, armed=True)                                    # once a control tick
    refused = glove.play(steps, priority=100, valid_ms=500, now_ns=now_ns)

The bridge has no clock. It never plays in silence: a pattern that is not played has a sentence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from waychair.firmware_bridge.glove.fitting import Fitting, fitted_step
from waychair.firmware_bridge.glove.glove_advice import (
    cut_sentences,
    motor_notices,
    refusal_sentences,
    reply_problem,
    status_problem,
)
from waychair.firmware_bridge.glove.layouts import TactorLayout
from waychair.firmware_bridge.glove.messages import (
    Alive,
    Gain,
    GloveDecoder,
    GloveMessage,
    GloveReceived,
    GloveReply,
    GloveState,
    GloveStatus,
    Play,
    PlayStep,
    StopPlaying,
    encode_glove,
    glove_hello,
)
from waychair.firmware_bridge.transports import Reconnecting

ALIVE_NS = 100_000_000
"""Time between two signs of life: the board says that nobody speaks after five that are missing."""

GREETING_NS = 500_000_000
"""Time after which an unanswered greeting is repeated."""

SILENT_NS = 200_000_000
"""Time without a report, of which 20 a second are due, after which the glove is lost."""

JUDGED_NS = 30_000_000
"""Time within which a pattern reaches the board: a later report that does not judge it says that it was lost."""

SESSION_LOST = "the glove was lost in the middle of a pattern: check its cable and its power"

SILENT = "the glove is silent: check its cable and its power, and that its firmware is of this version"


@dataclass(frozen=True, slots=True)
class SentPlay:
    """The last pattern that was sent: its message, its frame's number, when it was first sent [ns], and if it was twice."""

    play: Play
    sequence: int
    first_ns: int
    sent_ns: int
    judged: bool = False
    again: bool = False


@dataclass(frozen=True, slots=True)
class Presses:
    """Presses of the glove's buttons since the last tick."""

    repeat: int = 0
    yes: int = 0


@dataclass(frozen=True, slots=True)
class GloveReport:
    """One glove as the computer knows it: why it can play nothing (empty if it can), and sentences about broken motors.

    Motors are named by their places in the layout: those that vibrate now, and those that are open or shorted. `layout`: its
    name. `worn` and `temperature_c` are None while the glove does not report.
    """

    problem: str
    faults: tuple[str, ...] = ()
    layout: str = ""
    motors: int = 0
    on: tuple[int, ...] = ()
    broken: tuple[int, ...] = ()
    worn: bool | None = None
    temperature_c: int | None = None

    @property
    def alive(self) -> bool:
        """Whether the glove reports."""
        return self.worn is not None


class GloveBridge:
    """A session with one glove. `status` is its last report, `presses` those since the last tick.

    `refusals` are the sentences about the last pattern if the board did not play it, or not to its end.
    """

    def __init__(self, cable: Reconnecting, device_id: str, layout: TactorLayout, fitting: Fitting) -> None:
        """
        Raises:
            GloveError: the glove's name is too long, or the fitting is for another layout.
        """
        self.reply: GloveReply | None = None
        self.status: GloveStatus | None = None
        self.presses = Presses()
        self.refusals: tuple[str, ...] = ()
        self._cable = cable
        self._layout, self._fitting = layout, fitting
        self._outputs, self._gains = fitting.outputs(layout), fitting.output_gains(layout)
        self._hello = glove_hello(device_id, layout.number)
        self._decoder = GloveDecoder()
        self._sequence = 0
        self._sent: SentPlay | None = None
        self._refusal = ""
        self._times = _Times()

    def tick(self, now_ns: int, armed: bool) -> None:
        """Read the glove's messages, open a lost cable again, greet, and give a sign of life when it is due.

        `armed`: advice is on, so that the glove itself has to say when the computer falls silent.
        """
        self.presses = Presses()
        if not self._cable.poll(now_ns):
            self._end()
            return
        if self._cable.connections != self._times.connections:
            self._times = _Times(connections=self._cable.connections)
            self._decoder, self._refusal = GloveDecoder(), ""
            self._end()
        for received in self._decoder.feed(self._cable.read()):
            self._handle(received, now_ns)
        if self.reply is None or now_ns - self._times.heard_ns > SILENT_NS:
            self._greet(now_ns)
        elif armed != self._times.armed or now_ns - self._times.alive_ns >= ALIVE_NS:
            self._times.alive_ns, self._times.armed = now_ns, armed
            self._send(Alive(int(armed)))

    def play(self, steps: Sequence[PlayStep], priority: int, valid_ms: int, now_ns: int) -> str:
        """Send a pattern, whose masks name places of the layout; return why it is not played, or "".

        A pattern that is lost on the cable is sent once more while it is valid. Raises GloveError if a step does not fit the
        protocol.
        """
        problem = self.problem(now_ns)
        if problem:
            return problem
        fitted = tuple(fitted_step(step, self._outputs) for step in steps)
        if any(step.mask and not step.mask & ~self._faulty for step in fitted):
            return motor_notices(self._reported, self._outputs)[0]
        play = Play(priority, valid_ms, fitted)
        self.refusals = ()
        sequence = self._send(play)
        self._sent = SentPlay(play, sequence, now_ns, now_ns)
        return ""

    def stop(self) -> None:
        """Let all motors rest, and forget the queued pattern."""
        self._sent = None
        if self.reply is not None:
            self._send(StopPlaying())

    def problem(self, now_ns: int) -> str:
        """Return why the glove can play nothing now, with a remedy; empty if it can."""
        if self._cable.closed:
            return f"the glove cannot be reached: {self._cable.reason}"
        if self._refusal:
            return self._refusal
        if self.reply is None or self.status is None or now_ns - self._times.heard_ns > SILENT_NS:
            return SILENT
        return status_problem(self.status)

    def notices(self) -> tuple[str, ...]:
        """Return sentences about motors that are open or shorted."""
        return () if self.status is None else motor_notices(self.status, self._outputs)

    def report(self, now_ns: int) -> GloveReport:
        """Return the glove as it is now."""
        problem, count = self.problem(now_ns), len(self._layout.tactors)
        status = self.status
        if status is None or self.reply is None or now_ns - self._times.heard_ns > SILENT_NS:
            return GloveReport(problem, layout=self._layout.name, motors=count)
        return GloveReport(
            problem,
            self.notices(),
            self._layout.name,
            count,
            on=self._places(status.on),
            broken=self._places(self._faulty),
            worn=bool(status.worn),
            temperature_c=status.temperature_c,
        )

    def _places(self, outputs: int) -> tuple[int, ...]:
        """Return the places of the layout of outputs by bit."""
        return tuple(place for place, output in enumerate(self._outputs) if outputs >> output & 1)

    @property
    def _reported(self) -> GloveStatus:
        assert self.status is not None  # `problem` has looked
        return self.status

    @property
    def _faulty(self) -> int:
        return self._reported.open_motors | self._reported.shorted_motors

    def _greet(self, now_ns: int) -> None:
        if self._times.greeted_ns is not None and 0 <= now_ns - self._times.greeted_ns < GREETING_NS:
            return
        self._end()
        self._times.greeted_ns = now_ns
        self._send(self._hello)

    def _send(self, message: GloveMessage) -> int:
        self._sequence = (self._sequence + 1) & 0xFFFF
        self._cable.write(encode_glove(message, self._sequence))
        return self._sequence

    def _end(self) -> None:
        """End the session, but keep a refusal until the next reply."""
        if self._sent is not None and (not self._sent.judged or self._reported.playing):
            self.refusals = (*self.refusals, SESSION_LOST)
        self.reply = self.status = self._sent = None

    def _handle(self, received: GloveReceived, now_ns: int) -> None:
        message = received.message
        if isinstance(message, GloveReply):
            self._refusal = reply_problem(message, self._hello, self._layout, self._fitting)
            self.reply = None if self._refusal else message
            self._times.heard_ns, self._times.alive_ns, self._times.armed = now_ns, now_ns - ALIVE_NS, None
            if self.reply is not None:
                self._send(Gain(self._gains))
        elif isinstance(message, GloveStatus) and self.reply is not None and message.state <= max(GloveState):
            self._take(message, now_ns)

    def _take(self, status: GloveStatus, now_ns: int) -> None:
        if status.state in (GloveState.WAITING, GloveState.LOST):
            self.reply = None  # it was reset, or has waited for too long: it is greeted again
            return
        self._times.heard_ns = now_ns
        if self.status is not None:
            repeat = (status.repeat_presses - self.status.repeat_presses) & 0xFF
            yes = (status.yes_presses - self.status.yes_presses) & 0xFF
            self.presses = Presses(self.presses.repeat + repeat, self.presses.yes + yes)
        self.status = status
        self._judge(status, now_ns)

    def _judge(self, status: GloveStatus, now_ns: int) -> None:
        """Note whether the board has heard the last pattern, and send it once more if it was lost."""
        sent = self._sent
        if sent is None:
            return
        if status.judged == sent.sequence:
            if not sent.judged:
                self.refusals = refusal_sentences(status.refused)
                self._sent = replace(sent, judged=True)
            self.refusals += cut_sentences(status.cut)
        elif not sent.judged and now_ns - sent.sent_ns >= JUDGED_NS:
            late = now_ns - sent.first_ns > sent.play.valid_ms * 1_000_000
            if sent.again or late:
                self.refusals = ("the pattern was lost on the cable to the glove: check its plug",)
                self._sent = None
            else:
                self._sent = SentPlay(sent.play, self._send(sent.play), sent.first_ns, now_ns, again=True)


@dataclass(slots=True)
class _Times:
    """When the glove was greeted, heard and given a sign of life [ns], and whether that was armed."""

    connections: int = 0
    greeted_ns: int | None = None
    heard_ns: int = 0
    alive_ns: int = 0
    armed: bool | None = None
