"""Messages: what comes in is what went out, and nothing else is understood."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from waychair.planning.fleet.peers import messages
from waychair.planning.fleet.peers.messages import Answer, Hello, Reader, State, Term, Wish, packed

BUILDING = "0123456789ab"
ANSWER = Answer(2, 7, 1, 3, 9, messages.GRANTED, 10, 3000, 4, (5, 6, 7), 5)
STATE = State(
    (1, 2), 8, (3,), 100, (50,), 1, 0, 4, Term(1, 99, 3), 12345, 2, 0, False, False, (5001, 2), Wish(1, "lift", 1, 500)
)


@pytest.mark.parametrize("body", [ANSWER, STATE, Hello(1000, 600), messages.Filter("a", "b", b"\0\1")])
def test_a_message_is_read_as_it_was_written(body: messages.Body) -> None:
    letter, said = Reader(BUILDING).read(packed(BUILDING, 3, 77, 5, 10**18, body))
    assert said == ""
    assert letter == messages.Letter(3, 77, 5, 10**18, body)


def test_a_state_is_small() -> None:
    full = msgspec.structs.replace(
        STATE, place=messages.Place("first floor", 12345, -6789, 314, 450, "corridor 12", 4000)
    )
    assert len(packed(BUILDING, 3, 2**62, 2**31, 10**18, full)) <= 300


def test_another_building_and_another_version_are_refused_once_with_advice(monkeypatch: pytest.MonkeyPatch) -> None:
    reader = Reader(BUILDING)
    foreign = packed("ffffffffffff", 4, 1, 1, 1, STATE)
    assert "another building" in reader.read(foreign)[1]
    assert reader.read(foreign) == (None, "")
    monkeypatch.setattr(messages, "LAYOUT", messages.LAYOUT ^ 1)
    old = packed(BUILDING, 5, 1, 1, 1, STATE)
    monkeypatch.undo()
    letter, said = reader.read(old)
    assert letter is None
    assert said == "Chair 5 runs another version of waychair: install the same version on all chairs."
    assert reader.refused == {"building": 2, "version": 1}


@pytest.mark.parametrize(
    "field",
    [
        {"visit": -1},
        {"entered": tuple(range(600))},
        {"mode": 3},
        {"wants": 513},
        {"entered": (-1,)},
        {"ready_ms": float("nan")},
        {"wish": Wish(1, "x" * 65)},
    ],
)
def test_values_beyond_their_bounds_are_refused(field: dict[str, object]) -> None:
    letter, said = Reader(BUILDING).read(packed(BUILDING, 3, 1, 1, 1, msgspec.structs.replace(STATE, **field)))
    assert letter is None
    assert "impossible values" in said


def test_a_state_of_a_megabyte_is_refused_unread() -> None:
    huge = packed(BUILDING, 3, 1, 1, 1, msgspec.structs.replace(STATE, entered=tuple(range(400_000))))
    assert len(huge) > 10**6
    letter, said = Reader(BUILDING).read(huge)
    assert letter is None
    assert "too large" in said


def _nothing_understood(total: int) -> None:
    rng = np.random.default_rng(5)
    reader = Reader(BUILDING)
    good = bytearray(packed(BUILDING, 3, 77, 5, 10**18, ANSWER))
    done = 0
    while done < total:
        size = int(rng.choice([1, 20, 200, 5000]))
        noise = rng.bytes(size * 100)
        for k in range(100):
            data = noise[k * size : (k + 1) * size]
            for each in (data, bytes(good[:8]) + data):
                letter, _ = reader.read(each)
                assert letter is None
        done += 2 * size * 100
    for deep in (b"\x91" * 60_000, b"\x81" * 60_000, bytes(good[:-1]), bytes(good) + b"\0"):
        assert reader.read(deep)[0] is None


def test_random_bytes_are_never_understood() -> None:
    _nothing_understood(5_000_000)


@pytest.mark.nightly
def test_a_hundred_million_random_bytes_are_never_understood() -> None:
    _nothing_understood(100_000_000)
