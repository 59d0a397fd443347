"""Learning one rider from drives: how late and how far each symbol is obeyed, how the chair veers, which symbols are mixed up.

Each symbol is looked at once, when its effect is over. Of every figure the median of the latest values counts, so that a
symbol that was not felt, or an outlier, changes little; values outside `rider.LIMITS` are dropped. All of it stays on the
chair, can be reset, and is exported as plain numbers.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from waychair.control.haptics.rider import LIMITS, RiderModel
from waychair.control.haptics.symbols import Symbol
from waychair.types import Json, Twist

KEPT = 25
"""Latest values of each figure."""

PRIOR = 4
"""The figures known before count as so many values."""

WATCHED_S = 1.9
"""s after a pattern's end within which its effect is looked for; a later one is not counted."""

QUIET_S = 0.25
"""s before a symbol's effect could begin, in which the rates before it are measured."""

MOVES_V, MOVES_OMEGA = 0.06, 0.12
"""m/s, rad/s; an effect of a symbol."""

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
        self._motion: deque[tuple[float, float, float]] = deque(maxlen=200)  # s, v, omega
        self._waiting: list[_Waiting] = []
        self._answers: dict[tuple[str, str], int] = {}
        self.reset()

    def reset(self) -> None:
        """Forget the rider."""
        self._values = {name: deque([getattr(self._start, name)] * PRIOR, maxlen=KEPT) for name in LIMITS}
        self.model = self._start
        self._waiting.clear()
        self._answers.clear()

    def note_said(self, symbol: Symbol, now_ns: int, duration_s: float, moving: Twist) -> None:
        """Note a symbol at the beginning of its pattern, and the chair's motion then."""
        now_s = now_ns * 1e-9
        self._waiting = [each for each in self._waiting if each.ends_s > now_s]  # a newer one covers the effect
        self._waiting.append(_Waiting(symbol, now_s + duration_s, moving))

    def note_motion(self, now_ns: int, twist: Twist) -> None:
        """Take in the measured motion of a tick; values that are no numbers are ignored."""
        if not (math.isfinite(twist.v) and math.isfinite(twist.omega)):
            return
        now_s = now_ns * 1e-9
        self._motion.append((now_s, twist.v, twist.omega))
        for each in [one for one in self._waiting if now_s > one.ends_s + WATCHED_S]:
            self._waiting.remove(each)
            self._look_at(each)

    def exported(self) -> Json:
        """Return everything that was learnt, as plain numbers: the figures, the values behind them, the answers."""
        return {
            "figures": {name: getattr(self.model, name) for name in LIMITS},
            "values": {name: list(values)[PRIOR:] for name, values in self._values.items()},
            "answers": {f"{said} answered by {done}": count for (said, done), count in sorted(self._answers.items())},
        }

    def answers(self) -> Mapping[tuple[str, str], int]:
        """Return how often each symbol (its value) was answered by each motion."""
        return dict(self._answers)

    def _look_at(self, said: _Waiting) -> None:
        motion = np.array([row for row in self._motion if row[0] > said.ends_s - QUIET_S])
        if len(motion) < 10:
            return
        times, v, omega = motion.T
        done = _motion_of(v, omega, said)
        key = said.symbol.value, done
        self._answers[key] = self._answers.get(key, 0) + 1
        if done != _MOTION.get(said.symbol):
            return
        if said.symbol in (Symbol.FORWARD, Symbol.BACK) and abs(said.before.v) < MOVES_V:
            self._add("lag_s", _half_way(times, np.abs(v)) - said.ends_s)
            if said.symbol is Symbol.FORWARD:
                self._add("speed", float(np.median(v[-5:])))
        elif said.symbol in (Symbol.SWIVEL_LEFT, Symbol.SWIVEL_RIGHT) and abs(said.before.omega) < MOVES_OMEGA:
            self._add("lag_s", _half_way(times, np.abs(omega)) - said.ends_s)
            self._add("swivel", float(np.abs(omega).max()))
        elif said.symbol in (Symbol.NUDGE_LEFT, Symbol.NUDGE_RIGHT):
            veer = self.model.veer if said.before.v > MOVES_V else 0.0
            turn = float(np.trapezoid(omega - veer, times))
            self._add("nudge", math.copysign(turn, turn if said.symbol is Symbol.NUDGE_LEFT else -turn))
        elif said.symbol is Symbol.FORWARD and said.before.v > MOVES_V:
            self._add("veer", float(np.mean(omega)))

    def _add(self, name: str, value: float) -> None:
        low, high = LIMITS[name]
        if not low <= value <= high:
            return
        values = self._values[name]
        values.append(value)
        changed: dict[str, float] = {name: float(np.median(values))}
        self.model = replace(self.model, **changed)


def _motion_of(v: object, omega: object, said: _Waiting) -> str:
    """Return the motion by which a symbol was answered, in words."""
    speeds, rates = np.asarray(v, float), np.asarray(omega, float)
    v_end, omega_end = float(np.median(speeds[-5:])), float(np.median(rates[-5:]))
    if said.symbol in (Symbol.NUDGE_LEFT, Symbol.NUDGE_RIGHT):
        turned = float(rates.mean())
        peak = float(rates[np.argmax(np.abs(rates))])
        return f"nudged {'left' if peak > 0.0 else 'right'}" if abs(peak) > MOVES_OMEGA / 2 or turned else "nothing"
    if abs(omega_end) > MOVES_OMEGA and abs(v_end) < MOVES_V:
        return "left" if omega_end > 0.0 else "right"
    if abs(v_end) > MOVES_V:
        return "forward" if v_end > 0.0 else "back"
    return "rest"


def _half_way(times: object, speeds: object) -> float:
    """Return the time [s] at which a rising speed passed half of its last value: a pure delay covers the same way."""
    at, speed = np.asarray(times, float), np.asarray(speeds, float)
    above = np.flatnonzero(speed >= 0.5 * float(np.median(speed[-5:])))
    return float(at[above[0]])
