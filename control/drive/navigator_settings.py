"""Settings of the navigator and of its parts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from waychair.config import Settings, given, setting
from waychair.control.drive.local_obstacles import SurroundingsSettings
from waychair.control.drive.recovery import RecoverySettings
from waychair.planning.body.clearance import ClearanceSettings
from waychair.planning.body.personal_space import PersonalSpaceSettings
from waychair.planning.route.global_planner import PlannerSettings
from waychair.planning.seen.person_tracks import TrackSettings
from waychair.planning.window.motion_limits import DwaSettings


@dataclass(frozen=True, slots=True)
class NavigatorSettings(Settings):
    """Settings of the navigator and of its parts.

    `goal_wait_distance` [m]: the chair drives so near to an occupied goal before it waits for it.
    """

    obstacle_range: float = setting(
        6.0,
        "m",
        "range up to which lidar points are obstacles; larger: the chair plans round them earlier",
        low=1.0,
        high=50.0,
    )
    goal_wait_distance: float = given(2.0)
    tracks: TrackSettings = field(default_factory=TrackSettings)
    personal_space: PersonalSpaceSettings = field(default_factory=PersonalSpaceSettings)
    surroundings: SurroundingsSettings = field(default_factory=SurroundingsSettings)
    recovery: RecoverySettings = field(default_factory=RecoverySettings)
    clearance: ClearanceSettings = field(default_factory=ClearanceSettings)
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    dwa: DwaSettings = field(default_factory=DwaSettings)
    window: Literal["own", "paper"] = setting(
        "own",
        "",
        "drive: own, along lines where there is no room; paper, for comparison: ahead by the source paper's window",
    )
