"""Step guidance as a page and the nodes tell it; a command that only asks imports no planner for it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class GuideView:
    """Step guidance as a page shows it.

    `kind` of movement, `sentence` about it, `said`: the sentence spoken last, `count`: how many have been spoken. `bearing`
    [rad] of the way ahead from the chair's heading, left positive; `left` [m] of the movement. `level` of prompting.
    `offers`: the chair may be asked to drive.
    """

    goal: str
    kind: str = ""
    sentence: str = ""
    said: str = ""
    count: int = 0
    bearing: float = 0.0
    left: float = 0.0
    level: int = 0
    arrived: bool = False
    offers: bool = False
