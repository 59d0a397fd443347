"""Worker processes for many runs side by side; they end with the process that began them, however it ends."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context, parent_process

from waychair.errors import WorkerLost


def new_pool(jobs: int | None) -> ProcessPoolExecutor:
    """Return a pool of `jobs` fresh processes, by default one a core; a fork would share the renderer, which does not bear it."""
    return ProcessPoolExecutor(jobs, get_context("spawn"), initializer=_end_with_parent)


@contextmanager
def worker_pool(jobs: int | None) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool as `new_pool` makes it, for a command with the option --jobs.

    Raises:
        WorkerLost: a process was killed from outside.
    """
    try:
        with new_pool(jobs) as pool:
            yield pool
    except BrokenProcessPool as error:
        raise WorkerLost(
            "a worker process was killed from outside, perhaps because memory ran out: reduce --jobs"
        ) from error


def _end_with_parent() -> None:
    """End this process once its parent has: a worker would wait for the next run of a killed one for ever."""

    def watch() -> None:
        parent = parent_process()
        assert parent is not None
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, name="end with parent", daemon=True).start()
