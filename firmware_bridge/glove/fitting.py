"""How a device sits on one rider: its hand, how far it is turned round the limb, and the strength of each motor.

Both hands lie palm down, so the grid of a glove is not mirrored. A glove that was put on askew is turned by whole places of
its rings: the calibration plays the motors of a ring in turn, and the rider says which felt where the ring begins, such as foremost.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass

from waychair.errors import GloveError
from waychair.firmware_bridge.glove.layouts import MOTORS_MAX, TactorLayout
from waychair.firmware_bridge.glove.messages import Hand, PlayStep

GAIN_MAX, GAIN_MIN = 255, 80
"""Limits of a motor's gain: one that is weaker is not felt, so it would leave a hole in patterns."""

ANSWERS_MIN = 3
"""Fewest answers on which a turn is decided."""

AGREEMENT = 0.8
"""Least length of the mean of the answers as unit vectors: of three answers, one may be a place beside the others on a ring of eight;
on a ring of four all agree."""


@dataclass(frozen=True, slots=True)
class Fitting:
    """One rider's fitting. `turned`: by how many places to the left each ring sits; `gains`: of each motor, of 255.

    Empty tuples: every ring sits straight, every motor at full strength.
    """

    hand: Hand = Hand.RIGHT
    turned: tuple[int, ...] = ()
    gains: tuple[int, ...] = ()

    def check(self, layout: TactorLayout) -> None:
        """
        Raises:
            GloveError: the fitting is for another layout, or a gain is out of its limits.
        """
        if self.turned and len(self.turned) != len(layout.rings):
            raise GloveError(
                f"the rider's fitting turns {len(self.turned)} rings, but '{layout.name}' has {len(layout.rings)}: fit it again"
            )
        if self.gains and len(self.gains) != len(layout.tactors):
            raise GloveError(
                f"the rider's fitting has {len(self.gains)} gains, but '{layout.name}' has {len(layout.tactors)} motors: "
                "tune it again"
            )
        for motor, gain in enumerate(self.gains):
            if not GAIN_MIN <= gain <= GAIN_MAX:
                raise GloveError(f"the gain of motor {motor} is {gain}: it must lie from {GAIN_MIN} to {GAIN_MAX}")

    def outputs(self, layout: TactorLayout) -> tuple[int, ...]:
        """Return the board's output that sits at each place of the layout; raises as `check`."""
        self.check(layout)
        at = list(range(len(layout.tactors)))
        for ring, turned in zip(layout.rings, self.turned or (0,) * len(layout.rings), strict=True):
            for k, place in enumerate(ring):
                at[place] = ring[(k + turned) % len(ring)]
        return tuple(at)

    def output_gains(self, layout: TactorLayout) -> bytes:
        """Return the 16 gains of GAIN, by output: each is that of the place where the output sits; raises as `check`."""
        gains = [GAIN_MAX] * MOTORS_MAX
        for place, output in enumerate(self.outputs(layout)):
            if self.gains:
                gains[output] = self.gains[place]
        return bytes(gains)


def fitted_step(step: PlayStep, outputs: Sequence[int]) -> PlayStep:
    """Return a step with a mask of the layout's places as one with a mask of the board's outputs."""
    mask = sum(1 << output for place, output in enumerate(outputs) if step.mask >> place & 1)
    return PlayStep(mask, step.strength, step.on_ms, step.off_ms)


def turned_from_answers(answers: Sequence[int], ring: Sequence[int]) -> int:
    """Return by how many places a ring sits to the left, from the outputs that felt where it begins, one for each round.

    Raises:
        GloveError: there are too few answers, one is not of the ring, or they disagree.
    """
    if len(answers) < ANSWERS_MIN:
        raise GloveError(f"{len(answers)} answers do not decide how the glove sits: give at least {ANSWERS_MIN}")
    if strange := [answer for answer in answers if answer not in ring]:
        raise GloveError(f"motor {strange[0]} is not one of the ring {list(ring)}: answer with one of them")
    places = [ring.index(answer) for answer in answers]
    mean = sum(cmath.exp(1j * math.tau * place / len(ring)) for place in places) / len(places)
    if abs(mean) < AGREEMENT:
        raise GloveError(
            f"the answers name different motors ({', '.join(map(str, answers))}): fasten the glove and feel again"
        )
    return round(cmath.phase(mean) / math.tau * len(ring)) % len(ring)


def tuned_gain(gain: int, felt: str) -> int:
    """Return the next gain of a motor that felt `weaker` or `stronger` than the one it is compared with, or `same`.

    Raises:
        GloveError: the answer is none of these.
    """
    factors = {"weaker": 1.25, "same": 1.0, "stronger": 0.8}
    if felt not in factors:
        raise GloveError(f"'{felt}' is no answer: say weaker, same or stronger")
    return min(max(round(gain * factors[felt]), GAIN_MIN), GAIN_MAX)
