"""Step guidance in a running chair: its view for pages, the lift's buttons, and the rider's record after a yes.

`step` follows each tick of the chair; it moves nothing. In a lift the chair's pose is that of its odometry in the cabin, until
the rider says which storey it is.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

from waychair.control.guidance.guidance import Guidance, GuidanceView, Guiding, at_level, begun, step
from waychair.control.safety.supervisor import deflection_of
from waychair.planning.building.guided_ways import GuidedWays
from waychair.planning.movements import MovementKind
from waychair.runtime.chair import ChairState
from waychair.runtime.pages.chair_port import ChairView
from waychair.runtime.pages.guide_view import GuideView
from waychair.runtime.rider.habits import Habits
from waychair.runtime.rider.sentences import GUIDED, GUIDED_THERE, guiding_sentence, spoken_sentence
from waychair.slam.localising.localisation import LocalisationState
from waychair.types import DriveMode, Pose2, Twist

_AT_REST = 0.02
"""m/s, rad/s; a chair that moves more slowly stands."""

_PUSHED = 0.15
"""Share of the stick's travel from which its direction counts."""


@dataclass(frozen=True, slots=True)
class GuidedChair:
    """Guidance's view of a chair in a tick: its pose in the map in use, None while uncertain, and its motion.

    `by_itself`: the computer drives. `pushed`: the stick's direction, 1 forward, -1 back, 0 at rest. `halts`: their ids.
    """

    stamp_ns: int
    pose: Pose2 | None
    twist: Twist
    by_itself: bool = False
    pushed: int = 0
    halts: frozenset[str] = frozenset()


def guided_chair(state: ChairState) -> GuidedChair:
    """Return guidance's view of a chair's state."""
    localised = state.localisation is not None and state.localisation.state is LocalisationState.OK
    stick = None if state.telemetry is None else state.telemetry.joystick
    is_pushed = stick is not None and deflection_of(stick) > _PUSHED and abs(stick.forward) > _PUSHED
    return GuidedChair(
        stamp_ns=state.stamp_ns,
        pose=state.map_from_base if localised else None,
        twist=state.twist,
        by_itself=state.verdict.computer_drives and not state.verdict.steered,  # a page's stick is the rider's own
        pushed=0 if stick is None or not is_pushed else 1 if stick.forward > 0.0 else -1,
        halts=frozenset(halt.stop.id for halt in state.halts),
    )


def guided_chair_of_view(view: ChairView) -> GuidedChair:
    """Return guidance's view of a chair as a page shows it, which knows nothing of the stick."""
    return GuidedChair(
        stamp_ns=view.stamp_ns,
        pose=view.map_from_base if view.localisation is LocalisationState.OK else None,
        twist=view.twist,
        by_itself=view.mode is DriveMode.AUTONOMOUS and not view.steered and not view.waits,
        halts=frozenset(each.stop_id for each in view.obstacles),
    )


@dataclass(slots=True)
class _Drive:
    """The counts of a guided drive: since when [ns], what the graph expects [s], rests, reversals, interventions."""

    since_ns: int
    expected_s: float = 0.0
    counts: Counter[str] = field(default_factory=Counter)
    rested: bool = True
    pushed: int = 0
    halted: frozenset[str] = frozenset()


class Guide:
    """Guidance of one rider in one building. `worker` writes the record beside the ticks."""

    def __init__(
        self,
        odom_from_base: Callable[[], Pose2],
        habits: Habits | None = None,
        worker: Executor | None = None,
    ) -> None:
        """`habits`: the rider's record, which `worker` writes; None without."""
        self._odom = odom_from_base
        self._habits, self._worker = habits, worker
        self._ways: GuidedWays | None = None
        self._state: Guidance | None = None
        self._drive = _Drive(0)
        self._cabin_from_odom: Pose2 | None = None
        self._guiding = Guiding()
        self.view: GuideView | None = None
        """What a page shows; None without guidance."""

    def go(self, goal: str, level: int, now_ns: int, ways: GuidedWays) -> None:
        """Begin guidance to a goal over a building's ways; the same goal once more only changes the level.

        Raises:
            BuildingError: there is no such goal.
        """
        node = ways.node(goal)
        known = {} if self._habits is None or not self._habits.wanted else self._habits.practice(level)
        if self._state is not None and self.view is not None and self._state.goal == node and not self._state.arrived:
            self._state = at_level(self._state, level, known)
            return
        self.end(now_ns)
        self._ways, self._state = ways, begun(node, level, known)
        self._drive, self._cabin_from_odom = _Drive(now_ns), None
        self.view = GuideView(goal, sentence="Guidance begins.", level=self._state.level)

    def end(self, now_ns: int) -> None:
        """End guidance; a drive that has not arrived is recorded as such."""
        if self._state is not None and not self._state.arrived and self._state.plan is not None:
            self._record(now_ns, arrived=False)
        self._state = self.view = None

    @property
    def buttons(self) -> tuple[str, str] | None:
        """The lift and the storey whose button is to be pressed now: the hall's, then the cabin's."""
        movement, state = self._guiding.movement, self._state
        if state is None or state.plan is None or movement is None or not state.plan.parts[0].lift:
            return None
        part = state.plan.parts[0]
        if movement.kind is MovementKind.WAIT:
            return part.lift, state.storey
        return (part.lift, part.to) if movement.kind is MovementKind.PRESS else None

    @property
    def at_stops(self) -> tuple[str, ...]:
        """The storeys among which the rider chooses, in a cabin."""
        return self._guiding.at_stops if self._state is not None else ()

    @property
    def goes_to(self) -> str:
        """The storey to which the next lift is taken, "" for none."""
        state = self._state
        return "" if state is None or state.plan is None else state.plan.parts[0].to

    def pose_at(self, storey: str) -> Pose2 | None:
        """Return the chair's pose in a storey's map while it is in a cabin that stops there; None if it is in none."""
        if self._state is None or self._ways is None or self._cabin_from_odom is None or not self._state.lift:
            return None
        cabin = self._ways.cabin_pose(self._state.lift, storey)
        return None if cabin is None else cabin @ self._cabin_from_odom @ self._odom()

    def step(self, chair: GuidedChair, storey: str) -> None:
        """Follow a tick of the chair on a storey's map."""
        if self._state is None or self._ways is None:
            return
        pose = chair.pose
        if self._state.lift and self._cabin_from_odom is not None:
            pose = self.pose_at(storey)
        rests = abs(chair.twist.v) < _AT_REST and abs(chair.twist.omega) < _AT_REST
        arrived, plans = self._state.arrived, self._state.plans
        view = GuidanceView(chair.stamp_ns, storey, pose, rests, chair.by_itself)
        self._state, self._guiding = step(self._state, view, self._ways)
        self._take_cabin(storey, pose)
        self._count(chair, rests=rests, replanned=self._state.plans > plans)
        self._show(self._guiding)
        if self._state.arrived and not arrived:
            self._record(chair.stamp_ns, arrived=True)

    def _take_cabin(self, storey: str, pose: Pose2 | None) -> None:
        """Note how the chair stands in a cabin, by odometry."""
        assert self._state is not None
        assert self._ways is not None
        if not self._state.lift:
            self._cabin_from_odom = None
        elif self._cabin_from_odom is None and pose is not None:
            cabin = self._ways.cabin_pose(self._state.lift, storey)
            if cabin is not None:
                self._cabin_from_odom = cabin.inverse() @ pose @ self._odom().inverse()

    def _show(self, guiding: Guiding) -> None:
        assert self.view is not None
        assert self._state is not None
        said = spoken_sentence(guiding)
        self.view = GuideView(
            goal=self.view.goal,
            kind="" if guiding.movement is None else guiding.movement.kind.value,
            sentence=guiding_sentence(guiding),
            said=said or self.view.said,
            count=self.view.count + bool(said),
            bearing=guiding.bearing,
            left=guiding.left,
            level=self._state.level,
            arrived=guiding.arrived,
            offers=guiding.offers,
        )

    def _count(self, chair: GuidedChair, *, rests: bool, replanned: bool) -> None:
        """Count what the record keeps of a drive, and record a decision."""
        drive, plan = self._drive, None if self._state is None else self._state.plan
        if not drive.expected_s and plan is not None and self._ways is not None:
            drive.expected_s = (plan.cost + self._to_the_plan()) / self._ways.speed
            replanned = False
        drive.counts["replans"] += replanned
        drive.counts["prompts"] += self._guiding.cue is not None
        drive.counts["stops"] += rests and not drive.rested
        drive.rested = rests
        if chair.pushed:
            drive.counts["reversals"] += drive.pushed == -chair.pushed
            drive.pushed = chair.pushed
        drive.counts["interventions"] += "obstacle" in chair.halts - drive.halted
        drive.halted = chair.halts
        made = self._guiding.decided
        if made is not None and self._habits is not None and self._worker is not None and self._habits.wanted:
            self._worker.submit(self._habits.note_decision, made)

    def _to_the_plan(self) -> float:
        """Return the way [m] from the chair to the junction from which its plan's cost counts."""
        state = self._state
        if state is None or state.plan is None or state.track is None or len(state.plan.parts[0].along) < 2:
            return 0.0
        return max(float(state.plan.parts[0].along[1]) - state.track.along, 0.0)

    def _record(self, now_ns: int, *, arrived: bool) -> None:
        if self._habits is None or self._worker is None or not self._habits.wanted:
            return
        if self._state is None or self._state.plan is None:
            return
        habits, drive, name = self._habits, self._drive, self._state.plan.name
        seconds, counts = (now_ns - drive.since_ns) * 1e-9, dict(drive.counts)
        self._worker.submit(
            lambda: habits.note_drive(
                name, arrived=arrived, seconds=seconds, expected_s=drive.expected_s, counts=counts
            )
        )


def guided_view(view: ChairView, guide: GuideView | None) -> ChairView:
    """Return a chair's view with guidance; while the rider drives, its sentences tell so."""
    by_rider = guide is not None and not view.goal and view.mode is DriveMode.MANUAL
    if guide is None or not by_rider:
        return replace(view, guide=guide)
    return replace(view, guide=guide, next_action=GUIDED_THERE if guide.arrived else GUIDED, last_stop="")
