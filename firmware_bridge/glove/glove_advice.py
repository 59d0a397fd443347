"""Turns the glove's refusals, cuts and defects into sentences for the rider: the cause and the remedy."""

from __future__ import annotations

from collections.abc import Sequence

from waychair.firmware_bridge.glove.fitting import Fitting
from waychair.firmware_bridge.glove.layouts import TactorLayout, layout_numbered
from waychair.firmware_bridge.glove.messages import (
    GLOVE_FIRMWARE_VERSION,
    GLOVE_PROTOCOL_VERSION,
    GloveHello,
    GloveRefusal,
    GloveReply,
    GloveStatus,
    Hand,
    PlayCut,
    PlayRefusal,
)

PLAY_REFUSALS = {
    PlayRefusal.STEPS: "the pattern breaks a limit of the glove: run `waychair haptics check`",
    PlayRefusal.FAULTY: "a motor that the pattern needs is broken: have the glove's wiring checked",
    PlayRefusal.NOT_WORN: "the glove is not worn: put it on",
    PlayRefusal.HOT: "the glove is too warm: it plays again when it has cooled down",
    PlayRefusal.DUTY: "the glove's motors have vibrated for half of the last 10 s: it plays again in a few seconds",
    PlayRefusal.LOWER: "something more important is being played",
}
"""A sentence for each reason for which a pattern is not played."""

PLAY_CUTS = {
    PlayCut.DUTY: PLAY_REFUSALS[PlayRefusal.DUTY],
    PlayCut.CROWD: "too many motors vibrated at once for too long: the pattern was stopped",
    PlayCut.RUN: "a motor vibrated for half a second without a rest: the pattern was stopped",
    PlayCut.FAULTY: PLAY_REFUSALS[PlayRefusal.FAULTY],
    PlayCut.NOT_WORN: PLAY_REFUSALS[PlayRefusal.NOT_WORN],
    PlayCut.HOT: PLAY_REFUSALS[PlayRefusal.HOT],
    PlayCut.CLOCK: "the glove's clock has jumped: the pattern was stopped",
}
"""A sentence for each reason for which a pattern was stopped in its middle."""


def refusal_sentences(refused: int) -> tuple[str, ...]:
    """Return a sentence for each `PlayRefusal` that is set."""
    return tuple(text for bit, text in PLAY_REFUSALS.items() if refused & bit)


def cut_sentences(cut: int) -> tuple[str, ...]:
    """Return a sentence for each `PlayCut` that is set."""
    return tuple(text for bit, text in PLAY_CUTS.items() if cut & bit)


def reply_problem(reply: GloveReply, ours: GloveHello, layout: TactorLayout, fitting: Fitting) -> str:
    """Return why a glove with this reply cannot be used, with a remedy; empty if it can."""
    name = _name(reply.device_id)
    if reply.refused & GloveRefusal.VERSION or reply.version != GLOVE_PROTOCOL_VERSION:
        return f"the glove speaks version {reply.version} of the protocol, this computer {GLOVE_PROTOCOL_VERSION}: flash it anew"
    if reply.refused & GloveRefusal.TABLE or reply.layout_hash != ours.layout_hash:
        return "the glove's firmware has another message table: flash the firmware that belongs to this waychair"
    if reply.firmware_version >> 8 != GLOVE_FIRMWARE_VERSION >> 8:
        return (
            f"the glove has firmware {reply.firmware_version >> 8}.{reply.firmware_version & 0xFF}, this waychair was tested "
            f"with {GLOVE_FIRMWARE_VERSION >> 8}.x: flash it anew"
        )
    if reply.refused & GloveRefusal.DEVICE or reply.device_id != ours.device_id:
        return f"this is the glove '{name}', but the rider's is '{_name(ours.device_id)}': plug in that one, or choose this one"
    if reply.refused & GloveRefusal.LAYOUT or reply.layout != layout.number or reply.motors != len(layout.tactors):
        found = layout_numbered(reply.layout)
        what = f"the layout '{found.name}'" if found else f"an unknown layout {reply.layout}"
        return f"the glove has {what} with {reply.motors} motors, the rider's patterns are for '{layout.name}': choose its layout"
    if reply.refused:
        return f"the glove refuses this computer for an unknown reason ({reply.refused}): flash it anew"
    if reply.hand not in (Hand.NONE, fitting.hand):
        made, wanted = (
            Hand(hand).name.lower() if hand <= max(Hand) else "unknown" for hand in (reply.hand, fitting.hand)
        )
        return f"the glove is made for the {made} hand, but the rider's fitting is for the {wanted} one: wear and fit that hand"
    return ""


def status_problem(status: GloveStatus) -> str:
    """Return why a glove with this report can play nothing, with a remedy; empty if it can."""
    if not status.worn:
        return PLAY_REFUSALS[PlayRefusal.NOT_WORN]
    return ""


def motor_notices(status: GloveStatus, outputs: Sequence[int]) -> tuple[str, ...]:
    """Return a sentence for the open and for the shorted motors, by their places in the layout."""
    told = []
    for mask, what in (
        (status.open_motors, "does not vibrate: its wire is open"),
        (status.shorted_motors, "is shorted"),
    ):
        places = [str(place) for place, output in enumerate(outputs) if mask >> output & 1]
        if places:
            told.append(
                f"motor {', '.join(places)} of the glove {what}; symbols that need it are not played: have it mended"
            )
    return tuple(told)


def _name(device_id: bytes) -> str:
    return device_id.rstrip(b"\0").decode(errors="replace")
