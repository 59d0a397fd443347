"""Where recordings are mapped: processes of this computer, or the workers of a cluster behind the same seam."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Protocol

from waychair.offline.many.bag_runs import BagJob, Running, run_bag
from waychair.offline.many.outcomes import Outcome


class Pool(Protocol):
    """Maps recordings, several at a time."""

    def outcomes(self, jobs: Sequence[BagJob]) -> Iterator[Outcome]:
        """Yield the outcome of each job as it ends.

        Raises:
            ClusterError: the cluster cannot be reached, or went away.
        """
        ...


class ProcessPool:
    """So many mapping processes of this computer at a time."""

    def __init__(self, count: int) -> None:
        self._count = count

    def outcomes(self, jobs: Sequence[BagJob]) -> Iterator[Outcome]:
        """Yield the outcome of each job as it ends; an interrupt lets the running ones save their checkpoints."""
        running = Running()
        with ThreadPoolExecutor(self._count, thread_name_prefix="map-all") as threads:
            begun = [threads.submit(run_bag, job, running) for job in jobs]
            try:
                for each in as_completed(begun):
                    yield each.result()
            except BaseException:
                running.stop()
                try:
                    threads.shutdown(cancel_futures=True)
                except KeyboardInterrupt:  # a second one waits for nothing
                    running.stop(signal.SIGKILL)
                raise


def cores() -> int:
    """Return the number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def processes_of(memory_limit: int) -> int:
    """Return how many mapping processes of so many bytes each this computer can run at a time: one a core at most."""
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return max(1, min(cores(), memory // max(memory_limit, 1)))
