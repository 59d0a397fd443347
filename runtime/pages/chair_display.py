"""The view of a chair in this program for a page, put together tick by tick."""

from __future__ import annotations

import time
from collections.abc import Iterable

import numpy as np

from waychair.control.drive.navigator import Stage
from waychair.control.safety.supervisor import SupervisorEvent
from waychair.geometry import transform_points
from waychair.runtime.chair import Chair, ChairState
from waychair.runtime.pages.chair_port import ChairView
from waychair.runtime.pages.chair_story import DriveFacts, next_action, obstacles_of, shown_points
from waychair.runtime.rider.sentences import sentence
from waychair.slam.localising.localisation import LocalisationState
from waychair.types import FloatArray, Pose2, Scan


class ChairDisplay:
    """Keeps the latest scan, the goal's name and the reason of the last stop; used in the chair's own thread."""

    def __init__(self, chair: Chair, base_from_laser: Pose2) -> None:
        self.label = ""
        """Name of the latest goal, set by the caller that asks for it."""
        self._chair, self._base_from_laser = chair, base_from_laser
        self._last_stop = ""
        self._had_goal = self._was_pushed = self._was_driven = self._was_stopped = False  # at the last tick
        self._points: FloatArray = np.empty((0, 2))

    def hear(self, messages: Iterable[object], state: ChairState) -> None:
        """Take in the messages and the state of a tick that is over."""
        for message in messages:
            if isinstance(message, Scan) and state.localisation is not None:
                pose = state.localisation.map_from_base
                self._points = shown_points(message, self._base_from_laser, pose, state.twist)
        self._note_end(state)

    def view(self, state: ChairState) -> ChairView:
        """Return the chair after the latest tick; the caller adds revisions and the panel."""
        chair, found, navigation = self._chair, state.localisation, state.navigation
        knows = found is not None and found.state is not LocalisationState.LOST
        pose = state.map_from_base if found is not None else None
        way = np.empty((0, 2)) if not self._had_goal or navigation.path is None else navigation.path.poses[:, :2]
        goal = self.label if self._had_goal else ""
        countdown_s = chair.countdown_s(state.stamp_ns)
        obstacles = obstacles_of(state.halts)
        facts = DriveFacts(
            mode=state.verdict.mode,
            steered=state.verdict.steered,
            goal=goal,
            waits=chair.waits,
            countdown_s=countdown_s,
            stage=chair.navigator.stage,
            reason=chair.navigator.reason,
            pose=pose if knows else None,
            way=way,
            obstacles=obstacles,
            holds_lines=state.sent.active,
        )
        people = np.empty((0, 2))
        if found is not None and len(odometric := chair.navigator.people):
            people = transform_points(found.map_from_odom, odometric)
        return ChairView(
            stamp_ns=time.monotonic_ns(),
            map_from_base=pose,
            localisation=LocalisationState.LOST if found is None else found.state,
            health=0.0 if found is None else found.health,
            mode=state.verdict.mode,
            twist=state.twist,
            goal=goal,
            waits=chair.waits,
            countdown_s=countdown_s,
            next_action=next_action(facts),
            last_stop=self._last_stop,
            obstacles=obstacles,
            scan=self._points,
            path=way,
            people=people,
            steered=state.verdict.steered,
            paused=navigation.stage is Stage.PAUSED and bool(goal),
            offers=navigation.stage is Stage.OFFERING and bool(goal),
            guard=chair.guard_view(state.telemetry),
        )

    def _note_end(self, state: ChairState) -> None:
        """Keep the reason for which a drive ended or did not begin, or that somebody pressed Stop."""
        navigator, pushed = self._chair.navigator, any(halted.stop.id == "pushed" for halted in state.halts)
        has_goal = self._chair.waits or navigator.active
        stopped = state.verdict.halt is not None and state.verdict.halt.stop.id == "stop_pressed"
        gave_up = self._was_driven and not state.verdict.computer_drives and state.verdict.halt is not None
        if self._had_goal and not has_goal:
            arrived = navigator.stage is Stage.ARRIVED
            self._last_stop = sentence(f"arrived at {self.label}" if arrived else navigator.reason)
        elif gave_up or (stopped and not self._was_stopped):
            replaced = state.verdict.halt is not None and state.verdict.halt.stop.id == "unconfirmed"
            self._last_stop = sentence(SupervisorEvent.REQUEST.value if replaced else state.verdict.reason)
        elif pushed and not self._was_pushed:
            self._last_stop = sentence(next(halted.text for halted in state.halts if halted.stop.id == "pushed"))
        self._had_goal, self._was_pushed, self._was_stopped = has_goal, pushed, stopped
        self._was_driven = state.verdict.computer_drives
