"""The rider's input of a tick: a goal, the yes to it, Stop, the chair's own joystick and that of a page."""

from __future__ import annotations

from waychair.control.drive.steering import Steering, SteeringSettings
from waychair.control.safety.arming import Arming
from waychair.control.safety.stops import Halt
from waychair.control.safety.supervisor import Override, Situation, SupervisorSettings, SupervisorVerdict
from waychair.types import JoystickInput


class RiderInput:
    """The rider's requests since the last tick, and the joysticks' state; `steering` is that of a page's joystick.

    `arming` watches whether the chair's own joystick lets the computer have the lines.
    """

    def __init__(self, settings: SupervisorSettings, steering: SteeringSettings) -> None:
        self.steering = Steering(steering)
        self.arming = Arming(settings)
        self._override = Override(settings)
        self._countdown_s = settings.countdown_s
        self._motion_from_ns: int | None = None  # the confirmed drive may move from this stamp on
        self._requested = self._confirmed = self._stop_pressed = False

    def request(self) -> None:
        """Note that another goal was asked for: it waits for a `confirm` of its own."""
        self._requested, self._confirmed, self._stop_pressed = True, False, False
        self.steering.end()

    def confirm(self) -> None:
        """Take the rider's yes to the goal."""
        self._confirmed = True

    def stop(self) -> None:
        """Take the rider's Stop; it holds until a new goal is asked for or a page steers."""
        self._stop_pressed = True
        self.steering.end()

    def steer(self, forward: float, turn: float, now_ns: int) -> bool:
        """Take the position of a page's joystick; return whether a new push begins, which ends a Stop."""
        begins = self.steering.push(forward, turn, now_ns)
        if begins:
            self._stop_pressed = False
        return begins

    def takes_over(self, stick: JoystickInput | None) -> bool:
        """Take in the chair's own joystick, once a tick; return whether the rider pushes it."""
        return self._override.update(stick)

    def situation(
        self,
        now_ns: int,
        stick: JoystickInput | None,
        taken_over: bool,
        goal_active: bool,
        halts: tuple[Halt, ...],
        guarded: bool = False,
    ) -> Situation:
        """Return the supervisor's input of this tick; request and yes count once. `guarded`: see `Situation`."""
        situation = Situation(
            joystick=stick,
            taken_over=taken_over,
            stop_pressed=self._stop_pressed,
            goal_active=goal_active,
            requested=self._requested,
            confirmed=self._confirmed,
            halts=halts,
            steered=self.steering.counts(now_ns),
            guarded=guarded,
        )
        self._requested = self._confirmed = False
        return situation

    def obey(self, now_ns: int, situation: Situation, verdict: SupervisorVerdict) -> None:
        """End the page's push if it may not drive, and begin the countdown of a confirmed drive."""
        if situation.steered and not verdict.steered:
            self.steering.end()
        if not verdict.computer_drives or verdict.steered:
            self._motion_from_ns = None
        elif situation.confirmed:
            self._motion_from_ns = now_ns + round(self._countdown_s * 1e9)

    def countdown_s(self, now_ns: int) -> float | None:
        """Return the time until a drive that has begun may move [s]; None outside the countdown."""
        if self._motion_from_ns is None or now_ns >= self._motion_from_ns:
            return None
        return (self._motion_from_ns - now_ns) * 1e-9
