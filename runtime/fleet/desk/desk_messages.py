"""Messages between chairs and the staff's desk, beside those of the peers: what a chair says, and the priority staff give it.

They travel over the same network below each sender's own name. A chair takes priorities from the fleet's voters only: the
staff's desk is one of them. Nothing in them lets a chair move.
"""

from __future__ import annotations

from typing import Annotated, TypeVar

import msgspec
from msgspec import Meta, Struct

TOLD, GIVEN = "told", "given"
"""Kinds of messages, as the transport names them."""

TOLD_NS, GIVEN_NS = 1_000_000_000, 1_000_000_000
"""A chair repeats its words so often, and a priority is repeated so often while it holds."""

GIVEN_LAPSES_NS = 5_000_000_000
"""A chair has its own priority again when it has not heard of the given one for so long: the desk is gone."""

_Text = Annotated[str, Meta(max_length=300)]
_Number = Annotated[int, Meta(ge=0, le=0xFFFF)]


class Told(Struct, frozen=True, array_like=True):
    """A chair's words: its goal and priority, its rider's sentence, and its wait.

    Attributes:
        goal: the refuge it wants to go to; empty: none.
        priority: see `rules.Priority`.
        told: the rider's sentence.
        waits: whether it waits for its turn.
        other: the chair for which it waits; None: for none.
        place: the place before which it waits.
        rule: why the other one goes first, see `waits.Reason`.
        foreseen_ms: how long; -1: unknown.
        waited_ms: for how long it has waited.
    """

    goal: _Text = ""
    priority: Annotated[int, Meta(ge=0, le=3)] = 0
    told: _Text = ""
    waits: bool = False
    other: _Number | None = None
    place: _Text = ""
    rule: _Text = ""
    foreseen_ms: Annotated[int, Meta(ge=-1, le=1 << 50)] = -1
    waited_ms: Annotated[int, Meta(ge=0, le=1 << 50)] = 0


class Given(Struct, frozen=True, array_like=True):
    """A priority that staff give a chair, see `rules.Priority`; it is repeated as long as it holds."""

    chair: _Number
    priority: Annotated[int, Meta(ge=0, le=3)]


Note = TypeVar("Note", Told, Given)

_encoder = msgspec.msgpack.Encoder()


def note_bytes(note: Told | Given) -> bytes:
    """Return a message as bytes."""
    return _encoder.encode(note)


def note_from(kind: type[Note], data: bytes) -> Note | None:
    """Return the message of a kind; None for bytes that are none."""
    try:
        return msgspec.msgpack.decode(data, type=kind)
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError):
        return None
