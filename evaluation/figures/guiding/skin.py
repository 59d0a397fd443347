"""The driver model beside its sources: static points, directions of sequences by gap, and every pair of the vocabulary.

`SKIN_TRIALS=200` takes so many of each instead of 2000.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from waychair.control.haptics.patterns import vocabulary
from waychair.firmware_bridge.glove.layouts import TactorLayout, layout_named
from waychair.firmware_bridge.glove.messages import PlayStep
from waychair.simulation.rider.skin import Recogniser, SkinModel, bursts_of, felt_bursts
from waychair.types import FloatArray, Json

TRIALS = int(os.environ.get("SKIN_TRIALS", "2000"))
LAYOUT = "glove_3x3"
GAPS_MS = (50, 150, 250, 450, 700)


def skin(out: Path) -> Json:
    """Places told apart of 9 points, right directions of repeated sequences, and the least told apart pair of symbols."""
    model, layout, rng = SkinModel(), layout_named(LAYOUT), np.random.default_rng(0)
    places, share = places_of_points(layout, model, rng)
    directions = {gap: directions_right(layout, model, gap, rng) for gap in GAPS_MS}
    pairs = pairs_told_apart(layout, model, rng)
    worst = min(pairs, key=lambda pair: pairs[pair])
    slow = [right for gap, right in directions.items() if gap > 400]
    quick = [right for gap, right in directions.items() if gap < 400]
    passed = abs(places - 2.0) <= 0.2 and all(0.93 <= each <= 0.97 for each in slow) and max(quick) < min(slow)
    return {
        "passed": passed and pairs[worst] >= 0.90,
        "static_places": round(places, 2),
        "static_points_named_rightly": round(share, 3),
        "direction_right_by_gap_ms": {str(gap): round(right, 3) for gap, right in directions.items()},
        "least_pair": worst,
        "least_pair_told_apart": round(pairs[worst], 3),
        "pairs_below_90": {pair: round(right, 3) for pair, right in pairs.items() if right < 0.90},
    }


def places_of_points(layout: TactorLayout, model: SkinModel, rng: np.random.Generator) -> tuple[float, float]:
    """Return how many places static points tell (2 to the power of the transmitted bits), and the share named rightly."""
    names = [f"point {k}" for k in range(len(layout.tactors))]
    learnt = {name: (PlayStep(1 << k, 200, 300, 400),) for k, name in enumerate(names)}
    answers = _answers(layout, model, learnt, rng)
    joint = answers / answers.sum()
    expected = joint.sum(axis=1, keepdims=True) * joint.sum(axis=0, keepdims=True)
    bits = float((joint * np.log2(np.where(joint > 0.0, joint / np.where(expected > 0.0, expected, 1.0), 1.0))).sum())
    return 2.0**bits, float(np.trace(joint))


def directions_right(layout: TactorLayout, model: SkinModel, gap_ms: int, rng: np.random.Generator) -> float:
    """Return the share of right answers to a sequence of two motors, to or fro, felt twice with a gap between."""
    right = 0
    single = model.single_after(gap_ms)
    for _ in range(TRIALS):
        felt = []
        for spread in (model.single, single):
            errors = rng.normal(0.0, model.common, 2) + rng.normal(0.0, spread, (2, 2))
            two = felt_bursts(
                layout, bursts_of((PlayStep(1 << 4, 200, 150, 0), PlayStep(1 << 5, 200, 150, 400))), 1.0, errors
            )
            felt.append(two[0].y - two[1].y)
        right += sum(felt) > 0.0
    return right / TRIALS


def pairs_told_apart(layout: TactorLayout, model: SkinModel, rng: np.random.Generator) -> dict[str, float]:
    """Return for each pair of symbols the share of right answers where only the two can come."""
    learnt = vocabulary(LAYOUT).steps()
    found = {}
    for one, other in itertools.combinations(learnt, 2):
        answers = _answers(layout, model, {one: learnt[one], other: learnt[other]}, rng, max(TRIALS // 10, 100))
        found[f"{one} / {other}"] = float(np.trace(answers) / answers.sum())
    return found


def _answers(
    layout: TactorLayout,
    model: SkinModel,
    learnt: Mapping[str, tuple[PlayStep, ...]],
    rng: np.random.Generator,
    trials: int = TRIALS,
) -> FloatArray:
    """Return the counts (said, understood) of learnt patterns, each felt often."""
    recogniser, names = Recogniser(layout, dict(learnt), model), list(learnt)
    counts = np.zeros((len(names), len(names)))
    for k, name in enumerate(names):
        bursts = bursts_of(learnt[name])
        for _ in range(trials):
            errors = rng.normal(0.0, model.common, 2) + rng.normal(0.0, model.single, (len(bursts), 2))
            stretch = 1.0 + model.timing * float(rng.standard_normal())
            understood = recogniser.recognise(felt_bursts(layout, bursts, stretch, errors))
            if understood is not None:
                counts[k, names.index(understood)] += 1
    return counts
