"""Speed control of the chair and its fault checks, from the wanted twist to the twist that is sent.

In each tick the speed loop trims the command, and two watches compare the sent command with the chair's motion. A fault
commands exactly 0 until it is acknowledged.
"""

from __future__ import annotations

from waychair.calibration.fits.dac import DacModel
from waychair.calibration.fits.stopping import StopTable
from waychair.control.answer_time import AnswerTime
from waychair.control.speed.following_faults import FollowingWatch
from waychair.control.speed.gain_watch import GainWatch
from waychair.control.speed.kinematics import twist_from_wheel_speeds
from waychair.control.speed.speed_loop import SpeedLoop, SpeedLoopSettings, chair_response
from waychair.control.speed.wheel_signs import BOTH_DEAD, WheelSigns
from waychair.types import Pose2, SentCommand, Twist


class ClosedLoop:
    """The speed loop and its watches."""

    def __init__(
        self,
        model: DacModel,
        track: float,
        settings: SpeedLoopSettings | None = None,
        stops: StopTable | None = None,
    ) -> None:
        """Take delays and lags from the calibration (`model` and `stops`) as far as there is one; see `chair_response`.

        `track` [m] is the distance between the chair's drive wheels.
        """
        self._response = chair_response(model, stops)
        self._track = track
        self._loop = SpeedLoop(settings, track, self._response)
        self._answers, self._late_s = AnswerTime(track, 0.0), 0.0  # beside the answers that the response expects
        self.acknowledge()

    @property
    def fault(self) -> str:
        """The reason for which the chair must not be driven, with its remedy; empty when it may be."""
        return self._fault

    @property
    def speed_limit(self) -> float:
        """Highest allowed speed [m/s] now; +inf while the gains are trusted."""
        return self._gain_watch.speed_limit

    @property
    def gains(self) -> tuple[float, float]:
        """Estimated gains of the forward and the turn axis; 1 as calibrated."""
        return self._gain_watch.gains

    def acknowledge(self) -> None:
        """Clear the fault, which somebody has dealt with, and start both watches again."""
        forward, turn = self._response.forward, self._response.turn
        self._gain_watch = GainWatch(forward, turn)
        self._following = FollowingWatch(forward, turn, self._track)
        self._signs = WheelSigns(self._track)
        self._fault = ""

    def locate(self, stamp_ns: int, map_from_base: Pose2, odom_from_base: Pose2) -> None:
        """Take in the pose by the scans at a stamp, and that by the odometry, to judge the wheel encoders by."""
        self._signs.locate(stamp_ns, map_from_base, odom_from_base)

    def change_map(self) -> None:
        """Forget the poses on the last map."""
        self._signs.forget_places()

    def step(
        self,
        command: Twist | None,
        measured: Twist,
        now_ns: int,
        sent: SentCommand | None = None,
        wheels: tuple[float, float] | None = None,
    ) -> Twist:
        """Return the twist to send in this tick, exactly 0 while there is a `fault`.

        `command` None means that the computer does not drive. `measured` is the mean twist since the last call, and
        `sent` is the result of the twist that was returned then. `wheels` are the paths [m] of the left and right wheel
        since the last call, None without a reading.
        """
        held = sent is not None and sent.active
        sent_twist = twist_from_wheel_speeds(sent.wheel_speeds, self._track) if sent is not None and held else Twist()
        if self.fault:
            command = None
        if command is not None:
            command = _slowed(command, self.speed_limit)
        twist = self._loop.step(command, measured, now_ns, sent if held else None)
        steady = held and not self._loop.waiting and not self._loop.casters_swing
        # a chair that stands although it is commanded to drive is stuck, not slow
        self._gain_watch.step(sent_twist, measured, now_ns, judged=steady and self._loop.moves(measured))
        self._note_answer(measured if steady else None)
        self._signs.step(self._gain_watch.expected, wheels, now_ns, judged=steady)
        if not held:
            self._following.released()
        elif sent_twist == Twist():
            self._following.at_neutral(measured, now_ns)
        else:
            expected = None if self._loop.waiting else self._loop.expected
            self._following.driving(sent_twist, expected, measured, now_ns)
        self._fault = self._fault or self._found()
        return Twist() if self.fault else twist

    def _note_answer(self, measured: Twist | None) -> None:
        """Compare the motion with what was sent, so that the loop takes no late answer for a lack of speed."""
        self._answers.note(self._gain_watch.expected, measured)
        if self._answers.late_s != self._late_s:
            self._late_s = self._answers.late_s
            self._loop.answer_late(self._late_s)

    def _found(self) -> str:
        """Return the fault of this tick by its cause: wrong encoders also look like a stuck chair or another gain."""
        if self._signs.fault:
            return self._signs.fault
        if self._following.stuck and self._signs.blind_standstill():
            return BOTH_DEAD
        return self._following.fault or self._gain_watch.fault


def _slowed(command: Twist, limit: float) -> Twist:
    """Return the twist of the same arc at no more than `limit` [m/s]."""
    scale = min(1.0, limit / max(abs(command.v), 1e-9))
    return Twist(scale * command.v, scale * command.omega)
