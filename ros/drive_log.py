"""The bridge's black box: what its chair was told, heard and did, as `waychair why` reads it.

The bridge knows all of that but the way, which comes with the navigator's requests.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np

from waychair.control.navigator import Navigation, Stage
from waychair.control.supervisor import Verdict
from waychair.errors import BoxError
from waychair.ros.messages.chair import DriveRequest
from waychair.ros.messages.reports import Level, Report
from waychair.runtime.black_box import About, BlackBox, BlackBoxSettings
from waychair.runtime.chair import ChairState
from waychair.runtime.drive_base import DriveBase, Driven, Message
from waychair.slam.localisation import Localisation
from waychair.types import Goal, Path, Telemetry, Twist

_STAGES = {stage.value: stage for stage in Stage}


@dataclass(frozen=True, slots=True)
class Decided:
    """What came of a tick of the bridge: the request with its speeds that it answers, and who drives by it."""

    now_ns: int
    request: DriveRequest
    asked: Twist
    located: Localisation | None
    verdict: Verdict
    driven: Driven
    telemetry: Telemetry | None


class DriveLog:
    """A black box round a `DriveBase`. It neither waits nor raises: a chair drives on without its log (F27)."""

    def __init__(self, folder: FilePath, about: About, settings: BlackBoxSettings) -> None:
        """One that cannot be begun is reported, and logs nothing."""
        self._folder, self._problem = folder, ""
        self._heard: list[Message] = []
        self._box: BlackBox | None = None
        try:
            self._box = BlackBox(folder, about, settings).__enter__()
        except BoxError as error:
            self._problem = str(error)

    def close(self) -> None:
        """End the log."""
        if self._box is not None:
            self._box.__exit__(None, None, None)

    def hear(self, message: Message) -> None:
        """What a sensor says, by the steady clock."""
        if self._box is not None:
            self._heard.append(message)

    def told(self, what: str, goals: tuple[Goal, ...] = ()) -> None:
        """Somebody asked for something: go, confirm, stop or reset; a cancel is the navigator's, and ends its request."""
        if self._box is not None:
            self._box.told(what, goals)

    def note(self, base: DriveBase, decided: Decided) -> None:
        """A tick is over."""
        if self._box is None:
            return
        heard, self._heard = tuple(self._heard), []
        self._box.note(heard, _state(base, decided), base.bridge.greeting)

    def report(self) -> Report:
        """Whether it logs."""
        box = self._box
        problem = self._problem or ("" if box is None else box.problem)
        lost = 0 if box is None else box.lost
        values = (("folder", str(self._folder)), ("ticks lost", str(lost)))
        return Report("black box", Level.WARN if problem else Level.OK, problem, values)


def _state(base: DriveBase, decided: Decided) -> ChairState:
    request, driven = decided.request, decided.driven
    way = Path(np.array([request.goal.array()])) if request.active else None
    stage = _STAGES.get(request.stage, Stage.IDLE)
    return ChairState(
        stamp_ns=decided.now_ns,
        map_from_base=base.map_from_base(decided.now_ns),
        twist=base.twist,
        localisation=decided.located,
        verdict=decided.verdict,
        halts=base.halts,
        navigation=Navigation(stage, decided.asked, request.reason, way, request.plans, goals=int(request.active)),
        command=driven.command,
        sent=driven.sent,
        telemetry=decided.telemetry,
    )
