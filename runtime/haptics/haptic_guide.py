"""The part of a chair that tells and leads a rider without sight: steps and advice in, glove, voice and text out.

It moves nothing. The chair calls `step` once a tick, after the command was sent. Each channel may fail by itself; where none
reaches the rider, the steps are withheld and named as such, and the chair drives on at the level of help that is left.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

from waychair.calibration.chair_body import ChairBody
from waychair.control.behaviours.commands import Signal, SignalKind
from waychair.control.haptics.cell_advice import CellMemory, cell_advice
from waychair.control.haptics.guide_numbers import STILL_OMEGA, STILL_V
from waychair.control.haptics.guide_types import GuideInputs, GuideWord, StickHold
from waychair.control.haptics.learning import RiderLearner
from waychair.control.haptics.symbols import Advice, Symbol
from waychair.control.haptics.turned_device import OppositeAnswers
from waychair.control.safety.guard import BLIND_WITHIN, GUARD_ENDED, Unscanned
from waychair.errors import PlanningError
from waychair.geometry import transform_points
from waychair.maps.drawn.zones import Zone
from waychair.runtime.haptics.haptic_state import HapticInputs, HapticState, RiderSurroundings
from waychair.runtime.haptics.leading_warm_up import warm_up
from waychair.runtime.haptics.live_ground import LiveGround
from waychair.runtime.haptics.seen_ground import SeenGround
from waychair.runtime.haptics.session_log import SessionCounter
from waychair.runtime.haptics.step_leader import LedGround, StepLeader
from waychair.runtime.haptics.teller import REPEAT_OFFER, Teller, ToldAdvice
from waychair.runtime.haptics.where import where_words
from waychair.types import FloatArray, HelpLevel, OccupancyGrid, Place, Pose2, Scan, Twist

LOST = "the chair does not know where it is: stop, and wait until it does"
"""Reason of the warning to a rider who is led when the pose is lost."""

NO_ODOMETRY = "the chair does not know how far it has driven: stop, and wait until it does"
"""Reason of the warning to a rider who is led by odometry alone when there is none."""

NOT_SEEN = "no sensor shows the way: stop, and wait until one does"
"""Reason of the warning to a rider who is led by odometry alone while no scan and no look by the laser's line comes."""

OVERRIDE_WARNING = "held on, the push makes the chair creep against the guard"
"""Reason of the warning before the board lets a long push through."""

OVERRIDE_BEGINS = "The chair creeps against the guard, for ten seconds at most, while you hold the joystick."
"""The sentence with which an override by a long push begins."""

UNGUARDED = "the guard begins once you let go of the joystick for two seconds"
"""Reason for which a rider at the level guide, whom no board guards yet, is told no steps."""

OTHER_STEPS = "other steps lead on."
"""The end of the sentence with which a rider whom something held is led on by other steps."""

BEGUN_ANEW = "the odometry has begun anew: choose the door again"

AS_PAPER = (
    "this rider is told by the paper's signals, which lead to no place: write advice: guide into the rider's file"
)

_LEAP = 0.5
"""m; no chair drives so far in a tick."""

_SCANLESS_NS, _LOOKLESS_NS = 1_000_000_000, 2_000_000_000
"""ns without a scan, and without a look by the laser's line, after which nobody is led by odometry alone: the camera's servo takes up to
1.4 s from one way to the next."""

AGAIN_NS = 1_500_000_000
"""Two presses of the glove's button within this time ask where the chair is."""

_LOST_NUMBER, _OVERRIDE_NUMBER, _NOTICE_NUMBER = 900_000_000, 900_000_001, 900_000_002
"""Numbers of the warnings of a lost pose and of an override, and of the first notice, beyond those of guide and cells."""

_WARNING_NS, _NOTICE_NS = 500_000_000, 30_000_000_000
"""ns for which a warning may still begin, and a call for attention, which waits until the chair is at rest, until it was felt."""


@dataclass(frozen=True, slots=True)
class _Asked:
    """The rider's wishes that wait: to hear it again, since when [ns], and where the chair is; and the last press [ns]."""

    again: bool = False
    where: bool = False
    pressed_ns: int = -(10**18)
    again_ns: int | None = None


@dataclass(slots=True)
class _Told:
    """The state that was told last: the sentence about the level, leading, the reason of a wait, a hold that was left behind, an
    override; and the call for attention to the last notice. A change of it is told."""

    level: str = ""
    led: bool = False
    waits: str = ""
    led_on: str = ""
    creeps: bool = False
    notice: Advice = field(default_factory=lambda: Advice(Symbol.ATTENTION, _NOTICE_NUMBER, -1))


@dataclass(slots=True)
class _ByOdometry:
    """A way by odometry alone: its ground, for how long what was seen since the last tick counts [ns] (0: nothing was), until
    when the ways seen before count, the stamp of the lidar's last scan (None without one), and the pose of the tick before."""

    ground: SeenGround
    fresh_ns: int = 0
    good_until_ns: int = 0
    scan_ns: int | None = None
    before: Pose2 | None = None

    def withheld(self, now: HapticInputs) -> str:
        """Note a tick, and return why nobody is led in it."""
        pose, before = now.odom_from_base, self.before
        if pose is None:
            return NO_ODOMETRY
        self.before = pose
        if before is not None and math.hypot(pose.x - before.x, pose.y - before.y) > _LEAP:
            return BEGUN_ANEW
        if self.fresh_ns:
            self.fresh_ns, self.good_until_ns = 0, now.now_ns + self.fresh_ns
        return "" if self.ground.is_seen and now.now_ns <= self.good_until_ns else NOT_SEEN


_BLIND = (LOST, NO_ODOMETRY, NOT_SEEN)
"""Reasons for which a rider who moves on is warned."""


class HapticGuide:
    """One rider's guide. `state` is that after the last tick; `leader` leads along the steps."""

    def __init__(
        self,
        body: ChairBody,
        teller: Teller,
        learner: RiderLearner,
        grid: OccupancyGrid,
        zones: Sequence[Zone] = (),
        worker: Executor | None = None,
        around: Callable[[], RiderSurroundings] = RiderSurroundings,
        session: SessionCounter | None = None,
    ) -> None:
        """`worker` makes the plans, by default they are made in the tick. `around` is asked when the rider asks.

        `session` counts for the trainer, if the rider wants it.
        """
        warm_up()
        self._teller = teller
        durations = {symbol: 1e-3 * each.duration_ms for symbol, each in teller.words.patterns.items()}
        self.leader = StepLeader(body, durations, learner, worker)
        self._body, self._mapped = body, LiveGround(body, grid, zones)
        self._unmapped: _ByOdometry | None = None
        self.around = around
        self.session = session
        self.state = HapticState(0)
        self._cells = CellMemory()
        self._asked = _Asked()
        self._before = _Told()
        self._answers = OppositeAnswers()

    def lead(self, goal: Place) -> None:
        """Lead the rider to a place of the map from now on."""
        self._unmapped = None
        self.leader.lead(goal, LedGround(self._mapped.ask, self._mapped.ask_mapped, self._mapped.ask_why))
        self._begun(goal)

    def lead_by_odometry(self, goal: Place) -> None:
        """Lead the rider to a place in odom from now on, over the ground that the lidar shows: no map is used."""
        unmapped = self._unmapped = _ByOdometry(SeenGround(self._body))
        self.leader.lead(goal, LedGround(lambda: unmapped.ground.ask(goal.pose), why=lambda: _no_way_seen, grows=True))
        self._begun(goal)

    def _begun(self, goal: Place) -> None:
        self._answers = OppositeAnswers()
        self._before.led, self._before.notice = True, replace(self._before.notice, valid_until_ns=-1)
        self.state = replace(self.state, goal=goal.name, arrived=False)

    def end(self, reason: str = "you have ended it") -> None:
        """Lead no longer."""
        self.leader.end(reason)

    def say_again(self) -> None:
        """Say the present step again, at the next tick."""
        self._asked = replace(self._asked, again=True)

    def say_where(self) -> None:
        """Tell the chair's place and its surroundings, at the next tick."""
        self._asked = replace(self._asked, where=True)

    def see(self, scan: Scan, map_from_base: Pose2 | None, odom_from_base: Pose2, twist: Twist) -> None:
        """Take in a scan without the beams that hit the chair itself, with the chair's poses and motion at it.

        `map_from_base` is None while the chair does not know where it is.
        """
        if map_from_base is not None:
            self._mapped.see(scan, map_from_base, twist)
        if self._unmapped is not None and self.leader.goal is not None:
            self._unmapped.ground.see(scan, odom_from_base, twist)
            self._unmapped.fresh_ns, self._unmapped.scan_ns = _SCANLESS_NS, scan.stamp_ns

    def _look(self, now: HapticInputs) -> None:
        """Take in a look by the laser's line, unless the lidar has shown the way a moment ago: it shows more, and more exactly."""
        unmapped, told = self._unmapped, now.camera
        if unmapped is None or self.leader.goal is None or told is None or told.sight is None:
            return
        if unmapped.scan_ns is None or now.now_ns - unmapped.scan_ns > _SCANLESS_NS:
            unmapped.ground.look(told.sight, told.odom_from_base, told.stamp_ns)
            unmapped.fresh_ns = _LOOKLESS_NS

    def with_seen(self, known: Unscanned, odom_from_base: Pose2) -> Unscanned:
        """Return what no scan shows, in base, with the walls that were seen on a way without a map: they may be behind by now."""
        walls = self.seen_walls(odom_from_base, BLIND_WITHIN)
        return known if walls is None else known.with_mapped(transform_points(odom_from_base.inverse(), walls))

    def seen_walls(self, odom_from_base: Pose2, within: float) -> FloatArray | None:
        """Return what was seen occupied on a way without a map, points (N, 2) [m] in odom near the chair; None on no such way."""
        if self._unmapped is None or self.leader.goal is None:
            return None
        return self._unmapped.ground.walls(odom_from_base, within)

    def redraw(self, grid: OccupancyGrid, zones: Sequence[Zone]) -> None:
        """Take another map; the steps are planned anew on it."""
        self._mapped.redraw(grid, zones)
        if self._unmapped is None:
            self.leader.look_again()

    def step(self, now: HapticInputs) -> HapticState:
        """Run one tick: decide on the advice, say it where it is due, and return the channels' state."""
        if self._teller.as_paper:
            return self._step_as_paper(now)
        self._look(now)
        withheld = self._withheld(now)
        pose = self._pose(now)
        guidance = None if withheld or pose is None else self.leader.step(_inputs(now, pose))
        wanted = self._wanted(now, guidance, withheld)
        again = self._again(now, bool(withheld))
        if again is not None:
            wanted = [again, *(each for each in wanted if each.symbol is Symbol.WARNING)]
        # the guide itself counts what is ignored, so the teller need not
        told = self._teller.tick(wanted, now.now_ns, asked=again is not None, reacted=True)
        if told.said is self._before.notice:
            self._before.notice = replace(self._before.notice, valid_until_ns=-1)
        self._note(told, guidance, again, now)
        self._watch_answers(told, now)
        sentence = self._sentence(again, guidance, now, withheld)
        if sentence:
            self._teller.announce(sentence, now.now_ns)
        self._asked = self._next_asked(told, again, now.now_ns)
        self.state = self._state(now, guidance, told, sentence, withheld)
        if self.session is not None:
            self.session.note(now, self.state, asked=again is not None)
        return self.state

    def _step_as_paper(self, now: HapticInputs) -> HapticState:
        """Run one tick for a rider who feels the paper's own signals, which lead to no place."""
        if self.leader.goal is not None:
            self.leader.end(AS_PAPER)
        signal = None if now.computer_drives else now.signal
        told = self._teller.tell_as_paper(Signal(SignalKind.WARNING) if _overrides(now) else signal, now.now_ns)
        sentence = self._sentence(None, None, now, "")
        if sentence:
            self._teller.announce(sentence, now.now_ns)
        self._asked = _Asked()
        self.state = self._state(now, None, told, sentence, "")
        if self.session is not None:
            self.session.note(now, self.state, asked=False)
        return self.state

    def _withheld(self, now: HapticInputs) -> str:
        """Return why nobody tells the steps now; after a silence they begin from where the chair is."""
        leader, unmapped = self.leader, self._unmapped
        if leader.goal is None:
            return ""
        blind = unmapped.withheld(now) if unmapped is not None else LOST if now.pose is None else ""
        if now.level is HelpLevel.GUARD:
            leader.end("you have chosen the guard alone")
            return ""
        if now.level_told != self._before.level and now.level_told.startswith(GUARD_ENDED):
            leader.end("the guard has ended")
            return ""
        silence = "the chair drives by itself" if now.computer_drives else self._teller.silence(now.now_ns)
        if now.level is HelpLevel.GUIDE and now.guard is None and not silence:
            silence = UNGUARDED
        if silence:
            leader.look_again()
            return silence
        if blind == BEGUN_ANEW:
            leader.end(BEGUN_ANEW)
        return blind

    def _pose(self, now: HapticInputs) -> Pose2 | None:
        """Return the pose in the frame of the goal."""
        return now.pose if self._unmapped is None else now.odom_from_base

    def _wanted(self, now: HapticInputs, guidance: GuideWord | None, withheld: str) -> list[Advice]:
        """Return all advice that holds now."""
        wanted = [] if guidance is None or guidance.advice is None else [guidance.advice]
        signal = None if now.computer_drives else now.signal
        from_cells, self._cells = cell_advice(signal, self._cells, now.now_ns)
        if from_cells is not None and _moves(now.twist):
            drowns_steps = self.leader.goal is not None and from_cells.symbol is Symbol.OBSTACLE_AT
            wanted += [] if drowns_steps else [from_cells]
        if withheld in _BLIND and _moves(now.twist):
            wanted.append(Advice(Symbol.WARNING, _LOST_NUMBER, now.now_ns + _WARNING_NS, reason=withheld))
        if _overrides(now):
            wanted.append(Advice(Symbol.WARNING, _OVERRIDE_NUMBER, now.now_ns + _WARNING_NS, reason=OVERRIDE_WARNING))
        if not _moves(now.twist):
            wanted.append(self._before.notice)
        return [*wanted, *now.others]

    def _again(self, now: HapticInputs, withheld: bool) -> Advice | None:
        """Return the advice that the rider wants to have again; None if nobody asks, or there is none."""
        pose = self._pose(now)
        if not self._asked.again or withheld or pose is None:
            return None
        return self.leader.again(_inputs(now, pose))

    def _note(self, told: ToldAdvice, guidance: GuideWord | None, again: Advice | None, now: HapticInputs) -> None:
        """Tell the leader whether its advice has reached the rider."""
        advice = again or (None if guidance is None else guidance.advice)
        if advice is None:
            return
        said = told.said is not None and told.said.number == advice.number
        if said and (not told.unfelt or self._teller.heard):
            self.leader.note_said(advice, now.now_ns, now.twist)
        else:
            self.leader.note_unsaid()

    def _watch_answers(self, told: ToldAdvice, now: HapticInputs) -> None:
        """Lead no longer where the rider does the opposite again and again: the device sits the wrong way round."""
        answers = self._answers.after(now.stick, now.now_ns)
        if told.said is not None and not told.unfelt:
            symbol = told.said.symbol
            answers = answers.said(symbol, now.stick, now.now_ns, self.leader.lead_s(symbol))
        if answers.words:
            self.leader.end(answers.words)
            answers = OppositeAnswers()
        self._answers = answers

    def _sentence(self, again: Advice | None, guidance: GuideWord | None, now: HapticInputs, withheld: str) -> str:
        """Return a sentence to be spoken besides symbols: an answer, a new level of help, an offer, or the end of leading."""
        if self._asked.where:
            return where_words(now.pose, self.around(), self.leader.step_words)
        before = self._before
        if now.level_told != before.level:
            before.level = now.level_told
            return now.level_told
        crept, before.creeps = before.creeps, now.guard is not None and now.guard.overridden
        if before.creeps and not crept:
            return OVERRIDE_BEGINS
        notice = self._notice(guidance, withheld)
        if notice:
            number = before.notice.number + 1
            before.notice = Advice(Symbol.ATTENTION, number, now.now_ns + _NOTICE_NS, reason=notice, spoken=True)
            return notice
        if self._asked.again and again is None:
            return self.state.text or "Nothing has been said yet."
        return ""

    def _notice(self, guidance: GuideWord | None, withheld: str) -> str:
        """Return a sentence that touch calls attention to: the end of leading, a wait, other steps, an offer; empty without one."""
        before, leader = self._before, self.leader
        was_led, before.led = before.led, leader.goal is not None
        if was_led and leader.goal is None and not leader.arrived:
            return f"You are no longer led: {leader.reason}."
        waits = withheld if withheld == UNGUARDED else leader.waits
        waited, before.waits = before.waits, waits
        if waits and waits != waited:
            return f"Wait: {waits}."
        led_on, before.led_on = before.led_on, leader.led_on
        if before.led_on and not led_on:
            return f"{before.led_on[0].upper()}{before.led_on[1:]}: {OTHER_STEPS}"
        if guidance is not None and guidance.offers_repeat:
            return f"{REPEAT_OFFER[0].upper()}{REPEAT_OFFER[1:]}."
        return ""

    def _next_asked(self, told: ToldAdvice, again: Advice | None, now_ns: int) -> _Asked:
        """Return the wishes for the next tick, by the glove's buttons too: repeat once for again, twice for where; yes takes an offer.

        A wish to hear it again waits for the gap after the symbol before, but not for long.
        """
        asked = self._asked
        if told.yes and self.state.offers:
            return _Asked(again=True, again_ns=now_ns)
        if told.repeats:
            twice = told.repeats > 1 or now_ns - asked.pressed_ns < AGAIN_NS
            return _Asked(again=not twice, where=twice, pressed_ns=-(10**18) if twice else now_ns, again_ns=now_ns)
        since_ns = now_ns if asked.again_ns is None else asked.again_ns
        waits = asked.again and again is not None and told.said is None and now_ns - since_ns < AGAIN_NS
        return _Asked(again=waits, pressed_ns=asked.pressed_ns, again_ns=since_ns if waits else None)

    def _state(
        self, now: HapticInputs, guidance: GuideWord | None, told: ToldAdvice, sentence: str, withheld: str
    ) -> HapticState:
        leader, shown = self.leader, self._teller.shown(self.state, told, now.now_ns)
        goes_on = told.said is not None and told.said.symbol is not Symbol.ATTENTION  # which belongs to an offer
        if sentence:
            shown = replace(shown, symbol="", text=sentence, count=shown.count + 1, play=())
        return replace(
            shown,
            level=now.level,
            speaks=self._teller.speaks,
            goal="" if leader.goal is None else leader.goal.name,
            step=leader.step_words,
            reason=leader.reason if guidance is None else guidance.reason,
            arrived=leader.arrived,
            withheld=withheld,
            offers=(guidance is not None and guidance.offers_repeat) or (self.state.offers and not goes_on),
            hold=StickHold() if guidance is None else guidance.hold,
        )


def _no_way_seen(error: PlanningError, start: Pose2, goal: Pose2) -> str:
    """Return why no steps lead on, for somebody who sees no coordinates, where nothing but the scans is known."""
    return "no way is seen that the chair fits through"


def _overrides(now: HapticInputs) -> bool:
    """Return whether the board is about to let a long push through."""
    return now.guard is not None and now.guard.warns


def _moves(twist: Twist) -> bool:
    return abs(twist.v) > STILL_V or abs(twist.omega) > STILL_OMEGA


def _inputs(now: HapticInputs, pose: Pose2) -> GuideInputs:
    """Return the guide's inputs: whether the guard holds the rider's stick back."""
    if now.guard is None or now.stick is None:
        return GuideInputs(now.now_ns, pose, now.twist)
    return GuideInputs.under(
        now.guard.caps, now.stick.forward, now.stick.turn, now.now_ns, pose, now.twist, now.own_caps
    )
