"""The bytes between a simulated world and its chairs: sensors and the cable's bytes, poses, and what chairs say of themselves.

Nothing in them is code: a message that is damaged, or of another kind, is refused as a whole.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeVar

import msgspec
import numpy as np
from msgspec import Struct

from waychair.types import ImuSample, PressureSample, RgbdFrame, Scan, SensorMessage, SonarReadings, WheelTicks

_KINDS: tuple[type[SensorMessage], ...] = (WheelTicks, Scan, ImuSample, RgbdFrame, SonarReadings, PressureSample)
_NUMBER = {kind: k for k, kind in enumerate(_KINDS)}

Body = TypeVar("Body", bound=Struct)


class WorldStep(Struct, frozen=True, array_like=True):
    """A step of the world for one chair: the world's start and step number, its time, sensor messages, the board's bytes."""

    boot: int
    step: int
    now_ns: int
    sensors: list[tuple[int, list[Any]]]
    cable: bytes


class ChairStep(Struct, frozen=True, array_like=True):
    """A chair's answer to all steps up to one, with its bytes to the board."""

    boot: int
    step: int
    cable: bytes


class WorldMoment(Struct, frozen=True, array_like=True):
    """The truth ten times a second.

    Attributes:
        boot: number of the world's start.
        now_ns: its time.
        factor: simulated seconds for each real one since its start.
        poses: x, y [m], heading [rad] of each chair.
        moving: whether each chair moves.
        person_m: distance [m] of each chair from the nearest person; -1 without any.
        people: x, y [m].
        nearest: distance [m] between the two nearest chairs; -1 for one chair.
        contacts: of chairs with chairs, with people, and with things, since this start.
    """

    boot: int
    now_ns: int
    factor: float
    poses: list[tuple[float, float, float]]
    moving: list[bool]
    person_m: list[float]
    people: list[tuple[float, float]]
    nearest: float
    contacts: tuple[int, int, int]


class ChairWord(Struct, frozen=True, array_like=True):
    """The state that a chair's process sends ten times a second.

    Attributes:
        boot: a random number of this start.
        goal: the present goal; empty: none.
        reached: goals reached.
        took_s: how long each one took.
        ends: why drives ended early.
        again: how often its rider asked again.
        line: the ends x, y [m] of its stop line; None without.
        held: it stands for another chair.
        told: what its rider is told.
        waits: other chair (-1: none), place, rule and foreseen ms (-1: unknown) of its wait; None if it waits for nobody.
        warden: the chair that it follows; 0: none.
        by_eye: whether it drives by its own eyes alone, and how often it has backed out for another one so.
        answers_ms: times from its requests to their first answers since the last word.
        ages_ms: ages of the others' last States at its steps since the last word.
        notices: sentences for people.
    """

    boot: int
    goal: str = ""
    reached: int = 0
    took_s: list[float] = []
    ends: list[str] = []
    again: int = 0
    line: tuple[tuple[float, float], tuple[float, float]] | None = None
    held: bool = False
    told: str = ""
    waits: tuple[int, str, str, int] | None = None
    warden: int = 0
    by_eye: tuple[bool, int] = (False, 0)
    answers_ms: list[float] = []
    ages_ms: list[float] = []
    notices: list[str] = []


def _plain(value: Any) -> Any:
    """Return a number of numpy's as Python's."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} cannot be sent")


_encoder = msgspec.msgpack.Encoder(enc_hook=_plain)


def encoded(body: Struct) -> bytes:
    """Return a message as bytes."""
    return _encoder.encode(body)


def decoded(kind: type[Body], data: bytes) -> Body | None:
    """Return the message of a kind; None for bytes that are none."""
    try:
        return msgspec.msgpack.decode(data, type=kind)
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError):
        return None


def packed_sensor(message: SensorMessage) -> tuple[int, list[Any]]:
    """Return the number of a sensor message's kind and its fields, arrays as dtype, shape and bytes."""
    values = [getattr(message, each.name) for each in fields(message)]
    return _NUMBER[type(message)], [_packed(value) for value in values]


def sensor_from(kind: int, values: list[Any], later_ns: int = 0) -> SensorMessage:
    """Return a sensor message from its packed form, its stamp that much later.

    Raises:
        ValueError: it is none.
    """
    try:
        found: list[Any] = [_unpacked(value) for value in values]
        found[0] += later_ns  # the stamp is the first field of all kinds
        return _KINDS[kind](*found)
    except (IndexError, TypeError, KeyError) as error:
        raise ValueError(f"no sensor message of kind {kind}: {error}") from None


def _packed(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return {"t": value.dtype.str, "s": list(value.shape), "b": value.tobytes()}
    return value


def _unpacked(value: Any) -> Any:
    if isinstance(value, dict):
        return np.frombuffer(value["b"], np.dtype(value["t"])).reshape(value["s"])
    return value
