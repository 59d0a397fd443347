"""The adapter of simulated lifts: it serves requests as Open-RMF's lift adapters do, and tells the lifts' states.

A lift serves one session at a time. In a session it goes to the floor that was asked for and keeps its door open there. A session
that has not been heard for a while is over, since its requester may have died.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from waychair.errors import WorldError
from waychair.ros.messages.lifts import DoorState, LiftMode, LiftRequest, LiftState, MotionState, RequestType
from waychair.simulation.lifts.lifts import Lifts

SESSION_S = 5.0
"""s; a session ends so long after its last request."""

PRESS_S = 1.0
"""s; a car that does not come to a session's floor is called again after this time."""


STATES_S = 0.5
"""s; time between two states of a lift."""


@dataclass(slots=True)
class _Session:
    request: LiftRequest
    heard_ns: int
    pressed_ns: int = -(10**12)


class SimulatedLiftAdapter:
    """Requests to `lifts` in, states out; stamps are those of the node's clock.

    `hear` may be called from any thread, all else from that of the lifts.
    """

    def __init__(self, lifts: Lifts, warn: Callable[[str], object]) -> None:
        """`warn` is told why a request cannot be served."""
        self._lifts, self._warn = lifts, warn
        self._sessions: dict[str, _Session] = {}
        self._heard: deque[LiftRequest] = deque()
        self._told_ns = -(10**12)

    def hear(self, request: LiftRequest) -> None:
        """Take in a request, for the next step."""
        self._heard.append(request)

    def _take(self, request: LiftRequest, now_ns: int) -> None:
        """Take a request; one of a second session is not taken before the first is over."""
        known = self._lifts.lifts.get(request.lift)
        if known is None or (request.kind is not RequestType.END_SESSION and request.floor not in known.stops):
            self._warn(f"lift '{request.lift}' does not stop at '{request.floor}': see lift_states")
            return
        session = self._sessions.get(request.lift)
        if session is not None and session.request.session != request.session:
            return
        if request.kind is RequestType.END_SESSION:
            self._end(request.lift)
        else:
            pressed_ns = (
                session.pressed_ns if session is not None and session.request.floor == request.floor else -(10**12)
            )
            self._sessions[request.lift] = _Session(request, now_ns, pressed_ns)

    def step(self, now_ns: int) -> tuple[LiftState, ...]:
        """Move the lifts as their sessions ask, and return the lifts' states if they are due."""
        while self._heard:
            self._take(self._heard.popleft(), now_ns)
        for lift, session in tuple(self._sessions.items()):
            if now_ns - session.heard_ns > SESSION_S * 1e9:
                self._end(lift)
                continue
            view, floor = self._lifts.view(lift), session.request.floor
            there = not view.riding and view.level == floor
            holds = there and session.request.kind is RequestType.AGV and session.request.door is DoorState.OPEN
            self._lifts.hold(lift, session.request.session, holds)
            if (not there or view.opened < 1.0) and now_ns - session.pressed_ns > PRESS_S * 1e9:
                session.pressed_ns = now_ns
                try:
                    self._lifts.call(lift, floor)
                except WorldError as error:
                    self._warn(str(error))
        if now_ns - self._told_ns < STATES_S * 1e9:
            return ()
        self._told_ns = now_ns
        return self.states(now_ns)

    def states(self, now_ns: int) -> tuple[LiftState, ...]:
        """Return the states of all lifts."""
        return tuple(self._state(lift, now_ns) for lift in self._lifts.lifts)

    def _state(self, lift: str, now_ns: int) -> LiftState:
        view, known, session = self._lifts.view(lift), self._lifts.lifts[lift], self._sessions.get(lift)
        came_from = self._lifts.came_from(lift)
        motion = MotionState.STOPPED
        if view.riding:
            up = known.stops.index(view.level) > known.stops.index(came_from)
            motion = MotionState.UP if up else MotionState.DOWN
        door = {0.0: DoorState.CLOSED, 1.0: DoorState.OPEN}.get(view.opened, DoorState.MOVING)
        return LiftState(
            stamp_ns=now_ns,
            lift=lift,
            floors=known.stops,
            floor=came_from if view.riding else view.level,
            destination=view.level if session is None else session.request.floor,
            door=door,
            motion=motion,
            mode=LiftMode.HUMAN if session is None else LiftMode.AGV,
            session="" if session is None else session.request.session,
        )

    def _end(self, lift: str) -> None:
        session = self._sessions.pop(lift, None)
        if session is not None:
            self._lifts.hold(lift, session.request.session, held=False)
