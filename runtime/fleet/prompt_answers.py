"""Answers to other chairs at once, by a thread of their own, while the chair's own loop is busy with a tick of its drive."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Self

from waychair.runtime.fleet.network.zenoh_transport import ZenohTransport

LOOKS_S = 0.1
"""s after which the thread looks whether it has to end."""


class PromptAnswers:
    """Calls `answer` as soon as a Request or an Answer has come, until it is closed."""

    def __init__(self, transport: ZenohTransport, answer: Callable[[], None]) -> None:
        """`answer` takes the messages so far; it is called by another thread than this one."""
        self._transport, self._answer = transport, answer
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="prompt answers", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Call nothing any more."""
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ended.is_set():
            self._transport.wait(LOOKS_S)
            if self._transport.is_urgent and not self._ended.is_set():
                self._answer()
