"""A worker thread for heavy work, so that callbacks stay short. Kernels that release the GIL run in parallel."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from rclpy.node import Node

T = TypeVar("T")


class Worker:
    """One thread with a short queue. When the queue is full the oldest job is dropped, since newer data matter more.

    Results are delivered in the executor's thread, and a job's exception is raised there.
    """

    def __init__(self, node: Node, length: int = 4) -> None:
        self.dropped = 0
        self._length = length
        self._pool = ThreadPoolExecutor(1, "worker")
        self._waiting: deque[Future[Any]] = deque()
        self._done: deque[tuple[Callable[[Any], None], Future[Any]]] = deque()
        self._back = node.create_guard_condition(self._hand_back)

    def submit(self, job: Callable[[], T], done: Callable[[T], None]) -> None:
        """Run `job` in the worker thread, then `done` with its result in the executor's thread."""
        self._waiting = deque(future for future in self._waiting if not (future.running() or future.done()))
        if len(self._waiting) >= self._length:
            self._waiting.popleft().cancel()
            self.dropped += 1
        future = self._pool.submit(job)
        self._waiting.append(future)
        future.add_done_callback(lambda ended: self._ended(done, ended))

    def close(self) -> None:
        """Drop the queued jobs, and wait for the running one."""
        self._pool.shutdown(cancel_futures=True)

    def _ended(self, done: Callable[[Any], None], future: Future[Any]) -> None:
        if not future.cancelled():
            self._done.append((done, future))
            self._back.trigger()

    def _hand_back(self) -> None:
        while self._done:
            done, future = self._done.popleft()
            done(future.result())
