"""The level of help and the board's guard as waychair_msgs/Guard."""

from __future__ import annotations

from typing import Any

import numpy as np

from waychair.errors import MessageError
from waychair.recordings.bags.ros_messages import BASE_FRAME, header, make
from waychair.ros.messages.wire import require_finite, stamp_of
from waychair.runtime.rider.guard_view import GuardView
from waychair.types import HelpLevel


def guard_message(stamp_ns: int, guard: GuardView) -> Any:
    """Return a waychair_msgs/Guard."""
    return make(
        "waychair_msgs/msg/Guard",
        header=header(stamp_ns, BASE_FRAME),
        level=guard.level.value,
        offered=guard.offered.value,
        sentence=guard.told,
        guards=guard.caps is not None,
        caps=np.array(guard.caps or (1.0,) * 4, np.float64),
        own_caps=np.array(guard.own_caps, np.float64),
        capped=guard.capped,
        warns=guard.warns,
        overridden=guard.overridden,
        creeps=guard.creeps,
        lost=guard.lost,
        stick=np.array(guard.stick, np.float64),
    )


def read_guard(message: Any) -> GuardView:
    """Return the content of a waychair_msgs/Guard.

    Raises:
        MessageError: an unknown level, a cap that is no number or beyond [0, 1], or an impossible stamp.
    """
    stamp_of(message)
    caps, own_caps = _caps(message.caps), _caps(message.own_caps)
    return GuardView(
        level=level_of(message.level),
        told=str(message.sentence),
        offered=level_of(message.offered),
        caps=caps if message.guards else None,
        capped=bool(message.capped),
        warns=bool(message.warns),
        overridden=bool(message.overridden),
        lost=bool(message.lost),
        creeps=bool(message.creeps),
        stick=(float(message.stick[0]), float(message.stick[1])),
        own_caps=own_caps,
    )


def _caps(told: Any) -> tuple[float, float, float, float]:
    front, rear, left, right = (float(cap) for cap in told)
    require_finite("a cap", front, rear, left, right)
    if not all(0.0 <= cap <= 1.0 for cap in (front, rear, left, right)):
        raise MessageError(f"the caps {front:g}, {rear:g}, {left:g}, {right:g} are not all within 0 and 1")
    return front, rear, left, right


def level_of(name: str) -> HelpLevel:
    """Return a level of help by its name.

    Raises:
        MessageError: there is no such level.
    """
    try:
        return HelpLevel(name)
    except ValueError as error:
        known = ", ".join(level.value for level in HelpLevel)
        raise MessageError(f"there is no level of help '{name[:40]}': choose {known}") from error
