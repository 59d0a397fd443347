"""The speed loop: feed-forward, PI and heading hold over an undocumented chair controller.

The inverse of the calibration, applied later, is the feed-forward: a command goes out as it is, plus a trim. The trim
is a PI of the speed expected by now (`ExpectedSpeed`) less the measured speed, so a step that the chair follows as
expected causes no trim. On a straight command the turn axis also corrects the heading error and the lateral offset from
the line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from waychair.calibration.fits.dac import DacModel
from waychair.calibration.fits.fitted_dac import DeadBand, FittedDac
from waychair.calibration.fits.stopping import StopTable
from waychair.config import Settings, setting
from waychair.control.speed.axis_response import LONGEST_STEP_S, AxisResponse, ExpectedSpeed, response_from_axis
from waychair.control.speed.kinematics import twist_from_wheel_speeds
from waychair.types import SentCommand, Twist

HOLD_SHARE = 0.25
"""Heading hold's gain as a share of the crossover: its loop round the speed loop is four times slower."""

LINE_SHARE = 0.25
"""Line hold's gain as a share of the heading hold's: once more four times slower."""

PHASE_MARGIN = math.radians(67.5)
"""rad; phase margin of either axis at the identified gain. It leaves 45 degrees at twice that gain."""

FASTEST_CROSSOVER = 4.0
"""rad/s; crossover of a chair without delay."""

PERIOD_S = 0.05
"""s; the tick. Half of it is the delay of the held command, half that of the mean speed."""

RESERVE = 0.1
"""Share of the top speed that is left to the trims."""

HOLD_OMEGA = 0.15
"""rad/s; largest turn rate of heading and line hold together."""

LINE_ANGLE = 0.1
"""rad; steepest heading back to the line."""

_QUANTUM = (0.03, 0.06)  # m/s, rad/s; rounding makes sent and asked speeds differ by less
_MOVING = (0.03, 0.06)  # m/s, rad/s; a larger measured speed is certainly motion
_STRAIGHT = 1e-3  # rad/s
_LEAST_V = 0.3  # m/s; at lower speeds the return to the line is no sharper


@dataclass(frozen=True, slots=True)
class Gains:
    """Gains of one axis: trim = proportional e + integral (integral of e); heading and line hold [1/s] of the turn
    axis."""

    proportional: float
    integral: float
    heading: float
    line: float


def gains(delay_s: float, lag_s: float, margin: float, fastest: float = math.inf) -> Gains:
    """Return gains for an axis with a whole delay [s] and a lag [s] that keep a phase margin [rad].

    The PI's zero cancels the lag: C = w (lag s + 1) / s makes the loop L = w exp(-delay s) / s. Its magnitude is 1 at
    w, where its phase is -pi/2 - w delay. The phase margin pi/2 - w delay is the wanted one at

        w = (pi/2 - margin) / delay        proportional = w lag, integral = w        (at most `fastest` [rad/s])

    A chair with K times the identified gain crosses at K w, with a margin of pi/2 - K (pi/2 - margin): 67.5 degrees
    leave 45 at twice the gain. (Internal model control with a first-order Pade gives the same controller, Rivera,
    Morari, Skogestad 1986; the zero on the lag and the delay as the only limit are Skogestad's rules, 2003.) The
    heading hold multiplies L by 1 + k/s, which costs atan(k/w) of the margin, 14 degrees at k = w/4.

    A Smith predictor that removes an asymmetry as fast keeps 4 degrees more at the identified gain and 8 more at twice
    the gain (`closed_loop_margins` of the acceptance). But it would put a model of dead band and ramps into the
    feedback, and this loop has that model in the reference only.
    """
    crossover = min((0.5 * math.pi - margin) / max(delay_s, 1e-3), fastest)
    return Gains(crossover * lag_s, crossover, HOLD_SHARE * crossover, HOLD_SHARE * LINE_SHARE * crossover)


@dataclass(frozen=True, slots=True)
class SpeedLoopSettings(Settings):
    """Limits of the trims, and the chair's parking brake and casters."""

    max_trim_v: float = setting(
        0.2, "m/s", "largest trim of the forward speed; larger: stronger disturbances are corrected", low=0.0, high=0.5
    )
    max_trim_omega: float = setting(
        0.4, "rad/s", "largest trim of the turning speed; larger: stronger asymmetry is corrected", low=0.0, high=1.0
    )
    brake_s: float = setting(
        0.6,
        "s",
        "longest time in which the parking brake opens; larger: the loop waits longer for motion",
        low=0.0,
        high=3.0,
    )
    caster_distance: float = setting(
        0.4,
        "m",
        "distance in which casters swing round after a reversal; larger: turn learning pauses longer",
        low=0.0,
        high=2.0,
    )


@dataclass(frozen=True, slots=True)
class ChairResponse:
    """The responses of both axes, and the chair's top speeds [m/s], [rad/s]; the defaults are without a calibration."""

    forward: AxisResponse = field(default_factory=AxisResponse)
    turn: AxisResponse = field(default_factory=AxisResponse)
    top_v: float = 10.0
    top_omega: float = 20.0


def chair_response(model: DacModel, stops: StopTable | None = None) -> ChairResponse:
    """Return the calibration's delays, lags, ramps and top speeds, with the defaults as far as it has none.

    A calibration's steps begin at rest, so that a parking brake's opening looks like delay. Stops involve no brake:
    their delay is an upper bound for a moving chair (it ends when 5 % of the speed is lost, later than the true delay).
    """
    if isinstance(model, DeadBand):
        model = model.model
    if not isinstance(model, FittedDac):
        return ChairResponse()
    longest = stops.delay_s if stops is not None else math.inf
    return ChairResponse(
        forward=response_from_axis(model.forward, longest) or AxisResponse(),
        turn=response_from_axis(model.turn, longest) or AxisResponse(),
        top_v=min(model.forward.reach(1.0), model.forward.reach(-1.0)),
        top_omega=min(model.turn.reach(1.0), model.turn.reach(-1.0)),
    )


def gains_of(response: AxisResponse) -> Gains:
    """Return the gains of an axis; the whole delay is its own, its possible excess and the tick's."""
    delay_s = response.delay_s + response.doubt_s + PERIOD_S
    return gains(delay_s, response.lag_s, PHASE_MARGIN, FASTEST_CROSSOVER)


class _Axis:
    """One axis: its expected speed and its trim."""

    def __init__(self, response: AxisResponse, limit: float, quantum: float) -> None:
        self.gains = gains_of(response)
        self.integral = 0.0
        self.mean = 0.0
        self._expected = ExpectedSpeed(response)
        self._response, self._limit, self._quantum = response, limit, quantum
        self._asked = (0.0, 0.0, 0)  # reference, with its trim, at [ns]
        self._shortfall = 0.0

    def answer_late(self, late_s: float) -> None:
        """Expect the chair's answers so much later than its response says, and forget the trim that the wrong expectation left."""
        self.integral = 0.0
        late = replace(self._response, delay_s=self._response.delay_s + late_s)
        self.gains = gains_of(late)
        self._expected.answer_by(late)

    def advance(self, now_ns: int, sent: float | None) -> None:
        """Advance the expected mean speed over the last tick, given the speed that was `sent` then.

        A difference between asked and sent speed beyond rounding (saturation, a slew limit) goes into the model as
        well. So the chair is not expected to do what was never sent, and nothing winds up.
        """
        reference, asked, asked_ns = self._asked
        shortfall = 0.0 if sent is None else sent - asked
        self._shortfall = shortfall if abs(shortfall) > self._quantum else 0.0
        self._expected.command(reference + self._shortfall, asked_ns)
        self.mean = self._expected.advance(now_ns)

    def trim(self, error: float, seconds: float, frozen: bool) -> float:
        """Return the PI's trim; the integral is kept while `frozen`, and never grows into saturation."""
        if not frozen and self._shortfall * error >= 0.0:
            self.integral = _limited(self.integral + self.gains.integral * seconds * error, self._limit)
        return _limited(self.gains.proportional * error + self.integral, self._limit)

    def ask(self, reference: float, trim: float, now_ns: int) -> float:
        """Remember and return the speed to send."""
        self._asked = (reference, reference + trim, now_ns)
        return reference + trim

    def restart(self, speed: float, reference: float, now_ns: int) -> None:
        """Restart the model from a speed, following the reference from now on."""
        self._expected.restart(speed, reference)
        self._asked = (reference, reference, now_ns)
        self.mean = self._expected.advance(now_ns)


class SpeedLoop:
    """The speed loop: both axes' trims and expected speeds, and the line hold."""

    def __init__(
        self,
        settings: SpeedLoopSettings | None = None,
        track: float = 0.54,
        response: ChairResponse = ChairResponse(),
    ) -> None:
        """`track` [m] is the distance between the wheels that the sent wheel speeds refer to."""
        s = self._settings = settings or SpeedLoopSettings()
        self._track, self._response = track, response
        self._forward = _Axis(response.forward, s.max_trim_v, _QUANTUM[0])
        self._turn = _Axis(response.turn, s.max_trim_omega, _QUANTUM[1])
        self._last_ns: int | None = None
        self._at_rest = True
        self._waiting_since_ns: int | None = None
        self._line = _Line(self._turn.gains)
        self._direction = 0.0
        self._casters_swing_m = 0.0

    @property
    def expected(self) -> Twist:
        """Mean twist that the chair should have had since the tick before, without any trim."""
        return Twist(self._forward.mean, self._turn.mean)

    @property
    def waiting(self) -> bool:
        """Whether the chair was told to start and has not moved yet, within the time that a brake may take."""
        return self._waiting_since_ns is not None

    @property
    def casters_swing(self) -> bool:
        """Whether the casters may still be swinging round after a reversal."""
        return self._casters_swing_m > 0.0

    def answer_late(self, late_s: float) -> None:
        """Expect the chair's answers so much later than its response says, from the next step on."""
        for axis in (self._forward, self._turn):
            axis.answer_late(late_s)
        self._line.gains = self._turn.gains

    def step(self, command: Twist | None, measured: Twist, now_ns: int, sent: SentCommand | None = None) -> Twist:
        """Return the command plus its trims; a command of None means that nobody drives, and resets the loop.

        `measured` is the mean twist since the last call. `sent` is the result of the twist that was returned then: its
        wheel speeds show saturation and dead band, which are unseen without it. A command of 0 gives exactly 0. A
        measurement that is not finite changes no trim. A command that is not finite is returned as it is, and the
        bridge refuses it.
        """
        seconds = 0.0 if self._last_ns is None else min(max((now_ns - self._last_ns) * 1e-9, 0.0), LONGEST_STEP_S)
        self._last_ns = now_ns
        known = measured if _is_finite(measured) else None
        if command is None or not _is_finite(command):
            self._forget(known or self.expected, now_ns)
            return command or Twist()
        command = self._within_reach(command)
        sent_twist = None if sent is None else twist_from_wheel_speeds(sent.wheel_speeds, self._track)
        self._forward.advance(now_ns, None if sent_twist is None else sent_twist.v)
        self._turn.advance(now_ns, None if sent_twist is None else sent_twist.omega)
        if known is not None:
            self._note_motion(known, command, seconds, now_ns)
        if command == Twist():
            return self._stand(seconds, now_ns)
        trim = Twist(self._forward.integral, self._turn.integral)
        if known is not None and not self.waiting:
            trim = self._trim(command, known, seconds, frozen=sent_twist == Twist() and self.moves(known))
        # a trim learnt at speed must not reverse the motion of a chair that crawls or backs away from somebody
        along = trim.v if (command.v + trim.v) * command.v >= 0.0 else -command.v
        return Twist(self._forward.ask(command.v, along, now_ns), self._turn.ask(command.omega, trim.omega, now_ns))

    def _within_reach(self, command: Twist) -> Twist:
        """Return the twist of the same arc, slow enough to leave room for trims: a saturated axis cannot be steered."""
        room, top = 1.0 - RESERVE, self._response
        parts = abs(command.v) / (room * top.top_v), abs(command.omega) / (room * top.top_omega), 1.0
        return Twist(command.v / max(parts), command.omega / max(parts))

    def _trim(self, command: Twist, measured: Twist, seconds: float, frozen: bool) -> Twist:
        """Return the trims of both axes: PI of the errors, and the line hold.

        The integrals are frozen while a moving chair coasts with both axes in their dead bands. A standing chair is
        pushed out of them once its brake has had its time. While it drives, the turn axis must be able to leave its
        dead band. Swinging casters push the chair, which is no asymmetry, so the turn integral waits until they have
        swung.
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
        """Note whether the chair rests, waits for its brake to open or moves, and in which direction its casters
        trail."""
        s = self._settings
        if self.moves(measured):
            if self.waiting:  # the chair starts only now, and its delay is over
                self._set_off(measured, command, now_ns)
            self._at_rest, self._waiting_since_ns = False, None
        elif command == Twist():
            self._at_rest = self._at_rest or not self.moves(self.expected)
            self._waiting_since_ns = None
        elif self._at_rest:
            self._at_rest, self._waiting_since_ns = False, now_ns
        elif self._waiting_since_ns is not None:
            patience = s.brake_s + max(self._response.forward.delay_s, self._response.turn.delay_s)
            if now_ns - self._waiting_since_ns > patience * 1e9:
                self._set_off(measured, command, now_ns)
                self._waiting_since_ns = None
        direction = math.copysign(1.0, measured.v) if abs(measured.v) > _MOVING[0] else self._direction
        if direction * self._direction < 0.0:
            self._casters_swing_m = s.caster_distance
        self._casters_swing_m = max(0.0, self._casters_swing_m - abs(measured.v) * seconds)
        self._direction = direction

    def _set_off(self, measured: Twist, command: Twist, now_ns: int) -> None:
        self._forward.restart(measured.v, command.v, now_ns)
        # for a straight start, the turn made meanwhile counts as an error
        self._turn.restart(0.0 if _is_straight(command) else measured.omega, command.omega, now_ns)

    def moves(self, twist: Twist) -> bool:
        """Return whether a measured twist is certainly motion."""
        return abs(twist.v) > _MOVING[0] or abs(twist.omega) > _MOVING[1]


class _Line:
    """The line on which a straight drive began, kept by integrating the missed turn rates."""

    def __init__(self, turn_gains: Gains) -> None:
        self.gains = turn_gains
        self.forget()

    def forget(self) -> float:
        """Start a new line with the next step; return a turn rate of 0."""
        self._heading = 0.0  # rad; missing turn to the left
        self._right = 0.0  # m; offset to the right of the line
        return 0.0

    def step(self, missed: float, v: float, seconds: float) -> float:
        """Return the turn rate [rad/s] back to the line, after a missed rate [rad/s] at a speed of v [m/s]."""
        self._heading += missed * seconds
        self._right += v * math.sin(self._heading) * seconds
        # The extra heading leads back to the line; backwards it has the other sign.
        back = math.copysign(self.gains.line / max(abs(v), _LEAST_V), v) * self._right
        return _limited(self.gains.heading * (self._heading + _limited(back, LINE_ANGLE)), HOLD_OMEGA)


def _is_straight(command: Twist) -> bool:
    return abs(command.omega) < _STRAIGHT and command.v != 0.0


def _is_finite(twist: Twist) -> bool:
    return math.isfinite(twist.v) and math.isfinite(twist.omega)


def _limited(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
