"""Diagnostic reports of the nodes' parts, as diagnostic_msgs: a level, a sentence for people, and values."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from waychair.errors import MessageError
from waychair.recordings.bags.ros_messages import header, make
from waychair.ros.messages.wire import stamp_of


class DiagnosticLevel(enum.IntEnum):
    """The level of a diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class Report:
    """The state of one part: `name` as 'node: part', a level, one sentence for people, and values by key."""

    name: str
    level: DiagnosticLevel = DiagnosticLevel.OK
    message: str = ""
    values: tuple[tuple[str, str], ...] = ()


def diagnostics(stamp_ns: int, reports: Sequence[Report], hardware_id: str = "") -> Any:
    """Return a diagnostic_msgs/DiagnosticArray."""
    status = [
        make(
            "diagnostic_msgs/msg/DiagnosticStatus",
            int(report.level),
            report.name,
            report.message,
            hardware_id,
            [make("diagnostic_msgs/msg/KeyValue", key, value) for key, value in report.values],
        )
        for report in reports
    ]
    return make("diagnostic_msgs/msg/DiagnosticArray", header(stamp_ns, ""), status)


def read_diagnostics(message: Any) -> tuple[Report, ...]:
    """Return all reports of a diagnostic_msgs/DiagnosticArray.

    Raises:
        MessageError: an unknown level, or an impossible stamp.
    """
    stamp_of(message)
    reports = []
    for status in message.status:
        level = status.level[0] if isinstance(status.level, bytes) else status.level  # rclpy's `byte`
        if level not in DiagnosticLevel.__members__.values():
            raise MessageError(f"'{status.name}' reports the unknown level {level}: send 0 to 3")
        values = tuple((value.key, value.value) for value in status.values)
        reports.append(Report(status.name, DiagnosticLevel(level), status.message, values))
    return tuple(reports)
