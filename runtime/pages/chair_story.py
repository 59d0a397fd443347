"""Sentences for the rider: the chair's next action, and the reasons why it does not drive."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from waychair.control.drive.navigator import Stage
from waychair.control.safety.stops import STOPS, Halt, Severity
from waychair.control.safety.supervisor import DRIVEN
from waychair.errors import ZoneError
from waychair.geometry import transform_points
from waychair.maps.drawn.zones import Rule, Zone, zone_contains
from waychair.runtime.pages.chair_port import Hindrance
from waychair.runtime.rider.sentences import driving_sentence, sentence
from waychair.slam.scan.scan_points import scan_points
from waychair.types import DriveMode, FloatArray, Pose2, Scan, Twist

_POINTS = 360
"""Greatest number of a scan's points on a display."""


@dataclass(frozen=True, slots=True)
class DriveFacts:
    """The facts of a drive that the sentences are made of.

    `way` is the planned path (N, 2) [m] in map; `reason` is the navigator's. `holds_lines`: the computer holds the
    joystick lines, also at rest.
    """

    mode: DriveMode
    steered: bool
    goal: str
    waits: bool
    countdown_s: float | None
    stage: Stage
    reason: str
    pose: Pose2 | None
    way: FloatArray
    obstacles: tuple[Hindrance, ...] = field(default=())
    holds_lines: bool = True


def next_action(facts: DriveFacts) -> str:
    """Return one or two sentences about the chair's next action."""
    if facts.steered:
        return _steered(facts)
    if facts.mode in DRIVEN and facts.goal:
        return _driving(facts)
    stands = "Stopped." if facts.mode is DriveMode.STOPPED else "The joystick is yours."
    if facts.obstacles:
        first = facts.obstacles[0]
        return f"{stands} {sentence(f'{first.sentence}: {first.remedy}')}"
    if facts.waits:
        return f"Waiting for your yes to drive to {facts.goal}."
    return f"{stands} Choose a place to drive to."


def _steered(facts: DriveFacts) -> str:
    if not facts.holds_lines:
        return "A page steers. The chair responds once it has stood for two seconds."
    pauses = [each for each in facts.obstacles if each.stop_id == "obstacle"]
    if pauses:
        return f"A page steers. {sentence(pauses[0].sentence)}"
    return "A page steers. The chair stops when its joystick is let go."


def _driving(facts: DriveFacts) -> str:
    if facts.countdown_s is not None:
        return f"About to drive to {facts.goal}."
    if facts.stage is Stage.PAUSED:
        return f"Paused on the way to {facts.goal}. Press Go on, or end the drive."
    pauses = next((each for each in facts.obstacles if each.stop_id == "obstacle"), None)
    if pauses is not None:
        return f"Waiting: {pauses.sentence}. The chair goes on by itself once the way is free."
    other = next((each for each in facts.obstacles if _is_pause(each.stop_id)), None)
    if other is not None:
        return f"Waiting: {other.sentence}. {sentence(other.remedy)}"
    if facts.stage is Stage.WAITING:
        why, _, how_long = facts.reason.partition("; waiting, ")
        within = f", and waits {how_long}" if how_long else ""
        return f"Waiting: {why.removesuffix('; waiting')}. The chair goes on by itself once there is a path{within}."
    if facts.stage in (Stage.DRIVING, Stage.OFFERING) and facts.reason:
        return sentence(facts.reason)
    if facts.pose is None or not len(facts.way):
        return f"Looking for a path to {facts.goal}."
    if not facts.holds_lines:  # the board has not armed
        begins = f"Then the drive to {facts.goal} goes on."
        return f"Waiting until the joystick has been at rest for two seconds: let go of it. {begins}"
    return driving_sentence(facts.goal, facts.way, facts.pose)


def _is_pause(stop_id: str) -> bool:
    return stop_id in STOPS and STOPS[stop_id].severity is Severity.PAUSES


def shown_points(scan: Scan, mount: Pose2, pose: Pose2, twist: Twist) -> FloatArray:
    """Return a scan's points in map, (N, 2) [m], thinned to the number that a display needs."""
    points = scan_points(scan, mount, math.inf, twist).points
    return transform_points(pose, points[:: max(1, len(points) // _POINTS)])


def check_zone(zone: Zone, pose: Pose2 | None, outline: FloatArray) -> None:
    """Refuse a keep-out zone that covers the chair.

    Raises:
        ZoneError: the zone does.
    """
    if zone.rule is not Rule.KEEP_OUT or pose is None:
        return
    if zone_contains(zone, transform_points(pose, np.vstack([outline, [[0.0, 0.0]]]))).any():
        raise ZoneError("the chair stands in this zone: drive it out first, or draw the zone beside it")


def obstacles_of(halts: Iterable[Halt]) -> tuple[Hindrance, ...]:
    """Return each halt's sentence with its remedy."""
    return tuple(obstacle_of(halted.stop.id, halted.text) for halted in halts)


def obstacle_of(stop_id: str, text: str) -> Hindrance:
    """Split a stop's text into sentence and remedy; a stop unknown to this version keeps its own words."""
    remedy = STOPS[stop_id].remedy if stop_id in STOPS else ""
    happened = text.removesuffix(remedy).rstrip(": ") if remedy else text
    if happened == text:  # the text is not the table's
        happened, _, remedy = text.rpartition("; ") if "; " in text else text.partition(": ")
    return Hindrance(stop_id, happened or f"the chair does not drive, for the reason '{stop_id}'", remedy)
