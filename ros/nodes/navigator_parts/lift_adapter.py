"""The lifts of a building by their adapters, over the topics of Open-RMF; where there are none, a person presses the buttons."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from waychair.ros import topics
from waychair.ros.messages.lifts import (
    DoorState,
    LiftRequest,
    LiftState,
    MotionState,
    RequestType,
    lift_request,
    read_lift_state,
)
from waychair.ros.nodes.node import ChairNode

REPEAT_S = 1.0
"""s; a session's request is repeated so often, since an adapter may not have heard it."""

TOLD_S = 3.0
"""s; an older state of a lift tells nothing."""


@dataclass(slots=True)
class _Session:
    """A session with a lift: its last request, when it was sent, whether the door was held, and is let go in this tick."""

    request: LiftRequest
    sent_ns: int
    held: bool = False
    ends: bool = False


class LiftAdapter:
    """A `LiftPort` over `lift_requests` and `lift_states`."""

    def __init__(self, node: ChairNode[Any]) -> None:
        self._node = node
        self._send: Callable[[Any], None] = node.publisher(topics.LIFT_REQUESTS)
        self._states: dict[str, tuple[int, LiftState]] = {}
        self._sessions: dict[str, _Session] = {}
        node.listen(topics.LIFT_STATES, read_lift_state, self._take, needed=False)

    def call(self, lift: str, storey: str) -> None:
        """See `LiftPort`."""
        now_ns = self._node.now_ns()
        request = LiftRequest(now_ns, lift, self._node.get_fully_qualified_name(), RequestType.AGV, storey)
        self._sessions[lift] = _Session(request, now_ns)
        self._send(lift_request(request))

    def hold(self, lift: str, held: bool) -> None:
        """See `LiftPort`; a session ends once its door was held and is let go, and nobody calls in the same tick."""
        session, now_ns = self._sessions.get(lift), self._node.now_ns()
        if session is None:
            return
        if held:
            session.held, session.ends = True, False
            session.request = replace(session.request, floor=self.said(lift) or session.request.floor)
        elif session.ends:
            self.end(lift)
            return
        else:
            session.ends = session.held  # unless a call in this tick makes a ride of it
        if now_ns - session.sent_ns > REPEAT_S * 1e9:
            session.sent_ns = now_ns
            self._send(lift_request(replace(session.request, stamp_ns=now_ns)))

    def said(self, lift: str) -> str | None:
        """See `LiftPort`."""
        arrived_ns, state = self._states.get(lift, (0, None))
        if state is None or self._node.now_ns() - arrived_ns > TOLD_S * 1e9:
            return None
        stands = state.motion is MotionState.STOPPED and state.door is DoorState.OPEN
        return state.floor if stands else None

    def end(self, lift: str) -> None:
        """End the session with a lift, if there is one."""
        session = self._sessions.pop(lift, None)
        if session is not None:
            ends = replace(session.request, stamp_ns=self._node.now_ns(), kind=RequestType.END_SESSION)
            self._send(lift_request(ends))

    def end_all(self) -> None:
        """End all sessions."""
        for lift in tuple(self._sessions):
            self.end(lift)

    def _take(self, state: LiftState) -> None:
        self._states[state.lift] = self._node.now_ns(), state
