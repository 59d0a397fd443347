"""The bridge's black box: a record of requests, sensor messages and commands, for `waychair why`.

The bridge does not know the planned path; the record holds only the goal, from the navigator's requests.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np

from waychair.control.drive.navigator import Navigation, Stage
from waychair.control.safety.supervisor import SupervisorVerdict
from waychair.errors import BoxError
from waychair.ros.messages.chair import DriveRequest
from waychair.ros.messages.reports import DiagnosticLevel, Report
from waychair.runtime.black_box.recorder import BlackBox, BlackBoxSettings, LoggedChair
from waychair.runtime.chair import ChairState
from waychair.runtime.drive_base import ChairMessage, DriveBase, DriveResult
from waychair.slam.localising.localisation import Localisation
from waychair.types import Goal, Path, Telemetry, Twist

_STAGES = {stage.value: stage for stage in Stage}


@dataclass(frozen=True, slots=True)
class TickRecord:
    """The result of a tick of the bridge: the navigator's request and speeds, the verdict, and the command."""

    now_ns: int
    request: DriveRequest
    asked: Twist
    located: Localisation | None
    verdict: SupervisorVerdict
    driven: DriveResult
    telemetry: Telemetry | None


class BridgeLog:
    """A black box of a `DriveBase`. It neither waits nor raises: the chair keeps driving if logging fails (F27)."""

    def __init__(self, folder: FilePath, about: LoggedChair, settings: BlackBoxSettings) -> None:
        """Start the log; if that fails, the problem is reported and nothing is logged."""
        self._folder, self._problem = folder, ""
        self._messages: list[ChairMessage] = []
        self._box: BlackBox | None = None
        try:
            self._box = BlackBox(folder, about, settings).__enter__()
        except BoxError as error:
            self._problem = str(error)

    def close(self) -> None:
        """End the log."""
        if self._box is not None:
            self._box.__exit__(None, None, None)

    def add_message(self, message: ChairMessage) -> None:
        """Record a sensor's message, stamped by the steady clock."""
        if self._box is not None:
            self._messages.append(message)

    def note_request(self, what: str, goals: tuple[Goal, ...] = ()) -> None:
        """Record a request: go, confirm, stop or reset. A cancel shows as the end of the navigator's request."""
        if self._box is not None:
            self._box.note_request(what, goals)

    def add_tick(self, base: DriveBase, decided: TickRecord) -> None:
        """Record a finished tick."""
        if self._box is None:
            return
        messages, self._messages = tuple(self._messages), []
        self._box.note_tick(messages, _state(base, decided), base.bridge.greeting)

    def report(self) -> Report:
        """Report whether logging works."""
        box = self._box
        problem = self._problem or ("" if box is None else box.problem)
        lost = 0 if box is None else box.lost
        values = (("folder", str(self._folder)), ("ticks lost", str(lost)))
        return Report("black box", DiagnosticLevel.WARN if problem else DiagnosticLevel.OK, problem, values)


def _state(base: DriveBase, decided: TickRecord) -> ChairState:
    request, driven = decided.request, decided.driven
    way = Path(np.array([request.goal.array()])) if request.active else None
    stage = _STAGES.get(request.stage, Stage.IDLE)
    return ChairState(
        stamp_ns=decided.now_ns,
        map_from_base=base.motion.map_from_base(decided.now_ns),
        twist=base.motion.twist,
        localisation=decided.located,
        verdict=decided.verdict,
        halts=base.halts,
        navigation=Navigation(
            stage=stage,
            twist=decided.asked,
            reason=request.reason,
            path=way,
            plans=request.plans,
            goals=int(request.active),
        ),
        command=driven.command,
        sent=driven.sent,
        telemetry=decided.telemetry,
    )
