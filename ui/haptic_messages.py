"""The message to pages about a rider led by touch and voice: the symbols said and felt, the steps, the glove."""

from __future__ import annotations

import msgspec

from waychair.firmware_bridge.glove.bridge import GloveReport
from waychair.firmware_bridge.glove.layouts import layout_named
from waychair.runtime.haptics.haptic_state import HapticState
from waychair.types import Json


def haptics_message(state: HapticState | None) -> str:
    """Return the state as JSON text, without its stamp, so that a rider at rest sends nothing new."""
    if state is None:
        return NO_HAPTICS
    glove = None if state.glove is None else _glove(state.glove)
    values = {
        "type": "haptics",
        "there": True,
        "level": state.level.value,
        "goal": state.goal,
        "step": state.step,
        "reason": state.reason,
        "arrived": state.arrived,
        "symbol": state.symbol,
        "text": state.text,
        "count": state.count,
        "play": state.play,
        "unfelt": state.unfelt,
        "speaks": state.speaks,
        "withheld": state.withheld,
        "offers": state.offers,
        "glove": glove,
        "notices": state.notices,
    }
    return msgspec.json.encode(values).decode()


def _glove(glove: GloveReport) -> Json:
    """Return the glove; `at` are the motors' places: the side to the left and ahead, in mm on the skin."""
    tactors = layout_named(glove.layout).tactors if glove.layout else ()
    return {
        "alive": glove.alive,
        "problem": glove.problem,
        "on": glove.on,
        "broken": glove.broken,
        "worn": glove.worn,
        "layout": glove.layout,
        "at": [[tactor.y_mm, tactor.x_mm, tactor.site] for tactor in tactors],
    }


NO_HAPTICS = msgspec.json.encode({"type": "haptics", "there": False}).decode()
"""The message of a chair that has neither glove nor voice."""
