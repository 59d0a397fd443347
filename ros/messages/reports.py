"""Diagnostic reports of the nodes' parts, as diagnostic_msgs: a level, a sentence for people, and values."""

from __future__ import annotations

import enum
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import msgspec

from waychair.errors import MessageError
from waychair.ros.messages.wire import stamp_of
from waychair.ros_messages import header, make

T = TypeVar("T")


class Level(enum.IntEnum):
    """The level of a diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class Report:
    """The state of one part: `name` as 'node: part', a level, one sentence for people, and values by key."""

    name: str
    level: Level = Level.OK
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
        if level not in Level.__members__.values():
            raise MessageError(f"'{status.name}' reports level {level}, which there is not: send 0 to 3")
        values = tuple((value.key, value.value) for value in status.values)
        reports.append(Report(status.name, Level(level), status.message, values))
    return tuple(reports)


def report_of(noun: Any, name: str, level: Level = Level.OK, message: str = "") -> Report:
    """A report whose values are a noun's fields (of Telemetry, ChairStatus, Health, Sent), nested ones as `a.b`."""
    return Report(name, level, message, tuple(_leaves(msgspec.to_builtins(noun), "")))


def noun_of(report: Report, kind: type[T]) -> T:
    """The noun that `report_of` wrote.

    Raises:
        MessageError: the values are not those of such a noun.
    """
    fields: dict[str, Any] = {}
    for key, text in report.values:
        *above, last = key.split(".")
        place = fields
        for part in above:
            place = place.setdefault(part, {})
        place[last] = _value(text)
    try:
        return msgspec.convert(fields, kind)
    except (msgspec.ValidationError, AttributeError, TypeError) as error:
        raise MessageError(f"'{report.name}' holds no {kind.__name__}: {error}; restart its sender") from error


def _leaves(value: Any, key: str) -> list[tuple[str, str]]:
    if not isinstance(value, Mapping):
        return [(key, _text(value))]
    return [leaf for part, inner in value.items() for leaf in _leaves(inner, f"{key}.{part}" if key else part)]


def _text(value: Any) -> str:
    """JSON, but words without quotes, as people want to read them."""
    if isinstance(value, str) and _value(value) == value:
        return value
    return json.dumps(value)


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text
