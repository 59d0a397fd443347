"""Walks of a guided chair along points, for tests."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from tests.maps.building.buildings import two_storeys
from waychair.control.guidance.guidance import Guidance, GuidanceView, Guiding, begun, step
from waychair.geometry import wrap_angle
from waychair.maps.building.hgraph import HGraph
from waychair.maps.building.hgraph_edits import with_lift
from waychair.planning.building.guided_ways import GuidedWays
from waychair.types import Pose2

TICK_NS = 50_000_000


def with_cabins() -> HGraph:
    """Return the building of two storeys, with a cabin of its lift left of the lobby."""
    hgraph = two_storeys()
    lift = hgraph.lifts["A"]
    stops = tuple(replace(stop, cabin=Pose2(1.0, 0.0, 0.0)) for stop in lift.stops)
    return with_lift(hgraph, replace(lift, stops=stops, cabin_width=1.8, cabin_depth=1.8, door_width=1.0))


@dataclass
class Walk:
    """A guided chair: its pose, storey and time, and everything that it was told."""

    ways: GuidedWays
    state: Guidance
    pose: Pose2
    storey: str = "g"
    now_ns: int = 0

    def look(self, *, at_rest: bool = False, localised: bool = True, lift_open: bool | None = None) -> Guiding:
        """Let a tick pass."""
        self.now_ns += TICK_NS
        pose = self.pose if localised else None
        view = GuidanceView(self.now_ns, self.storey, pose, at_rest=at_rest, lift_open=lift_open)
        self.state, guiding = step(self.state, view, self.ways)
        return guiding

    def rest(self, seconds: float) -> list[Guiding]:
        """Rest for a while."""
        return [self.look(at_rest=True) for _ in range(round(seconds / 0.05))]

    def turn(self, theta: float) -> list[Guiding]:
        """Turn on the spot at 1 rad/s."""
        told = []
        while abs(wrap_angle(theta - self.pose.theta)) > 0.03:
            change = math.copysign(0.05, wrap_angle(theta - self.pose.theta))
            self.pose = replace(self.pose, theta=wrap_angle(self.pose.theta + change))
            told.append(self.look())
        return told

    def drive(self, *points: tuple[float, float], speed: float = 0.8) -> list[Guiding]:
        """Drive straight to each point, turning on the spot between."""
        told: list[Guiding] = []
        for x, y in points:
            theta = math.atan2(y - self.pose.y, x - self.pose.x)
            told += self.turn(theta)
            while math.hypot(x - self.pose.x, y - self.pose.y) > speed * 0.05:
                step_m = speed * 0.05
                here = self.pose
                self.pose = Pose2(here.x + step_m * math.cos(theta), here.y + step_m * math.sin(theta), theta)
                told.append(self.look())
        return told


def walk(goal: str, at: Pose2, level: int = 2, **known: object) -> Walk:
    """Return a walk to a goal from a pose on the ground floor."""
    ways = GuidedWays(with_cabins())
    return Walk(ways, begun(ways.node(goal), level, **known), at)  # type: ignore[arg-type]


def kinds(told: Sequence[Guiding]) -> list[str]:
    """Return the kinds of movement in the order in which they were shown."""
    found: list[str] = []
    for each in told:
        if each.movement is not None and (not found or found[-1] != each.movement.kind):
            found.append(str(each.movement.kind))
    return found


def spoken(told: Sequence[Guiding]) -> list[str]:
    """Return what was spoken of, with its cue."""
    return [f"{each.cue} {each.movement.kind}" for each in told if each.cue is not None and each.movement is not None]
