"""A simulated fleet of processes under supervision: a world, and a whole chair with its peer in each other process.

    with LiveFleet(folder, new_plan(folder, "T", 3, 0)) as fleet:
        while not fleet.finished and not fleet.ended:
            fleet.watch()

All of them talk over Zenoh on this computer. A process that dies is started again, and is named in the record.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from waychair.planning.fleet.rules import Priority
from waychair.planning.fleet.waits import Reason, Wait
from waychair.runtime.fleet.network.zenoh_transport import LocalBus
from waychair.runtime.processes import Process, Supervision
from waychair.trials.fleet.fleet_demo import FleetView, chair_view
from waychair.trials.fleet.fleet_drive import LOCKED_UP_S, ChairRun, FleetRun, FleetScene, beyond
from waychair.trials.fleet.live.live_plan import LivePlan
from waychair.trials.fleet.live.wire import ChairWord, WorldMoment, decoded
from waychair.types import FloatArray, Pose2

SILENT_S = 1.0
"""s without a word after which a chair's process counts as gone."""

WATCH_S, SUPERVISE_S = 0.05, 0.2

_RULES = {each.value: each for each in Reason}


@dataclass(slots=True)
class LiveRecord:
    """What happened in a fleet of processes, from the world's truth and the chairs' words."""

    scene: FleetScene
    run: FleetRun
    words: dict[int, ChairWord] = field(default_factory=dict)
    heard_s: dict[int, float] = field(default_factory=dict)
    moment: WorldMoment | None = None
    ended: list[tuple[float, str]] = field(default_factory=list)
    answers_ms: list[float] = field(default_factory=list)
    ages_ms: list[float] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)
    began_s: float | None = None
    _moved_s: float = 0.0
    _contacts: tuple[int, int, int] = (0, 0, 0)  # of worlds that have ended

    def note_word(self, number: int, word: ChairWord) -> None:
        """Take a chair's word."""
        self.words[number], self.heard_s[number] = word, time.monotonic()
        self.answers_ms += word.answers_ms
        self.ages_ms += word.ages_ms
        self.notices += [f"chair {number}: {each}" for each in word.notices]
        own = self.run.chairs[number - 1]
        own.reached, own.took_s, own.ends, own.again = word.reached, word.took_s, word.ends, word.again

    def note_moment(self, moment: WorldMoment) -> None:
        """Take a moment of the world."""
        last, self.moment = self.moment, moment
        if last is None:
            self.began_s = time.monotonic()
        elif last.boot != moment.boot:
            self._contacts = tuple(a + b for a, b in zip(self._contacts, last.contacts, strict=True))  # type: ignore[assignment]
        run, now_s = self.run, moment.now_ns * 1e-9
        passed_s = 0.0 if last is None else max(now_s - last.now_ns * 1e-9, 0.0)
        run.seconds = now_s
        for k, (own, pose) in enumerate(zip(run.chairs, self.poses, strict=True)):
            word = self.words.get(k + 1)
            held = word is not None and word.held
            person_m = moment.person_m[k] if moment.person_m[k] >= 0 else np.inf
            own.note_pose(now_s, pose, person_m, passed_s * held)
            line = self.line(k + 1)
            own.note_line(line, 0.0 if line is None else beyond(line, self.scene.body, pose))
        if moment.nearest >= 0:
            run.nearest = min(run.nearest, moment.nearest)
        counts = [a + b for a, b in zip(self._contacts, moment.contacts, strict=True)]
        run.chair_contacts, run.person_contacts, run.solid_contacts = counts
        run.audit.note(self.waits(), moment.now_ns // 1_000_000)
        if any(moment.moving) or now_s < self._moved_s:
            self._moved_s = now_s
        if now_s - self._moved_s > LOCKED_UP_S:
            run.lockups = 1

    @property
    def poses(self) -> list[Pose2]:
        """The chairs' true poses."""
        return [] if self.moment is None else [Pose2(*pose) for pose in self.moment.poses]

    def line(self, number: int) -> FloatArray | None:
        """Return a chair's stop line, as its living process last told."""
        word = self.words.get(number)
        return None if word is None or word.line is None else np.array(word.line)

    @property
    def is_moving(self) -> bool:
        """Whether any chair moves."""
        return self.moment is not None and any(self.moment.moving)

    def is_silent(self, number: int) -> bool:
        """Return whether a chair's process has said nothing for long."""
        return time.monotonic() - self.heard_s.get(number, -np.inf) > SILENT_S

    def waits(self) -> tuple[Wait, ...]:
        """Return all present waits."""
        found = []
        for number, word in self.words.items():
            if word.waits is None or self.is_silent(number):
                continue
            other, place, rule, foreseen_ms = word.waits
            found.append(
                Wait(
                    number,
                    None if other < 0 else other,
                    place,
                    _RULES.get(rule, Reason.FIRST),
                    (Priority.ROUTINE, None),
                    0,
                    None if foreseen_ms < 0 else foreseen_ms,
                )
            )
        return tuple(found)

    def view(self) -> FleetView | None:
        """Return what the page of all chairs shows; None before the world has begun."""
        if self.moment is None:
            return None
        chairs = []
        for k, pose in enumerate(self.poses):
            word = self.words.get(k + 1)
            told = "its program starts" if word is None else word.told
            if word is not None and self.is_silent(k + 1):
                told = "its program has ended, and is started again"
            reached = self.run.chairs[k].reached
            chairs.append(chair_view(self.scene, k, k + 1, pose, reached, self.line(k + 1), told))
        return FleetView(round(self.run.seconds, 1), tuple(chairs), tuple(self.moment.people))

    @property
    def factor(self) -> float:
        """The chairs' seconds for each real one."""
        if self.began_s is None or self.moment is None:
            return 0.0
        return self.run.seconds / max(time.monotonic() - self.began_s, 1e-3)


class LiveFleet:
    """The processes of a plan for as long as the block lasts."""

    def __init__(
        self,
        folder: Path,
        plan: LivePlan,
        report: Callable[[str], None] = lambda sentence: None,
        more: Sequence[Process] = (),
        environment: Mapping[str, str] | None = None,
    ) -> None:
        """`more`: further processes, such as the staff's desk or the router of a routed plan; `report` receives a sentence when
        one ends or begins.
        """
        scene = plan.scene()
        self.folder, self.plan = folder, plan
        self.record = LiveRecord(scene, FleetRun([ChairRun(len(goals)) for goals in scene.goals]))
        self.ended = ""
        self._report = report
        here = "waychair.trials.fleet.live"
        table = [Process("world", f"{here}.world_process", (str(folder),))]
        table += [
            Process(f"chair {number}", f"{here}.chair_process", (str(folder), str(number))) for number in plan.numbers
        ]
        self._supervision = Supervision([*more, *table], {**os.environ, **(environment or {})}, self._note)
        self._wake = threading.Event()
        self._stack = ExitStack()
        self._bus: LocalBus | None = None
        self._watched_s = 0.0

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(self._supervision)  # before any thread of Zenoh's
            self._bus = LocalBus(self.plan.bus, "supervisor", joins=True, hears=("moment", "word/*"), wake=self._wake)
            stack.callback(self._bus.close)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    @property
    def pids(self) -> dict[str, int]:
        """Process ids by the names of processes."""
        return dict(self._supervision.pids)

    @property
    def finished(self) -> bool:
        """Whether all goals are reached, or the chairs are locked up, or the scene's time is over."""
        run, scene = self.record.run, self.record.scene
        return run.finished or run.lockups > 0 or run.seconds > scene.time_limit_s

    def watch(self) -> None:
        """Take what has come, for at most `WATCH_S`, and restart what died; `ended` tells why all must end, if so."""
        assert self._bus is not None
        self._wake.wait(WATCH_S)
        self._wake.clear()
        for key, data in self._bus.received():
            kind, _, name = key.partition("/")
            if kind == "moment" and (moment := decoded(WorldMoment, data)) is not None:
                self.record.note_moment(moment)
            elif kind == "word" and (word := decoded(ChairWord, data)) is not None:
                self.record.note_word(int(name), word)
        if time.monotonic() - self._watched_s >= SUPERVISE_S:
            self._watched_s = time.monotonic()
            self.ended = self._supervision.watch()

    def _note(self, sentence: str) -> None:
        self._report(sentence)
        if "runs as process" not in sentence:
            self.record.ended.append((self.record.run.seconds, sentence))
