"""The settings of the simulator node."""

from __future__ import annotations

from dataclasses import dataclass, field

from waychair.config import Settings, setting
from waychair.ros.node_settings.shared_fields import chair_field
from waychair.simulation.simulator import SensorSettings


@dataclass(frozen=True, slots=True)
class SimulatorNodeSettings(Settings):
    """The simulated chair, its world, and its sensors."""

    world: str = setting(
        "small_clinic", "", "world by name (`waychair worlds`), or a plan's .yaml file; its first level is simulated"
    )
    chair: str = chair_field()
    plant_model: str = setting(
        "kinematic", "", "plant of the simulated chair: kinematic (fast) or mujoco (casters, motors)"
    )
    seed: int = setting(0, "", "seed of the sensors' noise; the same seed gives the same noise", low=0, high=2**31)
    people: bool = setting(True, "", "true: the world's pedestrians are simulated")
    camera: bool = setting(True, "", "true: the camera is simulated, where this computer can render")
    board_link: str = setting("", "", "path of a link to the board's cable; empty: only its pseudo-terminal's own path")
    pose_file: str = setting(
        "", "", "file in which the chair's pose is kept for a restart; empty: each run begins at the world's start"
    )
    sensors: SensorSettings = field(default_factory=SensorSettings)
    publish_base: bool = setting(
        True, "", "true: odometry, its transform and the mounts are published; false: that is left to a bridge"
    )
