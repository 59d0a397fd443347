"""The settings of the drive base."""

from __future__ import annotations

from dataclasses import dataclass, field

from waychair.config import Settings
from waychair.control.drive.steering import SteeringSettings
from waychair.control.safety.arc_clearance import MonitorSettings
from waychair.control.safety.fitness import FitnessSettings
from waychair.control.safety.sight_speed import UnseenSettings
from waychair.control.safety.supervisor import SupervisorSettings
from waychair.control.speed.limiter import LimiterSettings
from waychair.control.speed.speed_loop import SpeedLoopSettings
from waychair.firmware_bridge.bridge import BridgeSettings


@dataclass(frozen=True, slots=True)
class BaseSettings(Settings):
    """The settings of the drive base's parts."""

    speed_loop: SpeedLoopSettings = field(default_factory=SpeedLoopSettings)
    supervisor: SupervisorSettings = field(default_factory=SupervisorSettings)
    fitness: FitnessSettings = field(default_factory=FitnessSettings)
    limiter: LimiterSettings = field(default_factory=LimiterSettings)
    monitor: MonitorSettings = field(default_factory=MonitorSettings)
    unseen: UnseenSettings = field(default_factory=UnseenSettings)
    bridge: BridgeSettings = field(default_factory=BridgeSettings)
    steering: SteeringSettings = field(default_factory=SteeringSettings)
