"""Learning one rider from drives: how late and how far each symbol is obeyed, how the chair veers, which symbols are mixed up.

Each symbol is looked at once, when its effect is over. Of every figure the median of the latest values counts (of the share
of right answers their mean), so that a symbol that was not felt, or an outlier, changes little; values outside `rider.LIMITS` are dropped. All of it stays on the
chair, can be reset, and is exported as plain numbers.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from waychair.control.haptics.rider import LIMITS, RiderModel
from waychair.control.haptics.symbols import Symbol
from waychair.types import FloatArray, Json, Twist

RiderValues: TypeAlias = Mapping[str, Sequence[float]]
"""The values behind each figure of a rider, the oldest first."""

KEPT = 25
"""Latest values of each figure."""

PRIOR = 4
"""The figures known before count as so many values, until there are enough of this rider's own."""

WATCHED_S = 1.9
"""s after a pattern's end within which its effect is looked for; a later one is not counted."""

MOVES_V, MOVES_OMEGA = 0.06, 0.12
"""m/s, rad/s; an effect of a symbol."""

SOONEST_S, FULL = 0.3, 0.95
"""s after a pattern's end before which no chair sets out by it; and share of the greatest speed at which it counts as reached."""

STEADY_S = 0.3
"""s; a turn on the spot has its full rate if it keeps it for so long."""

FREE_S = 0.5
"""s; a piece of straight driving between two nudges, long enough to show how the chair veers."""

BEFORE_S, AFTER_S, BESIDE_S = 0.25, 0.45, 0.12
"""s before and after the expected middle of a nudge within which its turn is made, and beside them, where the rate is measured
at which the chair would have turned without: drivers are nudged against a drift, which has to be taken off."""

_MOTION = {
    Symbol.FORWARD: "forward",
    Symbol.BACK: "back",
    Symbol.SWIVEL_LEFT: "left",
    Symbol.SWIVEL_RIGHT: "right",
    Symbol.NUDGE_LEFT: "nudged left",
    Symbol.NUDGE_RIGHT: "nudged right",
    Symbol.WARNING: "rest",
    Symbol.ARRIVED: "rest",
}


_HELD = (Symbol.FORWARD, Symbol.BACK, Symbol.SWIVEL_LEFT, Symbol.SWIVEL_RIGHT)


def expected(symbol: Symbol) -> str:
    """Return the motion by which a symbol is answered rightly; empty for one that asks for none."""
    return _MOTION.get(symbol, "")


@dataclass(frozen=True, slots=True)
class _Waiting:
    """A symbol whose effect is waited for: when its pattern ends [s], and how the chair moved when it began."""

    symbol: Symbol
    ends_s: float
    before: Twist


class RiderLearner:
    """What is learnt of one rider; `model` is the present knowledge."""

    def __init__(self, start: RiderModel | None = None) -> None:
        self._start = self.model = start or RiderModel()
        self._values: dict[str, deque[float]] = {}
        self._motion: deque[tuple[float, float, float]] = deque(maxlen=120)  # s, v, omega
        self._waiting: list[_Waiting] = []
        self._nudges: list[tuple[float, float]] = []  # side, and when the pattern ends
        self._disturbed_s = -math.inf  # the last time at which something else than straight driving was asked for
        self._free_s = -math.inf  # since when the chair drives straight, as far as it was asked
        self._answers: dict[tuple[str, str], int] = {}
        self.reset()

    def reset(self) -> None:
        """Forget the rider."""
        self._values = {name: deque(maxlen=KEPT) for name in LIMITS}
        self.model = self._start
        self._waiting.clear()
        self._nudges.clear()
        self._answers.clear()

    def note_said(self, symbol: Symbol, now_ns: int, duration_s: float, moving: Twist) -> None:
        """Note a symbol at the beginning of its pattern, and the chair's motion then."""
        ends_s = now_ns * 1e-9 + duration_s
        self._waiting.append(_Waiting(symbol, ends_s, moving))
        if symbol in (Symbol.NUDGE_LEFT, Symbol.NUDGE_RIGHT):
            self._nudges.append((1.0 if symbol is Symbol.NUDGE_LEFT else -1.0, ends_s))
        elif symbol is not Symbol.FORWARD or moving.v < MOVES_V:
            self._disturbed_s = ends_s + self.model.lag_s + AFTER_S

    def note_motion(self, now_ns: int, twist: Twist) -> None:
        """Take in the measured motion of a tick; values that are no numbers are ignored."""
        if not (math.isfinite(twist.v) and math.isfinite(twist.omega)):
            return
        now_s = now_ns * 1e-9
        self._motion.append((now_s, twist.v, twist.omega))
        for each in [one for one in self._waiting if now_s > one.ends_s + WATCHED_S]:
            self._waiting.remove(each)
            self._look_at(each)
        if twist.v < MOVES_V:
            self._disturbed_s = max(self._disturbed_s, now_s)
        self._look_at_nudges(now_s)
        self._look_at_veer(now_s)

    def exported(self) -> Json:
        """Return everything that was learnt, as plain numbers: the figures, the values behind them, the answers."""
        return {
            "figures": self.model.figures(),
            "values": self.values(),
            "answers": {f"{said} answered by {done}": count for (said, done), count in sorted(self._answers.items())},
        }

    def values(self) -> RiderValues:
        """Return the values behind the figures, for `restore`."""
        return {name: list(values) for name, values in self._values.items()}

    def note_answer(self, symbol: Symbol, done: str, lag_s: float | None) -> None:
        """Note by which motion a symbol was answered at rest (see `expected`), and how late [s] after the pattern's end.

        The lag counts only of a right answer that is held, because a nudge is over before the chair obeys.
        """
        if self._count_answer(symbol, done) and lag_s is not None and symbol in _HELD:
            self._add("lag_s", lag_s)

    def restore(self, values: RiderValues, answers: Mapping[tuple[str, str], int]) -> None:
        """Take up what was learnt before; figures that are not known or out of `LIMITS` are dropped."""
        self.reset()
        for name in LIMITS:
            for value in values.get(name, ()):
                self._add(name, value)
        self._answers = dict(answers)

    def answers(self) -> Mapping[tuple[str, str], int]:
        """Return how often each symbol (its value) was answered by each motion."""
        return dict(self._answers)

    def _count_answer(self, symbol: Symbol, done: str) -> bool:
        """Count an answer, and return whether it is the right one."""
        key, is_right = (symbol.value, done), done == expected(symbol)
        self._answers[key] = self._answers.get(key, 0) + 1
        if symbol in _HELD:
            self._add("sure", float(is_right))
        return is_right

    def _moved(self, begin_s: float, end_s: float) -> FloatArray:
        """Return times, speeds and turn rates (N, 3) between two times."""
        return np.array([row for row in self._motion if begin_s <= row[0] <= end_s]).reshape(-1, 3)

    def _look_at_nudges(self, now_s: float) -> None:
        """Take the turn of each nudge that is over, and how the chair veers beside it."""
        done_s = self.model.lag_s + AFTER_S + BESIDE_S
        for side, ends in [each for each in self._nudges if now_s > each[1] + done_s]:
            self._nudges.remove((side, ends))
            begin, end = ends + self.model.lag_s - BEFORE_S, ends + self.model.lag_s + AFTER_S
            before, during = self._moved(begin - BESIDE_S, begin), self._moved(begin, end)
            after = self._moved(end, end + BESIDE_S)
            if begin < self._disturbed_s or not (len(before) and len(after) and len(during) > 2):
                continue
            drift = 0.5 * (float(before[:, 2].mean()) + float(after[:, 2].mean()))
            self._add("nudge", side * float(np.trapezoid(during[:, 2] - drift, during[:, 0])))
            self._add("veer_per_m", drift / float(during[:, 1].mean()))

    def _look_at_veer(self, now_s: float) -> None:
        """Take the bend of each piece of straight driving without a nudge."""
        acts = [
            ends + self.model.lag_s + AFTER_S for _, ends in self._nudges if now_s > ends + self.model.lag_s - BEFORE_S
        ]
        self._free_s = max(self._free_s, self._disturbed_s, *acts, -math.inf)
        if now_s - self._free_s >= FREE_S:
            piece = self._moved(self._free_s, now_s)
            self._add("veer_per_m", float(piece[:, 2].mean() / piece[:, 1].mean()))
            self._free_s = now_s

    def _look_at(self, said: _Waiting) -> None:
        motion = np.array([row for row in self._motion if said.ends_s < row[0] <= said.ends_s + WATCHED_S])
        if len(motion) < 10:
            return
        times, v, omega = motion.T
        if not self._count_answer(said.symbol, _motion_of(v, omega, said)):
            return
        if said.symbol in (Symbol.FORWARD, Symbol.BACK) and max(abs(said.before.v), abs(said.before.omega)) < MOVES_V:
            self._add_lag(times - said.ends_s, np.abs(v), MOVES_V)
            if said.symbol is Symbol.FORWARD:
                self._add("speed", float(v.max()))
        elif said.symbol in (Symbol.SWIVEL_LEFT, Symbol.SWIVEL_RIGHT) and abs(said.before.omega) < MOVES_OMEGA:
            if abs(said.before.v) < MOVES_V:
                self._add_lag(times - said.ends_s, np.abs(omega), MOVES_OMEGA)
            self._add_swivel(times, np.abs(omega))

    def _add_lag(self, after_s: FloatArray, speeds: FloatArray, moves: float) -> None:
        """Take the lag of a motion from rest; one that an earlier symbol, or the chair's own rolling out, began shows none."""
        if float(speeds[after_s < SOONEST_S].max(initial=0.0)) < moves:
            self._add("lag_s", _lag(after_s, speeds))

    def _add_swivel(self, times_s: FloatArray, rates: FloatArray) -> None:
        """Take the rate of a turn on the spot that was steady for a while; a short one ends before it is at its full rate."""
        steady = times_s[rates >= FULL * float(rates.max())]
        if steady[-1] - steady[0] >= STEADY_S:
            self._add("swivel", float(rates.max()))

    def _add(self, name: str, value: float) -> None:
        low, high = LIMITS[name]
        if low <= value <= high:
            values = self._values[name]
            values.append(value)
            before = [getattr(self._start, name)] * min(PRIOR, KEPT - len(values))
            middle = np.mean if name == "sure" else np.median  # a share, of answers that were right or wrong
            changed: dict[str, float] = {name: min(max(float(middle([*values, *before])), low), high)}
            self.model = replace(self.model, **changed)


def rider_from_values(values: RiderValues) -> RiderModel:
    """Return what is known of a rider by these values."""
    learner = RiderLearner()
    learner.restore(values, {})
    return learner.model


def _motion_of(v: FloatArray, omega: FloatArray, said: _Waiting) -> str:
    """Return the motion by which a symbol was answered, in words."""
    if said.symbol in (Symbol.NUDGE_LEFT, Symbol.NUDGE_RIGHT):
        peak = float(omega[np.argmax(np.abs(omega))])
        if abs(peak) < MOVES_OMEGA / 2:
            return "nothing"
        return f"nudged {'left' if peak > 0.0 else 'right'}"
    turns, drives = float(omega[np.argmax(np.abs(omega))]), float(v[np.argmax(np.abs(v))])
    if said.symbol in (Symbol.SWIVEL_LEFT, Symbol.SWIVEL_RIGHT) and abs(turns) > MOVES_OMEGA:
        return "left" if turns > 0.0 else "right"
    if abs(drives) > MOVES_V and said.symbol in (Symbol.FORWARD, Symbol.BACK):
        return "forward" if float(np.median(v[-5:])) > 0.0 else "back"
    return "rest" if abs(float(np.median(v[-5:]))) < MOVES_V else "goes on"


def _lag(after_s: FloatArray, speeds: FloatArray) -> float:
    """Return the lag [s] after which a motion at its full speed at once would have come as far as this one."""
    full = int(np.flatnonzero(speeds >= FULL * float(speeds.max()))[0])
    times, rising = np.concatenate([[0.0], after_s[: full + 1]]), np.concatenate([[0.0], speeds[: full + 1]])
    return float(times[-1] - np.trapezoid(rising, times) / rising[-1])
