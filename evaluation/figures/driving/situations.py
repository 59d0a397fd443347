"""Two hundred seeded driving situations: no silent standing, no turning or reversing without end, causes by name.

The environment variable `SITUATIONS_RUNS` takes a sample: so many seeds, every kind in turn.
"""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import asdict
from pathlib import Path

from evaluation.runs.kept_runs import over_seeds
from evaluation.runs.watched_drive import WatchedDrive, watch
from evaluation.scenes.situations import situation
from waychair.types import Json

RUNS = int(os.environ.get("SITUATIONS_RUNS", "200"))
LONGEST_UNSAID_S, MOST_TURNED, MOST_REVERSALS, NAMED_RIGHT = 3.0, 720.0, 4, 0.95


def situations(out: Path) -> Json:
    """At most 3 s at rest without a sentence and an estimate, 720 degrees and 4 reversals in a row; 95 % named right."""
    runs = over_seeds("situations", _run, RUNS)
    for row in _rows(runs):
        print(f"  {row}", flush=True)
    named = [run for run in runs if run.cause]
    right = sum(run.named == run.cause for run in named)
    kept = {
        "silent": [run.seed for run in runs if run.unsaid_s > LONGEST_UNSAID_S],
        "turned": [run.seed for run in runs if run.turned > MOST_TURNED],
        "reversed": [run.seed for run in runs if run.reversals > MOST_REVERSALS],
        "touched": [run.seed for run in runs if run.contacts],
    }
    return {
        "passed": not any(kept.values()) and right >= NAMED_RIGHT * len(named),
        "runs": len(runs),
        **{f"runs_{name}": len(seeds) for name, seeds in kept.items()},
        "named_right": round(right / max(1, len(named)), 3),
        "longest_unsaid_s": max(run.unsaid_s for run in runs),
        "longest_rest_without_a_sentence_s": max(run.rest_s for run in runs),
        "most_turned_deg": max(run.turned for run in runs),
        "most_reversals": max(run.reversals for run in runs),
        "contacts": sum(run.contacts for run in runs),
        "outcomes": dict(Counter(run.outcome for run in runs)),
        "seeds": kept,
        "confusions": _confusions(named),
        "rows": _rows(runs),
        "runs_each": [asdict(run) for run in runs],
    }


def _run(seed: int) -> WatchedDrive:
    return watch(situation(seed), seed)


def _rows(runs: list[WatchedDrive]) -> list[Json]:
    """Return a row a kind: the worst of its runs, and their outcomes."""
    kinds = dict.fromkeys(run.kind for run in runs)
    return [_row(kind, [run for run in runs if run.kind == kind]) for kind in kinds]


def _row(kind: str, runs: list[WatchedDrive]) -> Json:
    return {
        "kind": kind,
        "runs": len(runs),
        "unsaid_s": max(run.unsaid_s for run in runs),
        "turned": max(run.turned for run in runs),
        "reversals": max(run.reversals for run in runs),
        "contacts": sum(run.contacts for run in runs),
        "cause": runs[0].cause,
        "named": dict(Counter(run.named for run in runs)),
        "outcomes": dict(Counter(run.outcome for run in runs)),
    }


def _confusions(runs: list[WatchedDrive]) -> Json:
    """Return for each cause how often each cause was named."""
    return {
        cause: dict(Counter(run.named for run in runs if run.cause == cause)) for cause in {r.cause: 0 for r in runs}
    }
