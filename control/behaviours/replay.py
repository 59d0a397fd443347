"""The replay of a traced network: the same stamps and sensor values must give the same bytes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from waychair.control.behaviours.cell import Reading
from waychair.control.behaviours.cell_network import Wiring
from waychair.control.behaviours.runtime import Runtime
from waychair.control.behaviours.trace import (
    ENCODER,
    FRAME,
    Trace,
    TracedInnervation,
    TraceEncoder,
    trace_from_bytes,
    value_text,
)
from waychair.errors import TraceError


@dataclass(frozen=True, slots=True)
class PortDifference:
    """The first port in which two runs differ: which innervation, cell and port, and both values in words."""

    index: int
    stamp_ns: int
    node: str
    port: str
    first: str
    second: str

    def __str__(self) -> str:
        at = f"at innervation {self.index} ({self.stamp_ns / 1e9:.3f} s)"
        return f"{at} {self.port} of {self.node} differs: {self.first} in the trace, {self.second} in the replay"


@dataclass(frozen=True, slots=True)
class Replay:
    """The outcome of a replay: the bytes of its own trace, and the first difference; None if there is none."""

    data: bytes
    innervations: int
    difference: PortDifference | None = None


def replay(trace: Trace, wiring: Wiring, progress: Callable[[float], None] = lambda share: None) -> Replay:
    """Run a traced network again on the same stamps and sensor values, and compare every record.

    `progress` is called with the share (0 to 1) that is done.

    Raises:
        TraceError: the trace is of another wiring, a sensor's value is of another type, or records are missing.
    """
    header = trace.header
    if header.identity != wiring.identity():
        raise TraceError(f"the trace is of another wiring: {_first_change(header.wiring, tuple(wiring.lines()))}")
    if trace.gaps:
        raise TraceError(
            f"records are missing before innervation {trace.gaps[0]} of the trace, so a cell's memory is not known "
            "from there: take a whole trace"
        )
    if not trace.innervations:
        raise TraceError("the trace holds no innervation, so there is nothing to replay: take one of a drive")
    runtime, encoder = Runtime(wiring), TraceEncoder(wiring, header.preset, header.settings)
    written = [encoder.header()]
    for index, was in enumerate(trace.innervations):
        done = runtime.innervate(was.stamp_ns, typed_inputs(wiring, was), was.late)
        raw = {name: _raw(*each) for name, each in was.heard.items()}
        record = encoder.innervation(done, raw, key=was.payload[:1] == b"K")
        written.append(record)
        progress((index + 1) / len(trace.innervations))
        if record[FRAME.size :] != was.payload[1:]:
            again = trace_from_bytes(b"".join(written)).innervations[index]
            return Replay(b"".join(written), index + 1, first_difference(index, was, again))
    return Replay(b"".join(written), len(trace.innervations))


def typed_inputs(wiring: Wiring, was: TracedInnervation) -> dict[str, Any]:
    """Return the sensors' values of a traced innervation with their types.

    Raises:
        TraceError: a value is not what its sensor gives.
    """
    return {name: _sensed(wiring, name, *each) for name, each in was.heard.items()}


def _sensed(wiring: Wiring, name: str, value: Any, stamp_ns: int | None) -> Any:
    """Return a sensor's value with its type."""
    try:
        typed = msgspec.convert(value, wiring.sensors[name].kind, dec_hook=_restored, strict=False)
    except (msgspec.ValidationError, TypeError, ValueError) as error:
        raise TraceError(f"the trace's value of {name} is not what the sensor gives: {error}") from error
    return typed if stamp_ns is None else Reading(typed, stamp_ns)


def _raw(value: Any, stamp_ns: int | None) -> Any:
    return value if stamp_ns is None else Reading(value, stamp_ns)


def first_difference(index: int, was: TracedInnervation, now: TracedInnervation) -> PortDifference:
    """Return the first port, in the order of the nodes, that differs between two innervations."""

    def differs(node: str, port: str, first: Any, second: Any) -> PortDifference | None:
        if ENCODER.encode(first) == ENCODER.encode(second):
            return None
        return PortDifference(index, was.stamp_ns, node, port, value_text(first), value_text(second))

    for name, port in was.ports.items():
        other = now.ports[name]
        for label in ("innervated", "eb", "ib", "rs", "ab", "eo", "eo_stamp_ns", "fault"):
            shown = {"innervated": "IS", "eo_stamp_ns": "the stamp of EO", "fault": "the fault"}.get(
                label, label.upper()
            )
            found = differs(name, shown, getattr(port, label), getattr(other, label))
            if found is not None:
                return found
    for effector in sorted({*was.actions, *now.actions}):
        found = differs(effector, "AO", was.actions.get(effector), now.actions.get(effector))
        if found is not None:
            return found
    return PortDifference(index, was.stamp_ns, "the schedule", "the order", ", ".join(was.ran), ", ".join(now.ran))


def _first_change(was: tuple[str, ...], now: tuple[str, ...]) -> str:
    for first, second in zip((*was, "its end"), (*now, "its end"), strict=False):
        if first != second:
            return f"'{first.strip()}' there, '{second.strip()}' here; replay it with the version and settings it names"
    return "its lines are the same, and their hash is not; the trace was altered"


def _restored(_: type, value: Any) -> Any:
    dtype, shape, data = value
    return np.frombuffer(data, dtype).reshape(shape)
