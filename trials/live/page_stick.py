"""The page's stick of a simulated chair: while the rider has chosen the guard it moves the chair's own joystick, through the board.

So somebody at the page is led as a rider is: the board clamps the stick within its caps. At the level inform, and while the computer
drives, the page's stick steers through the computer, as on a real chair.
"""

from __future__ import annotations

from waychair.control.drive.steering import Steering, SteeringSettings
from waychair.control.safety.guard import GUARDED
from waychair.control.safety.supervisor import DRIVEN
from waychair.runtime.chair import Chair
from waychair.runtime.haptics.haptic_guide import UNGUARDED
from waychair.runtime.pages.chair_port import ChairView, PortAnswer
from waychair.runtime.rider.sentences import sentence
from waychair.simulation.simulator import Simulator
from waychair.trials.live.real_time import RealTimeLoop
from waychair.types import JoystickInput, Twist


class PageStick:
    """One chair's stick on the page; a silence counts as a release. It is used in the chair's own thread."""

    def __init__(self, chair: Chair, simulator: Simulator, *, has_rider: bool) -> None:
        """`has_rider`: somebody else moves the chair's own joystick: a simulated driver, or a person by one of this computer."""
        self._chair, self._simulator, self._has_rider = chair, simulator, has_rider
        self._own = Steering(SteeringSettings(speed=1.0, reverse=1.0, turn=1.0))  # its twists are shares of the swing
        self._pushes = False

    def is_own(self, view: ChairView) -> bool:
        """Whether the page's stick is the chair's own now."""
        return not self._has_rider and self._chair.level in GUARDED and view.mode not in DRIVEN

    def push(self, forward: float, turn: float, *, own: bool) -> None:
        """Take the stick's position, each axis in [-1, 1], left positive."""
        now_ns = self._simulator.now_ns
        if own:
            self._own.push(forward, turn, now_ns)
        else:
            self._chair.steer(forward, turn, now_ns)

    def let_go(self) -> None:
        """Note that the stick was let go."""
        self._own.let_go(self._simulator.now_ns)
        self._chair.let_go(self._simulator.now_ns)

    def end(self) -> None:
        """End a push of the chair's own joystick; it counts again after a release."""
        self._own.end()

    def beat(self, simulator: Simulator) -> None:
        """Move the chair's own joystick; to be called at each heartbeat. Nothing passes unless the board guards."""
        telemetry = self._chair.bridge.telemetry
        if self._chair.level not in GUARDED or telemetry is None or telemetry.guard is None:
            self.end()
        asked = self._own.twist(simulator.now_ns)
        pushes = asked != Twist()
        if pushes or self._pushes:
            simulator.rider = JoystickInput(simulator.now_ns, asked.v, asked.omega)
        self._pushes = pushes


class PageStickPort:
    """The part of a `ChairPort` with the page's stick, for a simulated chair that runs in real time."""

    _loop: RealTimeLoop
    _page_stick: PageStick
    _view: ChairView

    def _give_stick(self, chair: Chair, simulator: Simulator, *, has_rider: bool) -> PageStick:
        """Return the page's stick of a chair, which this serves from now on; see `PageStick`."""
        self._page_stick = PageStick(chair, simulator, has_rider=has_rider)
        return self._page_stick

    def steer(self, forward: float, turn: float) -> PortAnswer:
        """See `ChairPort`; the answer is based on the last tick."""
        view = self._view
        own = self._page_stick.is_own(view)
        self._loop.tell(lambda: self._page_stick.push(forward, turn, own=own))
        if own:
            waits = view.guard is not None and view.guard.waits
            return PortAnswer(not waits, sentence(UNGUARDED) if waits else "")
        if view.steered or not view.obstacles:
            return PortAnswer(True, "")
        return PortAnswer(False, view.obstacles[0].sentence)

    def release(self) -> PortAnswer:
        """See `ChairPort`."""
        self._loop.tell(self._page_stick.let_go)
        return PortAnswer(True, "")
