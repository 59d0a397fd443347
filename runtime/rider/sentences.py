"""Plain sentences for the rider about the path ahead."""

from __future__ import annotations

import math

import numpy as np

from waychair.control.guidance.guidance import GuidanceTrouble, Guiding
from waychair.control.guidance.telling import Cue
from waychair.geometry import wrap_angle
from waychair.planning.movements import Movement, MovementKind
from waychair.types import FloatArray, Pose2

PAUSED, NOTHING_TO_PAUSE = "paused: the goal is kept", "there is no drive to pause"
GOES_ON, NOTHING_PAUSED = "the drive goes on", "no drive is paused: ask for a goal"
GUIDED, GUIDED_THERE = (
    "The joystick is yours: you drive, and are told the way.",
    "The joystick is yours: you are there.",
)

_TURN = math.radians(40.0)
_WITHIN = 1.0
"""A change of heading by more than _TURN within _WITHIN [m] of path is a turn."""

_MENTIONED_M = 8.0
"""Turns farther ahead [m] are not mentioned yet."""

_NOW_M = 0.6
"""A turn nearer than this [m] is happening now."""


def sentence(text: str) -> str:
    """Return a clause with a capital letter and a full stop."""
    text = text.strip()
    return "" if not text else text[0].upper() + text[1:] + ("" if text[-1] in ".!?" else ".")


def path_ahead(way: FloatArray, pose: Pose2) -> FloatArray:
    """Return the rest of a path (N, 2) [m], from its point nearest to a pose."""
    if len(way) < 2:
        return way
    return way[int(np.argmin(np.hypot(*(way - (pose.x, pose.y)).T))) :]


def path_length(way: FloatArray) -> float:
    """Return the length of a path (N, 2) [m]."""
    return float(np.hypot(*np.diff(way, axis=0).T).sum()) if len(way) > 1 else 0.0


def next_turn(way: FloatArray) -> tuple[float, str] | None:
    """Return the distance [m] to the next turn of a path (N, 2) [m], and its side; None where it is straight."""
    steps = np.diff(way, axis=0)
    lengths = np.hypot(*steps.T)
    steps, lengths = steps[lengths > 1e-6], lengths[lengths > 1e-6]
    headings, at = np.arctan2(steps[:, 1], steps[:, 0]), np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    for k in range(len(headings)):
        if at[k] > _MENTIONED_M:
            return None
        near = np.flatnonzero((at > at[k]) & (at <= at[k] + _WITHIN))
        turns = np.array([wrap_angle(headings[j] - headings[k]) for j in near])
        if len(turns) and np.abs(turns).max() > _TURN:
            return float(at[k]), "left" if turns[np.abs(turns).argmax()] > 0.0 else "right"
    return None


def driving_sentence(goal: str, way: FloatArray, pose: Pose2) -> str:
    """Return a sentence about the next turn and the distance left on the path (N, 2) [m] to a goal."""
    ahead = path_ahead(way, pose)
    left = path_length(ahead)
    if len(ahead) < 2:
        return f"Driving to {goal}."
    turn = next_turn(ahead)
    if turn is None:
        return f"Driving straight on, {_metres(left)} to {goal}."
    away, side = turn
    if away < _NOW_M:
        return f"Turning {side}, {_metres(left)} to {goal}."
    return f"Turning {side} in {_metres(away)}, {_metres(left)} to {goal}."


_UNKNOWN_PLACE = "the chair does not know where it is: drive on slowly, or choose its place on the map"


def guiding_sentence(guiding: Guiding) -> str:
    """Return a sentence about the present movement of step guidance, or about its trouble, for the page."""
    if guiding.trouble is not GuidanceTrouble.NONE:
        return sentence(_UNKNOWN_PLACE if guiding.trouble is GuidanceTrouble.NO_POSE else guiding.why)
    return "" if guiding.movement is None else movement_sentence(guiding.movement, guiding.left)


def spoken_sentence(guiding: Guiding) -> str:
    """Return the sentence to be spoken now, empty for silence; beforehand it is about the movement that follows."""
    if guiding.cue is None or guiding.movement is None:
        return ""
    if guiding.cue is Cue.SOON and guiding.following is not None:
        return sentence(f"soon {_words(guiding.following, 0.0)}")
    return movement_sentence(guiding.movement, guiding.left)


def movement_sentence(movement: Movement, left: float) -> str:
    """Return a sentence about a movement with so much of it left [m]."""
    return sentence(_words(movement, left))


def _words(movement: Movement, left: float) -> str:
    kind = movement.kind
    if kind is MovementKind.STRAIGHT:
        where = f", {movement.landmark}" if movement.landmark else ""
        return f"straight on, {_metres(left)}{where}" if left > 0.0 else f"straight on{where}"
    if kind is MovementKind.WAIT:
        return f"call {movement.lift}, you want to go to {movement.storey}; drive in once its door is open and rests"
    if kind is MovementKind.ARRIVED:
        return f"you are at {movement.landmark}" if movement.landmark else "you are there"
    return {
        MovementKind.BACK: f"back, {_metres(left)}",
        MovementKind.LEFT: "turn left",
        MovementKind.RIGHT: "turn right",
        MovementKind.TURN_ROUND: "turn round",
        MovementKind.DOOR: "through the door",
        MovementKind.INTO_LIFT: f"drive into {movement.lift}, if nothing moves in its door",
        MovementKind.PRESS: f"press {movement.storey}",
        MovementKind.LEAVE_LIFT: "leave the lift once its door is open and rests",
    }[kind]


def _metres(length: float) -> str:
    if length < 0.95:
        return "less than 1 m"
    return f"{length:.0f} m"
