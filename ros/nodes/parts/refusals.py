"""Answers to senders of topics, who get none from ROS: each refusal is logged once, and kept for status and /diagnostics."""

from __future__ import annotations

import time
from collections.abc import Callable

from waychair.ros.messages.reports import DiagnosticLevel, Report

AGAIN_S = 30.0
"""A sender that repeats a refused message reads the same sentence in the log again after this time."""


class Refusals:
    """The last refusal of one kind of message, as a sentence in `last`; empty after a message that was accepted."""

    def __init__(self, name: str, log: Callable[[str], object]) -> None:
        """`name` is that of the report on /diagnostics; `log` logs a sentence."""
        self.last = ""
        self._name = name
        self._log = log
        self._logged, self._logged_s = "", 0.0

    def refused(self, sentence: str) -> None:
        """Tell a refusal, and keep it."""
        self.last = sentence
        now_s = time.monotonic()
        if sentence != self._logged or now_s - self._logged_s > AGAIN_S:
            self._logged, self._logged_s = sentence, now_s
            self._log(sentence)

    def accepted(self) -> None:
        """Forget the last refusal, since a later message was accepted."""
        self.last = self._logged = ""

    def report(self) -> Report:
        """Return the report for /diagnostics: a warning until a message is accepted."""
        return Report(self._name, DiagnosticLevel.WARN if self.last else DiagnosticLevel.OK, self.last)
