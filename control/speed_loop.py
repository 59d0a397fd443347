"""Speeds as they were asked for, over a chair controller that nobody documents: feed-forward, PI, and a heading hold.

The calibration's inverse, further down, is the feed-forward: a command goes out as it is, plus a trim. The trim is a PI
of what the chair should be doing by now (`ExpectedSpeed`) less what it does, so a step of the command that the chair
follows as expected leaves the trim at nothing. While the chair is to go straight, the turn axis also works off the
heading that it has lost, and the distance by which it has left the line.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field

from waychair.calibration.dac import DacModel
from waychair.calibration.fitted_dac import DeadBand, FittedDac
from waychair.calibration.stopping import StopTable
from waychair.config import Settings, setting
from waychair.control.axis_response import LONGEST_S, AxisResponse, ExpectedSpeed, response_from_axis
from waychair.control.kinematics import twist_from_wheel_speeds
from waychair.types import Sent, Twist

HOLD_SHARE = 0.25
"""Heading hold's gain as a part of the crossover: the loop that it closes round the speed loop is four times slower."""

LINE_SHARE = 0.25
"""Line hold's gain as a part of the heading hold's, once more four times slower."""

_STRAIGHT = 1e-3  # rad/s
_LEAST_V = 0.3  # m/s: at less, the line is steered back to no more sharply


@dataclass(frozen=True, slots=True)
class Gains:
    """PI of one axis: trim = proportional e + integral (integral of e); heading [1/s] and line [1/s] of the turn axis."""

    proportional: float
    integral: float
    heading: float
    line: float


def gains(delay_s: float, lag_s: float, margin: float, fastest: float = math.inf) -> Gains:
    """Gains for an axis of this whole delay [s] and lag [s] that keep a phase margin [rad] at the identified gain.

    With its zero on the lag, the PI cancels it: C = w (lag s + 1) / s makes the loop L = w exp(-delay s) / s, whose
    magnitude is 1 at w, where its phase is -pi/2 - w delay. The margin pi/2 - w delay is the one asked for at

        w = (pi/2 - margin) / delay        proportional = w lag, integral = w        (at most `fastest` [rad/s])

    A chair whose gain is K times the identified one crosses at K w: what remains is pi/2 - K (pi/2 - margin), so that
    67.5 degrees leave 45 at twice the gain. (Internal model control with a first-order Pade gives the same controller,
    Rivera, Morari, Skogestad 1986; the zero on the lag and the delay as the only limit are Skogestad's rules, 2003.)
    The heading hold multiplies L by 1 + k/s, which takes atan(k/w) of the margin, 14 degrees at k = w/4.

    A Smith predictor that works off an asymmetry as fast keeps 4 degrees more as identified and 8 more at twice the
    gain (`closed_loop_margins` of the acceptance). It would put a model of dead band and ramps into the feedback,
    where this loop has it in the reference only, so the PI it is.
    """
    crossover = min((0.5 * math.pi - margin) / max(delay_s, 1e-3), fastest)
    return Gains(crossover * lag_s, crossover, HOLD_SHARE * crossover, HOLD_SHARE * LINE_SHARE * crossover)


@dataclass(frozen=True, slots=True)
class SpeedLoopSettings(Settings):
    """How each axis follows, how cautious the loop is, and when its integrators wait."""

    forward: AxisResponse = field(default_factory=AxisResponse)
    turn: AxisResponse = field(default_factory=AxisResponse)
    margin: float = setting(math.radians(67.5), "rad", "phase margin of either axis", low=math.radians(45.0), high=1.5)
    fastest: float = setting(4.0, "rad/s", "crossover of a chair without delay", low=0.1, high=10.0)
    period_s: float = setting(0.05, "s", "tick: half of it is the hold's delay, half the mean's", low=0.0, high=0.2)
    max_v: float = setting(0.2, "m/s", "largest trim", low=0.0, high=0.5)
    max_omega: float = setting(0.4, "rad/s", "largest trim", low=0.0, high=1.0)
    reach_v: float = setting(10.0, "m/s", "greatest speed of the chair", low=0.05, high=10.0)
    reach_omega: float = setting(20.0, "rad/s", "as above, of turning", low=0.05, high=20.0)
    reserve: float = setting(0.1, "", "part of the reach that is left to the trims", low=0.0, high=0.5)
    hold_omega: float = setting(0.15, "rad/s", "most that heading and line hold ask for", low=0.0, high=1.0)
    line_angle: float = setting(0.1, "rad", "steepest way back to the line", low=0.0, high=0.5)
    quantum_v: float = setting(0.03, "m/s", "sent and asked for differ by less through rounding", low=0.0, high=0.5)
    quantum_omega: float = setting(0.06, "rad/s", "as above, of turning", low=0.0, high=1.0)
    moving_v: float = setting(0.03, "m/s", "a measured speed that is motion for certain", low=0.0, high=0.5)
    moving_omega: float = setting(0.06, "rad/s", "as above, of turning", low=0.0, high=1.0)
    brake_s: float = setting(0.6, "s", "longest that a parking brake takes to open", low=0.0, high=3.0)
    caster_way: float = setting(0.4, "m", "way after a reversal in which casters swing round", low=0.0, high=2.0)


def tuned(settings: SpeedLoopSettings, model: DacModel, stops: StopTable | None = None) -> SpeedLoopSettings:
    """The settings with the delays, lags, ramps and reach that a calibration found; as they were where it has none.

    A calibration's steps begin at rest, so that a parking brake's opening looks like delay. Stops know no brake: their
    delay is the longest that a moving chair can have (it ends when 5 % of the speed is lost, later than the true one).
    """
    if isinstance(model, DeadBand):
        model = model.model
    if not isinstance(model, FittedDac):
        return settings
    longest = stops.delay_s if stops is not None else math.inf
    return dataclasses.replace(
        settings,
        forward=response_from_axis(model.forward, longest) or settings.forward,
        turn=response_from_axis(model.turn, longest) or settings.turn,
        reach_v=min(model.forward.reach(1.0), model.forward.reach(-1.0)),
        reach_omega=min(model.turn.reach(1.0), model.turn.reach(-1.0)),
    )


def gains_of(response: AxisResponse, settings: SpeedLoopSettings) -> Gains:
    """Gains of an axis: its delay, what that may be longer, and the tick's own."""
    delay_s = response.delay_s + response.doubt_s + settings.period_s
    return gains(delay_s, response.lag_s, settings.margin, settings.fastest)


class _Axis:
    """One axis: what it should do by now, and its trim."""

    def __init__(self, response: AxisResponse, settings: SpeedLoopSettings, limit: float, quantum: float) -> None:
        self.gains = gains_of(response, settings)
        self.integral = 0.0
        self.mean = 0.0
        self._expected = ExpectedSpeed(response)
        self._limit = limit
        self._quantum = quantum
        self._asked = (0.0, 0.0, 0)  # reference, with its trim, at [ns]
        self._shortfall = 0.0

    def advance(self, now_ns: int, sent: float | None) -> None:
        """What the chair should have done since the last tick, by what was `sent` then.

        More than rounding between what was asked for and what was sent (an axis at its end, a slew limit) reaches the
        model as well: the chair is then not expected to do what it was never told, and nothing winds up.
        """
        reference, asked, asked_ns = self._asked
        shortfall = 0.0 if sent is None else sent - asked
        self._shortfall = shortfall if abs(shortfall) > self._quantum else 0.0
        self._expected.command(reference + self._shortfall, asked_ns)
        self.mean = self._expected.advance(now_ns)

    def trim(self, error: float, seconds: float, frozen: bool) -> float:
        """PI of the error; the integral rests while `frozen`, and never grows towards where the axis is at its end."""
        if not frozen and self._shortfall * error >= 0.0:
            self.integral = _limited(self.integral + self.gains.integral * seconds * error, self._limit)
        return _limited(self.gains.proportional * error + self.integral, self._limit)

    def ask(self, reference: float, trim: float, now_ns: int) -> float:
        """Remember and return what goes out."""
        self._asked = (reference, reference + trim, now_ns)
        return reference + trim

    def restart(self, speed: float, reference: float, now_ns: int) -> None:
        """The chair moves at this speed, and follows the reference from now on."""
        self._expected.restart(speed, reference)
        self._asked = (reference, reference, now_ns)
        self.mean = self._expected.advance(now_ns)


class SpeedLoop:
    """Keeps both axes' trims and expected speeds, and the line that a straight drive holds."""

    def __init__(self, settings: SpeedLoopSettings | None = None, track: float = 0.54) -> None:
        """`track` [m] is that of the wheel speeds that were sent."""
        s = self._settings = settings or SpeedLoopSettings()
        self._track = track
        self._forward = _Axis(s.forward, s, s.max_v, s.quantum_v)
        self._turn = _Axis(s.turn, s, s.max_omega, s.quantum_omega)
        self._last_ns: int | None = None
        self._at_rest = True
        self._waiting_since_ns: int | None = None
        self._line = _Line(self._turn.gains, s)
        self._direction = 0.0
        self._caster_way = 0.0

    @property
    def expected(self) -> Twist:
        """Mean speeds that the chair should have had since the tick before, without any trim."""
        return Twist(self._forward.mean, self._turn.mean)

    @property
    def waiting(self) -> bool:
        """Whether the chair was told to set off and has not moved yet, within the time that a brake may take."""
        return self._waiting_since_ns is not None

    @property
    def casters_swing(self) -> bool:
        """Whether the casters may still be swinging round after a reversal."""
        return self._caster_way > 0.0

    def step(self, command: Twist | None, measured: Twist, now_ns: int, sent: Sent | None = None) -> Twist:
        """The command plus its trims; None means that nobody drives, and all is forgotten.

        `measured` is the mean twist since the last call, `sent` what came of the twist that was returned then: its
        wheel speeds tell saturation and dead band (without it, neither is seen). A chair that is to stand gets exactly
        0. A measurement that is not finite changes no trim, and a command that is not finite is handed on as it is, for
        the bridge to refuse.
        """
        seconds = 0.0 if self._last_ns is None else min(max((now_ns - self._last_ns) * 1e-9, 0.0), LONGEST_S)
        self._last_ns = now_ns
        known = measured if _is_finite(measured) else None
        if command is None or not _is_finite(command):
            self._forget(known or self.expected, now_ns)
            return command or Twist()
        command = self._within_reach(command)
        told = None if sent is None else twist_from_wheel_speeds(sent.wheel_speeds, self._track)
        self._forward.advance(now_ns, None if told is None else told.v)
        self._turn.advance(now_ns, None if told is None else told.omega)
        if known is not None:
            self._note_motion(known, command, seconds, now_ns)
        if command == Twist():
            return self._stand(seconds, now_ns)
        trim = Twist(self._forward.integral, self._turn.integral)
        if known is not None and not self.waiting:
            trim = self._trim(command, known, seconds, frozen=told == Twist() and self.moves(known))
        # what was learnt at speed must not push a chair that crawls, or backs off from somebody, the other way
        along = trim.v if (command.v + trim.v) * command.v >= 0.0 else -command.v
        return Twist(self._forward.ask(command.v, along, now_ns), self._turn.ask(command.omega, trim.omega, now_ns))

    def _within_reach(self, command: Twist) -> Twist:
        """The same arc, so slowly that there is room for trims: an axis at its end could not be steered any more."""
        s = self._settings
        room = 1.0 - s.reserve
        parts = abs(command.v) / (room * s.reach_v), abs(command.omega) / (room * s.reach_omega), 1.0
        return Twist(command.v / max(parts), command.omega / max(parts))

    def _trim(self, command: Twist, measured: Twist, seconds: float, frozen: bool) -> Twist:
        """PI of both errors, and the line.

        A chair that coasts with both axes in their dead bands teaches nothing; one that stands there is pushed out of
        them, once its brake has had its time. While it drives on, the turn axis must be able to leave its own. Casters
        that swing round push, which is no asymmetry: only the integral waits for them, and only while they can swing.
        """
        error = Twist(self._forward.mean - measured.v, self._turn.mean - measured.omega)
        swinging = self.casters_swing and self.moves(measured)
        hold = self._line.step(error.omega, measured.v, seconds) if _is_straight(command) else self._line.forget()
        return Twist(
            self._forward.trim(error.v, seconds, frozen),
            self._turn.trim(error.omega + hold, seconds, frozen or swinging),
        )

    def _stand(self, seconds: float, now_ns: int) -> Twist:
        self._line.forget()
        for axis in (self._forward, self._turn):
            axis.integral *= math.exp(-axis.gains.integral * seconds)
            axis.ask(0.0, 0.0, now_ns)
        return Twist()

    def _forget(self, measured: Twist, now_ns: int) -> None:
        self._line.forget()
        self._at_rest, self._waiting_since_ns = not self.moves(measured), None
        for axis, speed in ((self._forward, measured.v), (self._turn, measured.omega)):
            axis.integral = 0.0
            axis.restart(speed, 0.0, now_ns)

    def _note_motion(self, measured: Twist, command: Twist, seconds: float, now_ns: int) -> None:
        """Whether the chair rests, waits for its brake to open, or moves; and which way its casters trail."""
        s = self._settings
        if self.moves(measured):
            if self.waiting:  # only now does the chair begin to do what it was told, and its delay is over
                self._set_off(measured, command, now_ns)
            self._at_rest, self._waiting_since_ns = False, None
        elif command == Twist():
            self._at_rest = self._at_rest or not self.moves(self.expected)
            self._waiting_since_ns = None
        elif self._at_rest:
            self._at_rest, self._waiting_since_ns = False, now_ns
        elif self._waiting_since_ns is not None:
            patience = s.brake_s + max(s.forward.delay_s, s.turn.delay_s)
            if now_ns - self._waiting_since_ns > patience * 1e9:
                self._set_off(measured, command, now_ns)
                self._waiting_since_ns = None
        direction = math.copysign(1.0, measured.v) if abs(measured.v) > s.moving_v else self._direction
        if direction * self._direction < 0.0:
            self._caster_way = s.caster_way
        self._caster_way = max(0.0, self._caster_way - abs(measured.v) * seconds)
        self._direction = direction

    def _set_off(self, measured: Twist, command: Twist, now_ns: int) -> None:
        self._forward.restart(measured.v, command.v, now_ns)
        # a chair that was to set off straight has lost what it turned meanwhile
        self._turn.restart(0.0 if _is_straight(command) else measured.omega, command.omega, now_ns)

    def moves(self, twist: Twist) -> bool:
        """Whether a measured twist is motion for certain."""
        return abs(twist.v) > self._settings.moving_v or abs(twist.omega) > self._settings.moving_omega


class _Line:
    """The line that a straight drive began on, by the speeds that were missed since."""

    def __init__(self, turn_gains: Gains, settings: SpeedLoopSettings) -> None:
        self._gains = turn_gains
        self._settings = settings
        self.forget()

    def forget(self) -> float:
        """The next step begins a new line; asks for no turn."""
        self._heading = 0.0  # [rad] that the chair has turned too little
        self._right = 0.0  # [m] that it is right of the line
        return 0.0

    def step(self, missed: float, v: float, seconds: float) -> float:
        """Turn rate [rad/s] back to the line, when a rate of `missed` [rad/s] was lost at a speed of v [m/s]."""
        s = self._settings
        self._heading += missed * seconds
        self._right += v * math.sin(self._heading) * seconds
        # Heading back to the line by so much more than along it; backwards it leads there the other way round.
        back = math.copysign(self._gains.line / max(abs(v), _LEAST_V), v) * self._right
        return _limited(self._gains.heading * (self._heading + _limited(back, s.line_angle)), s.hold_omega)


def _is_straight(command: Twist) -> bool:
    return abs(command.omega) < _STRAIGHT and command.v != 0.0


def _is_finite(twist: Twist) -> bool:
    return math.isfinite(twist.v) and math.isfinite(twist.omega)


def _limited(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
