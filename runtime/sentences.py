"""Plain sentences for the rider about the path ahead."""

from __future__ import annotations

import math

import numpy as np

from waychair.geometry import wrap_angle
from waychair.types import FloatArray, Pose2

PAUSED, NOTHING_TO_PAUSE = "paused: the goal is kept", "there is no drive to pause"
GOES_ON, NOTHING_PAUSED = "the drive goes on", "no drive is paused: ask for a goal"

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


def _metres(length: float) -> str:
    if length < 0.95:
        return "less than 1 m"
    return f"{length:.0f} m"
