"""Many recordings become map folders, with one page and one report of all; the same command goes on where it was."""

from __future__ import annotations

import fcntl
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path

from waychair import __version__
from waychair.errors import OutputError
from waychair.files import os_error_text, read_text, write_json
from waychair.offline.many.bag_runs import WORK, BagJob
from waychair.offline.many.bags import Bag, fingerprint, size_of
from waychair.offline.many.index_page import write_index
from waychair.offline.many.outcomes import Outcome, OutcomeState
from waychair.offline.many.pools import Pool
from waychair.types import Json

REPORT, INDEX = "report.json", "index.html"

_WRITTEN_EVERY_S = 5.0  # s between two writings of report and page while recordings are mapped


@dataclass(frozen=True, slots=True)
class MapOptions:
    """What holds for all recordings: see `bag_runs.BagJob`."""

    module: str
    options: tuple[str, ...] = ()
    config: Path | None = None
    memory_limit: int = 4_000_000_000
    retry_failed: bool = False


@dataclass(slots=True)
class ManyMaps:
    """The recordings, and what became of each by its name, in the order in which they ended."""

    bags: tuple[Bag, ...]
    outcomes: dict[str, Outcome] = field(default_factory=dict)
    seconds: float = 0.0

    def count(self, *states: OutcomeState) -> int:
        """Return the number of recordings in one of the states."""
        return sum(outcome.state in states for outcome in self.outcomes.values())

    @property
    def failed(self) -> int:
        """The number of recordings without a map."""
        return len(self.bags) - self.count(OutcomeState.DONE)

    def as_json(self) -> Json:
        """Return the report: per recording state, reason, costs and host; then sums."""
        rows: list[Json] = []
        for bag in self.bags:
            outcome = self.outcomes.get(bag.name)
            told: Json = {"state": "waiting"} if outcome is None else asdict(outcome)
            rows.append({"name": bag.name, "path": str(bag.path), **told})
        new = [outcome for outcome in self.outcomes.values() if not outcome.kept]
        return {
            "waychair": __version__,
            "recordings": rows,
            "done": self.count(OutcomeState.DONE),
            "failed": self.failed,
            "kept": sum(outcome.kept for outcome in self.outcomes.values()),
            "seconds": round(self.seconds, 3),
            "cpu_s": round(sum(outcome.cpu_s for outcome in new), 3),
            "peak_memory_mb": max((outcome.peak_memory_mb for outcome in self.outcomes.values()), default=0.0),
        }


def map_many(
    bags: Sequence[Bag],
    out: Path,
    options: MapOptions,
    pool: Pool,
    told: Callable[[Bag, Outcome, int], None] = lambda bag, outcome, number: None,
) -> ManyMaps:
    """Map all recordings into `out/NAME/`, and write report.json and index.html there, also where it is interrupted.

    `told` is called as each ends, with its number among those that have. The largest are begun first, so that none of
    them is left for the end.

    Raises:
        OutputError: the folder cannot be written, or another run writes into it.
        ClusterError: the cluster cannot be reached, or went away.
        ConfigError: the settings file cannot be read.
    """
    began, written = time.monotonic(), -_WRITTEN_EVERY_S
    maps, by_name = ManyMaps(tuple(bags)), {bag.name: bag for bag in bags}
    with _alone(out):

        def ended(outcome: Outcome) -> None:
            nonlocal written
            maps.outcomes[outcome.name] = outcome
            maps.seconds = time.monotonic() - began
            told(by_name[outcome.name], outcome, len(maps.outcomes))
            if maps.seconds - written >= _WRITTEN_EVERY_S:
                written = maps.seconds
                _write(out, maps)

        jobs = _jobs(bags, out.absolute(), options, ended)
        try:
            for outcome in pool.outcomes(jobs):
                ended(outcome)
        finally:
            maps.seconds = time.monotonic() - began
            _write(out, maps)
    return maps


def _jobs(bags: Sequence[Bag], out: Path, options: MapOptions, ended: Callable[[Outcome], None]) -> list[BagJob]:
    """Return the jobs, the largest recording first; those that are not there are told as failed."""
    from waychair.errors import ConfigError

    config = "" if options.config is None else read_text(options.config, ConfigError)
    jobs = []
    for bag in bags:
        found = fingerprint(bag.path, (*options.options, config))
        job = BagJob(
            name=bag.name,
            path=str(bag.path),
            out=str(out),
            fingerprint=found or "",
            size=size_of(bag.path),
            module=options.module,
            options=options.options,
            config=config,
            memory_limit=options.memory_limit,
            retry_failed=options.retry_failed,
        )
        if found is None:
            ended(job.outcome(OutcomeState.FAILED, f"there is no recording at {bag.path}; check the path"))
        else:
            jobs.append(job)
    return sorted(jobs, key=lambda job: -job.size)


@contextmanager
def _alone(out: Path) -> Iterator[None]:
    """Make the folder, and let no other run write into it during the block.

    Raises:
        OutputError: it cannot be written, or another run does.
    """
    try:
        (out / WORK).mkdir(parents=True, exist_ok=True)
        file = (out / WORK / "lock").open("w")
    except OSError as error:
        raise OutputError(f"cannot write {out}: {os_error_text(error)}") from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise OutputError(
                f"another waychair map-all writes into {out}: wait for its end, or choose another --out"
            ) from error
        yield


def _write(out: Path, maps: ManyMaps) -> None:
    write_json(out / REPORT, maps.as_json(), lasting=False)
    write_index(out / INDEX, maps.as_json())
