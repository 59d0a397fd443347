"""The level of help over the wire and back, without ROS."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.errors import MessageError
from waychair.ros.messages import wire
from waychair.ros.messages.guard import guard_message, read_guard
from waychair.runtime.rider.guard_view import GuardView
from waychair.types import HelpLevel

CAP, STICK = st.floats(0.0, 1.0), st.floats(-1.0, 1.0)
LEVEL = st.sampled_from(HelpLevel)


def over_the_wire(message: Any) -> Any:
    return wire.deserialised(wire.serialised(message), message.__msgtype__)


@given(
    LEVEL,
    LEVEL,
    st.none() | st.tuples(CAP, CAP, CAP, CAP),
    st.lists(st.booleans(), min_size=5, max_size=5),
    st.tuples(STICK, STICK),
    st.tuples(CAP, CAP, CAP, CAP),
)
def test_a_level_and_its_caps_arrive_unchanged(
    level: HelpLevel,
    offered: HelpLevel,
    caps: tuple[float, float, float, float] | None,
    flags: list[bool],
    stick: tuple[float, float],
    own_caps: tuple[float, float, float, float],
) -> None:
    sent = GuardView(level, "Let go.", offered, caps, *flags, stick=stick, own_caps=own_caps)
    assert read_guard(over_the_wire(guard_message(7, sent))) == sent


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("level", "push", "'push'.*inform, guard, guide"),
        ("caps", [0.1, 0.1, float("nan"), 0.1], "cap"),
        ("caps", [0.1, 1.1, 0, 0], "1.1"),
        ("own_caps", [0.1, 1.1, 0, 0], "1.1"),
    ],
)
def test_wrong_levels_and_caps_are_named(field: str, value: object, says: str) -> None:
    message = over_the_wire(guard_message(0, GuardView()))
    setattr(message, field, value)
    with pytest.raises(MessageError, match=says):
        read_guard(message)
