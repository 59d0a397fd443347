"""Recordings on the workers of a Dask cluster; the only importer of `distributed` (extra `[cluster]`).

A job is a small task; the mapping runs in a process of the worker's own, so that a recording that kills its process kills
no worker, and its result is on disk. Few jobs are handed out at a time: those that wait here are no suspects when a
worker dies (distributed #5234).
"""

from __future__ import annotations

import asyncio
import logging
import queue
import secrets
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

from waychair.errors import ClusterError, MissingExtra
from waychair.files import os_error_text, write_text
from waychair.install_advice import install_command
from waychair.offline.many.bag_runs import TOKEN, WORK, BagJob, packed, receive, run_bag, run_sent_bag
from waychair.offline.many.outcomes import Outcome, OutcomeState

LARGEST_SENT = 2_000_000_000
"""bytes; a larger recording is not sent to a worker, which has to have a path to it."""

CONNECT_S = 10.0
"""s in which the scheduler has to answer."""

WORKERLESS_S = 60.0
"""s without any worker after which the cluster counts as gone."""

_LOOK_S = 1.0  # s between two looks at the cluster
_AHEAD = 1  # jobs handed out beyond the ones that run, so that no worker waits
_DEATHS = 3  # a job whose workers died so often is given up
_SENT_AT_ONCE = 2  # recordings in this computer's memory


@dataclass(frozen=True, slots=True)
class SharedFolder:
    """A folder that the workers see under another path."""

    here: str
    there: str

    def translated(self, path: str) -> str | None:
        """Return the path as a worker sees it; None outside the folder."""
        rest = path.removeprefix(self.here.rstrip("/"))
        if rest == path or (rest and not rest.startswith("/")):
            return None
        return self.there.rstrip("/") + rest


def shared_path(path: str, shared: Sequence[SharedFolder]) -> str:
    """Return a path as a worker sees it, by the first shared folder that holds it."""
    return next((found for each in shared if (found := each.translated(path)) is not None), path)


class ClusterPool:
    """The workers of a Dask cluster: each of their threads maps one recording at a time, in a process of its own."""

    def __init__(self, address: str, shared: Sequence[SharedFolder] = ()) -> None:
        """`address` of the scheduler, such as tcp://HOST:8786; `shared` folders, as the workers see them."""
        self._address, self._shared = address, tuple(shared)

    def outcomes(self, jobs: Sequence[BagJob]) -> Iterator[Outcome]:
        """Yield the outcome of each job as it ends.

        Raises:
            MissingExtra: `distributed` is not installed.
            ClusterError: there is no cluster at the address, it has no worker, or it went away.
        """
        if not jobs:
            return
        with _Session(self._address) as session:
            yield from _Dispatch(session, self._shared, jobs).outcomes()


def _event_loop() -> tuple[Any, Callable[[], None]]:
    """Return an event loop of tornado's that runs in a thread, and a function that ends it.

    On a computer with much else to do the thread may begin late; `distributed` itself gives up after 10 s, by an assertion.
    """
    from tornado.ioloop import IOLoop

    began: Future[tuple[IOLoop, asyncio.Event]] = Future()

    async def run() -> None:
        stopped = asyncio.Event()
        began.set_result((IOLoop.current(), stopped))
        await stopped.wait()

    threading.Thread(target=lambda: asyncio.run(run()), daemon=True, name="event loop of a cluster").start()
    loop, stopped = began.result()
    return loop, lambda: loop.add_callback(stopped.set)


class _Session:
    """A connection to a cluster."""

    def __init__(self, address: str) -> None:
        self.address = address
        self.client: Any = None
        self._stop_loop: Callable[[], None] = lambda: None

    def __enter__(self) -> Self:
        try:
            from distributed import Client
        except ImportError as error:
            raise MissingExtra(f"a cluster needs distributed: {install_command('cluster')}") from error
        for name in ("distributed.client", "distributed.core", "distributed.comm", "distributed.utils"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # an error says what they say about lost links
        try:
            connect: Any = Client  # untyped
            loop, self._stop_loop = _event_loop()
            self.client = connect(self.address, timeout=CONNECT_S, set_as_default=False, loop=loop)
        except (OSError, ValueError, TimeoutError) as error:
            raise ClusterError(
                f"there is no cluster at {self.address}: start one with `dask scheduler` and `dask worker ADDRESS`, or "
                "leave out --cluster"
            ) from error
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(Exception):  # a cluster that went away cannot be told good-bye
            self.client.close(timeout=2)
        self._stop_loop()

    def threads(self) -> int:
        """Return how many jobs the workers run at a time; 0 without any.

        Raises:
            ClusterError: the scheduler does not answer.
        """
        if self.client.status != "running":
            raise self.gone("its scheduler does not answer")
        try:
            counts: dict[str, int] = self.client.nthreads()
        except Exception as error:  # of any kind, where the link breaks while it asks
            raise self.gone("its scheduler does not answer") from error
        return sum(counts.values())

    def gone(self, why: str) -> ClusterError:
        """Return the error of a cluster that went away."""
        return ClusterError(
            f"the cluster at {self.address} went away: {why}; start it again and run the same command, which goes on"
        )


class _Dispatch:
    """Jobs on their way to the workers and back."""

    def __init__(self, session: _Session, shared: Sequence[SharedFolder], jobs: Sequence[BagJob]) -> None:
        self._session, self._shared = session, shared
        self._waiting = list(reversed(jobs))
        self._out: dict[Any, tuple[BagJob, bool]] = {}  # futures with their jobs, and whether the recording was sent
        self._deaths: dict[str, int] = {}
        self._to_send: list[BagJob] = []
        self._workerless_s = 0.0
        self._token = secrets.token_hex(8)
        self._ends: queue.SimpleQueue[Any] = queue.SimpleQueue()  # futures that have ended

    def outcomes(self) -> Iterator[Outcome]:
        for out in {job.out for job in self._waiting}:
            write_text(Path(out) / WORK / TOKEN, self._token, lasting=False)
        while self._waiting or self._out or self._to_send:
            yield from self._hand_out()
            if not self._out:
                self._look()
                continue
            try:
                yield from self._ended(self._ends.get(timeout=_LOOK_S))
            except queue.Empty:
                self._look()

    def _look(self) -> None:
        """Notice a cluster that went away.

        Raises:
            ClusterError: its scheduler does not answer, or it has had no worker for long.
        """
        if self._session.threads():
            self._workerless_s = 0.0
            return
        self._workerless_s += _LOOK_S
        if self._workerless_s > WORKERLESS_S:
            raise self._session.gone(f"it has had no worker for {WORKERLESS_S:.0f} s")
        time.sleep(0.0 if self._out else _LOOK_S)

    def _hand_out(self) -> Iterator[Outcome]:
        """Submit as many jobs as the workers take, sent ones first; yield the outcome of those that cannot be sent."""
        room = self._session.threads()
        room = room + _AHEAD - len(self._out) if room else 0
        while room > 0 and self._to_send and sum(sent for _, sent in self._out.values()) < _SENT_AT_ONCE:
            failed = self._send(self._to_send.pop())
            if failed is not None:
                yield failed
            room -= 1
        while room > 0 and self._waiting:
            job = self._waiting.pop()
            there = replace(
                job,
                path=shared_path(job.path, self._shared),
                out=shared_path(job.out, self._shared),
                token=self._token,
            )
            self._submit(job, False, run_bag, there)
            room -= 1

    def _submit(self, job: BagJob, sent: bool, function: Callable[..., object], *arguments: object) -> None:
        key = f"map-{job.name}-{secrets.token_hex(4)}"
        try:
            future = self._session.client.submit(function, *arguments, pure=False, key=key)
        except Exception as error:  # distributed raises several kinds where the link breaks
            raise self._session.gone(str(error) or type(error).__name__) from error
        self._out[future] = (job, sent)
        future.add_done_callback(self._ends.put)

    def _send(self, job: BagJob) -> Outcome | None:
        """Submit a job with its recording; return the outcome where that is impossible."""
        if job.size > LARGEST_SENT:
            return job.outcome(
                OutcomeState.STOPPED,
                f"the workers do not see {job.path}, and its {job.size / 1e9:.1f} GB are too many to be sent "
                f"(at most {LARGEST_SENT / 1e9:.0f}): give --shared PREFIX=PREFIX",
            )
        try:
            data = packed(Path(job.path))
        except OSError as error:
            return job.outcome(OutcomeState.STOPPED, f"cannot read {job.path}: {os_error_text(error)}")
        try:
            sent = self._session.client.scatter(data, hash=False)
        except Exception as error:  # distributed raises several kinds where the link breaks
            raise self._session.gone(str(error) or type(error).__name__) from error
        self._submit(job, True, run_sent_bag, job, sent)
        return None

    def _ended(self, future: Any) -> Iterator[Outcome]:
        """Yield the outcome of a job, unless it has to be tried again or sent."""
        from distributed.scheduler import KilledWorker

        job, sent = self._out.pop(future)
        if future.status == "cancelled":
            self._session.threads()
            raise self._session.gone("it dropped its tasks")
        try:
            result = future.result()
        except KilledWorker:
            deaths = self._deaths[job.name] = self._deaths.get(job.name, 0) + 1
            if deaths < _DEATHS:
                (self._to_send if sent else self._waiting).append(job)
            else:
                yield job.outcome(OutcomeState.STOPPED, f"{deaths} workers died while they had it: look at their logs")
            return
        except ModuleNotFoundError as error:
            raise ClusterError(
                f"the workers at {self._session.address} cannot import {error.name}: install waychair {job.version} there"
            ) from error
        except Exception as error:  # noqa: BLE001
            # an error of the worker's, of any kind, belongs to this recording alone
            yield job.outcome(OutcomeState.STOPPED, f"the worker failed: {type(error).__name__}: {error}")
            return
        outcome, maps = result if sent else (result, b"")
        if outcome.state is OutcomeState.UNREACHED:
            self._to_send.append(job)
            return
        if sent:
            try:
                receive(job, outcome, maps)
            except OSError as error:
                outcome = replace(
                    outcome, state=OutcomeState.STOPPED, why=f"cannot write {job.out}: {os_error_text(error)}"
                )
        yield outcome
