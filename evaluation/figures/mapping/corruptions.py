"""Corrupted recordings: each maps within 5 cm, or is told by part and kind of its fault; none is wrong in silence."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import median

from evaluation.corruptions.drawing import corrupted, fault_of, faults, pictures_in, sound, torn
from evaluation.corruptions.verdict import TIMES, Judged, RunVerdict, judged, sentences_of
from evaluation.corruptions.warm_runner import FinishedRun, WarmRunner
from evaluation.figures.mapping.logs import DATA
from evaluation.runs.kept_runs import kept_folder
from waychair.types import Json

RUNS = 300
MISBLAMED = 0.02
_SOUND_LIMIT_S = 60.0  # of processor time
_SOUND_RUNS, _SOUND_RUNS_OF_PICTURES = 3, 1
_KINDS = {
    1: "aids",
    2: "messages of the lidar",
    4: "files",
    5: "picture folders",
}
_BAD = (RunVerdict.TRACEBACK, RunVerdict.SILENT_WRONG, RunVerdict.TOO_SLOW, RunVerdict.TOO_LARGE)


def corruptions(out: Path) -> Json:
    """300 seeded corruptions: 0 tracebacks, 0 maps wrong in silence, at most 2 % misblamed, time and memory <= 3 times.

    `CORRUPTIONS_RUNS=30` takes a sample, `CORRUPTIONS_FIRST=60` begins at another seed, and `CORRUPTIONS_FAULTS=log_`
    takes those seeds only whose fault's name contains the text.
    """
    count, first = int(os.environ.get("CORRUPTIONS_RUNS", str(RUNS))), int(os.environ.get("CORRUPTIONS_FIRST", "0"))
    named = os.environ.get("CORRUPTIONS_FAULTS", "")
    pictures = pictures_in(DATA)
    seeds = [k for k in range(first, first + count) if named in fault_of(k, pictures).name]
    with _bench(pictures) as bench:
        rows = [_kept_or_run(seed, bench) for seed in seeds]
    return _figures(rows, pictures, whole=not named)


@dataclass(slots=True)
class _Bench:
    """The warm process, the sound runs, and a folder for the recordings."""

    folder: Path
    runner: WarmRunner
    pictures: Path | None
    sound_runs: dict[str, tuple[FinishedRun, tuple[str, ...]]] = field(default_factory=dict)

    def of_sound(self, name: str) -> tuple[FinishedRun, tuple[str, ...]]:
        """Return the median run of a sound recording, and its sentences."""
        if name not in self.sound_runs:
            folder = self.folder / f"sound_{name}"
            folder.mkdir()
            path = sound(name, folder, self.pictures)
            count = _SOUND_RUNS_OF_PICTURES if name == "pictures" else _SOUND_RUNS
            runs = [self._mapped(path, folder / f"map_{k}") for k in range(count)]
            cpu, memory = (median(getattr(run, what) for run in runs) for what in ("cpu_s", "memory_mb"))
            run = FinishedRun(runs[0].status, runs[0].text, cpu, runs[0].wall_s, memory)
            self.sound_runs[name] = (run, sentences_of(run.text))
        return self.sound_runs[name]

    def _mapped(self, path: Path, out: Path) -> FinishedRun:
        return self.runner.run(["map", str(path), "--out", str(out)], _SOUND_LIMIT_S)


@contextmanager
def _bench(pictures: Path | None) -> Iterator[_Bench]:
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        warming = []
        for name in ("bag.mcap", "cloud.mcap", "log"):
            (folder / f"warming_{name}").mkdir()
            warming.append(sound(name, folder / f"warming_{name}", None))
        warming.append(torn(folder / "torn"))
        runner = stack.enter_context(WarmRunner(warming))
        yield _Bench(folder, runner, pictures)


def _kept_or_run(seed: int, bench: _Bench) -> Judged:
    """Return the verdict on a seed, from an earlier measurement of the same code where there is one."""
    import pickle

    kept = kept_folder("corruptions")
    path = None if kept is None else kept / f"{seed}.pickle"
    if path is not None and path.exists():
        known: Judged = pickle.loads(path.read_bytes())
        return known
    row = _run(seed, bench)
    if path is not None:
        from waychair.files import write_bytes

        write_bytes(path, pickle.dumps(row))
    told = " | ".join(row.sentences)
    print(
        f"{seed} {row.fault}: {row.verdict} {row.rmse_m} m, {row.time_times} x: {told[:300]}",
        file=sys.stderr,
        flush=True,
    )
    return row


def _run(seed: int, bench: _Bench) -> Judged:
    folder = bench.folder / f"seed_{seed}"
    folder.mkdir()
    made = corrupted(seed, fault_of(seed, bench.pictures), folder, bench.pictures)
    if made.original == "pictures" and bench.pictures is not None:
        shutil.copyfile(bench.pictures / "groundtruth.txt", folder / "groundtruth.tum")
    sound_run, told = bench.of_sound(made.original)
    run = bench.runner.run(["map", str(made.path), "--out", str(folder / "map")], TIMES * sound_run.cpu_s)
    row = judged(made, run, folder / "map", sound_run, told)
    shutil.rmtree(folder)
    return row


def _figures(rows: list[Judged], pictures: Path | None, *, whole: bool) -> Json:
    counts = Counter(row.verdict for row in rows)
    kinds = {
        _KINDS[kind]: dict(Counter(str(row.verdict) for row in rows if row.kind == kind)) for kind in sorted(_KINDS)
    }
    misblamed = counts[RunVerdict.MISBLAMED] / max(1, len(rows))
    bad = sum(counts[verdict] for verdict in _BAD)
    passed = bad == 0 and misblamed <= MISBLAMED and counts[RunVerdict.UNNAMED] == 0
    _print_table(kinds, counts)
    return {
        "passed": bool(passed and whole),
        "runs": len(rows),
        "kinds_of_fault": len(faults(pictures)),
        **{str(verdict).replace(" ", "_"): counts[verdict] for verdict in RunVerdict},
        "most_time": max((row.time_times for row in rows), default=0.0),
        "most_memory": max((row.memory_times for row in rows), default=0.0),
        "by_kind": kinds,
        "rows": [_row(row) for row in rows],
    }


def _row(row: Judged) -> Json:
    """Return a row without the number that JSON does not know."""
    return {name: None if value != value else value for name, value in asdict(row).items()}  # noqa: PLR0124


def _print_table(kinds: dict[str, dict[str, int]], counts: Counter[RunVerdict]) -> None:
    """Print the verdicts by kind, and of all."""
    print(f"{'':24}" + "".join(f"{verdict:>13}" for verdict in RunVerdict))
    for name, own in (*kinds.items(), ("all", {str(verdict): count for verdict, count in counts.items()})):
        print(f"{name:24}" + "".join(f"{own.get(str(verdict), 0):13}" for verdict in RunVerdict))
