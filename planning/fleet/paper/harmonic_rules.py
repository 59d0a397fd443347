"""The paper's three harmonic rules: who stands for whom.

Rule A1, humans first: the chair stands and waits until a person or a chair of higher priority has passed. Rule B1, chairs
first: the chair never stands for people; among chairs the node decides. Rule C1, flexible: a top-level chair warns by light
and goes before people, and people go before routine chairs. Rule B is for simulations only: no real chair drives by it.
"""

from __future__ import annotations

import enum

from waychair.errors import TrafficError
from waychair.maps.traffic.traffic_graph import Section


class HarmonicRule(enum.Enum):
    """Rules A, B and C by the names of the command line."""

    HUMANS = "humans"
    CHAIRS = "chairs"
    FLEXIBLE = "flexible"


class RulePriority(enum.IntEnum):
    """The three levels of priority of rule C."""

    ROUTINE = 0
    PEOPLE = 1
    TOP = 2


def chair_stands_for_people(rule: HarmonicRule, level: RulePriority) -> bool:
    """Return whether a chair stands for a person in its way."""
    if rule is HarmonicRule.FLEXIBLE:
        return level < RulePriority.PEOPLE
    return rule is HarmonicRule.HUMANS


def chair_stands_for_chair(own: RulePriority, other: RulePriority) -> bool | None:
    """Return whether a chair stands for another one in conflict, by any rule; None where the node throws the dice."""
    return None if own == other else own < other


def check_rule_for_driving(rule: HarmonicRule) -> None:
    """Refuse rule B outside the simulator.

    Raises:
        TrafficError: the rule lets chairs drive on before people.
    """
    if rule is HarmonicRule.CHAIRS:
        raise TrafficError("rule chairs lets a chair drive on towards people and is for simulations only; give humans")


def right_hand_offset(section: Section) -> float:
    """Return how far [m] right of the middle a chair drives: a quarter of the width where two lanes are, else 0."""
    return section.width / 4.0 if section.lanes > 1 else 0.0
