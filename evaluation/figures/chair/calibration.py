"""Calibration of twenty simulated chairs by their encoders: errors of the commanded speeds.

Twelve chairs have electronics of the model's form with different values; eight have one more effect each. They are
commanded without ripple and slip on the grid of `command_grid`; the speeds after five seconds count.
"""

from __future__ import annotations

from pathlib import Path

from evaluation.runs.kept_runs import figure_pool
from evaluation.scenes.chair_score import ChairScore, InverseError, acceptance_chairs, score_chair
from waychair.calibration.chair_body import CHAIR_A
from waychair.types import Json

BARS = {12: (10.0, 15.0), 8: (25.0, 30.0)}
"""Greatest error [mm/s, mrad/s] of chairs of the model's form, by the converter's bits; 89 levels, three times each."""


def inverse(out: Path) -> Json:
    """Greatest error of the fitted inverse per chair, and of the linear model on the same commands."""
    chairs = acceptance_chairs()
    tasks = [(bits, name, seed) for bits in BARS for seed, name in enumerate(chairs)]
    with figure_pool() as pool:
        scores = list(pool.map(_score, tasks))
    rows = [_row(bits, score) for (bits, _, _), score in zip(tasks, scores, strict=True)]
    inside = {bits: [row for row in rows if row["bits"] == bits and row["inside"]] for bits in BARS}
    figures: Json = {"passed": all(row["within_bar"] for kept in inside.values() for row in kept)}
    for bits, (bar_v, bar_omega) in BARS.items():
        kept = [row["fitted"] for row in inside[bits] if row["fitted"] is not None]
        figures |= {
            f"inside_{bits}_bit": len(inside[bits]),
            f"bar_{bits}_bit_mm_s": bar_v,
            f"bar_{bits}_bit_mrad_s": bar_omega,
            f"worst_{bits}_bit_mm_s": max((row["max_mm_s"] for row in kept), default=None),
            f"worst_{bits}_bit_mrad_s": max((row["max_mrad_s"] for row in kept), default=None),
        }
    return {**figures, "chairs": rows}


def _score(task: tuple[int, str, int]) -> ChairScore:
    bits, name, seed = task
    return score_chair(name, acceptance_chairs()[name], seed, bits, CHAIR_A)


def _row(bits: int, score: ChairScore) -> Json:
    bar_v, bar_omega = BARS[bits]
    fitted = score.fitted and _figures(score.fitted)
    return {
        "bits": bits,
        "chair": score.name,
        "inside": score.inside,
        "fitted": fitted,
        "linear": _figures(score.linear),
        "within_bar": bool(fitted and fitted["max_mm_s"] <= bar_v and fitted["max_mrad_s"] <= bar_omega),
        "refused": score.refused,
    }


def _figures(error: InverseError) -> Json:
    return {
        "max_mm_s": round(1e3 * error.max_v, 1),
        "max_mrad_s": round(1e3 * error.max_omega, 1),
        "rms_mm_s": round(1e3 * error.rms_v, 1),
        "rms_mrad_s": round(1e3 * error.rms_omega, 1),
        "commands": error.commands,
        "beyond_reach": error.beyond,
    }
