"""Settings of the navigator and of its parts."""

from __future__ import annotations

from dataclasses import dataclass, field

from waychair.config import Settings, setting
from waychair.control.corrections import CorrectionSettings
from waychair.control.leg_drive import LegDriveSettings
from waychair.control.recovery import RecoverySettings
from waychair.control.surroundings import SurroundingsSettings
from waychair.planning.clearance import ClearanceSettings
from waychair.planning.global_planner import PlannerSettings
from waychair.planning.motion import DwaSettings
from waychair.planning.personal_space import PersonalSpaceSettings
from waychair.planning.tracks import TrackSettings


@dataclass(frozen=True, slots=True)
class NavigatorSettings(Settings):
    """Settings of the navigator: replanning, and the settings of its parts."""

    obstacle_range: float = setting(
        6.0, "m", "beams beyond this are no obstacles to care about yet", low=1.0, high=50.0
    )
    look_ahead: float = setting(5.0, "m", "part of the path that must be free", low=0.5, high=50.0)
    off_path: float = setting(0.5, "m", "farther from the path than this: plan anew", low=0.1, high=5.0)
    corner_tolerance: float = setting(0.05, "m", "how exactly it stops to turn before a door", low=0.01, high=0.5)
    replan_period: float = setting(1.0, "s", "shortest time between two plans", low=0.05, high=60.0)
    longest_plan: float = setting(
        2.0, "s", "a plan that takes longer is begun again if much has moved since", low=0.1, high=60.0
    )
    veil: float = setting(
        0.1,
        "m",
        "a point this far from those of both neighbouring beams hangs between two surfaces",
        low=0.01,
        high=1.0,
    )
    longest_field: float = setting(
        60.0, "s", "a potential that takes longer is given up, and the path there is is kept", low=0.1, high=600.0
    )
    loyalty: float = setting(
        1.5,
        "s",
        "sooner by this much another way has to lead there, among people, than the one begun",
        low=0.0,
        high=60.0,
    )
    waits_from: float = setting(2.0, "m", "from so near the chair waits until its goal is free", low=0.1, high=50.0)
    corrections: CorrectionSettings = field(default_factory=CorrectionSettings)
    tracks: TrackSettings = field(default_factory=TrackSettings)
    personal_space: PersonalSpaceSettings = field(default_factory=PersonalSpaceSettings)
    surroundings: SurroundingsSettings = field(default_factory=SurroundingsSettings)
    recovery: RecoverySettings = field(default_factory=RecoverySettings)
    clearance: ClearanceSettings = field(default_factory=ClearanceSettings)
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    dwa: DwaSettings = field(default_factory=DwaSettings)
    legs: LegDriveSettings = field(default_factory=LegDriveSettings)
