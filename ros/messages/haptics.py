"""Messages for a driver without sight: advice, and the state of glove and voice as a page shows it."""

from __future__ import annotations

from typing import Any

from waychair.control.haptics.symbols import Advice, Symbol
from waychair.errors import MessageError
from waychair.recordings.bags.ros_messages import BASE_FRAME, header, make
from waychair.ros.messages.json_text import json_text, read_json_text
from waychair.ros.messages.wire import require_finite
from waychair.runtime.haptics.haptic_state import HapticState

_SECOND_NS = 1_000_000_000


def advice(stamp_ns: int, said: Advice) -> Any:
    """Return a waychair_msgs/Advice; both times are of ROS's clock."""
    return make(
        "waychair_msgs/msg/Advice",
        header(stamp_ns, BASE_FRAME),
        said.symbol.value,
        said.number,
        make("builtin_interfaces/msg/Time", *divmod(said.valid_until_ns, _SECOND_NS)),
        said.direction or 0.0,
        said.reason,
    )


def read_advice(message: Any) -> Advice:
    """Return the advice of a waychair_msgs/Advice.

    Raises:
        MessageError: the symbol is unknown, or the direction of an obstacle is not finite.
    """
    known = {symbol.value: symbol for symbol in Symbol}
    if message.symbol not in known:
        raise MessageError(f"there is no symbol '{message.symbol}': send one of {', '.join(known)}")
    symbol, direction = known[message.symbol], float(message.direction)
    require_finite("the direction of an obstacle", direction)
    until_ns = int(message.valid_until.sec) * _SECOND_NS + int(message.valid_until.nanosec)
    at = direction if symbol is Symbol.OBSTACLE_AT else None
    return Advice(symbol, int(message.number), until_ns, at, str(message.reason))


def haptic_state(state: HapticState) -> Any:
    """Return a std_msgs/String of the state of glove and voice."""
    return json_text(state)


def read_haptic_state(message: Any) -> HapticState:
    """Return the state of a std_msgs/String as `haptic_state` makes it.

    Raises:
        MessageError: it is of another kind.
    """
    return read_json_text(message, HapticState, "a message about the glove")
