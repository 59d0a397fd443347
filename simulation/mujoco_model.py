"""The physical chair as MJCF, MuJoCo's model language; writing it needs no MuJoCo.

The shape of the drive wheels matters most, by comparison with the true motion. An ellipsoid touches the floor in one
point and turns on the spot with 1 to 2 degrees of odometry error per turn; a cylinder touches at both rims and resists
the turn (28 degrees). Friction cones must be elliptic: pyramidal ones slip in yaw.
"""

from __future__ import annotations

from dataclasses import dataclass

from waychair.calibration.chair import ChairBody
from waychair.config import Settings, setting
from waychair.errors import ConfigError
from waychair.simulation.mujoco_ground import FLOOR, WALL, ground
from waychair.simulation.plant import GRAVITY, PlantSettings
from waychair.simulation.world import World
from waychair.types import Pose2


@dataclass(frozen=True, slots=True)
class MujocoSettings(Settings):
    """Masses, wheels, casters and motors of the physical chair; plausible for 149 kg with rider, not measured.

    For two touching geoms MuJoCo takes the larger friction, element by element (modelling manual, contact parameters):
    a wet floor needs low `floor_friction`, `wheel_friction` and `caster_friction`.
    """

    timestep_ms: float = setting(2.5, "ms", "integration step", low=0.1, high=5.0)
    impratio: float = setting(10.0, "", "stiffness of friction over that of contact", low=0.1, high=1000.0)
    floor_friction: float = setting(0.9, "", "sliding friction of the floor", low=0.0, high=2.0)
    wall_friction: float = setting(0.3, "", "sliding friction of walls and outline", low=0.0, high=2.0)
    frame_mass: float = setting(58.0, "kg", "frame with batteries and motors", low=1.0, high=300.0)
    frame_inset: float = setting(0.06, "m", "outline beyond the frame, on either side", low=0.0, high=0.3)
    rider_mass: float = setting(75.0, "kg", "rider", low=0.001, high=300.0)
    rider_from_rear: float = setting(0.42, "m", "rider's centre ahead of the rear end", low=0.0, high=2.0)
    rider_z: float = setting(0.625, "m", "rider's centre above the floor", low=0.0, high=2.0)
    outline_low: float = setting(0.10, "m", "lower edge of the outline, clear of ramps and steps", low=0.005, high=1.0)
    outline_high: float = setting(0.90, "m", "upper edge of the outline", low=0.05, high=2.0)
    wheel_mass: float = setting(6.0, "kg", "one drive wheel", low=0.1, high=50.0)
    wheel_half_width: float = setting(0.03, "m", "semi-axis of a drive wheel across", low=0.005, high=0.1)
    wheel_friction: float = setting(0.9, "", "sliding friction of a drive wheel", low=0.0, high=2.0)
    wheel_torsion: float = setting(0.01, "m", "its friction against turning on the spot", low=0.0, high=0.1)
    wheel_rolling: float = setting(0.0015, "m", "its friction against rolling", low=0.0, high=0.1)
    wheel_armature: float = setting(0.3, "kg m^2", "inertia of motor and gear at the wheel", low=0.0, high=5.0)
    wheel_damping: float = setting(0.3, "N m s/rad", "drag of motor and gear", low=0.0, high=10.0)
    motor_gain: float = setting(60.0, "N m s/rad", "torque per missing wheel speed", low=0.01, high=1000.0)
    motor_torque: float = setting(55.0, "N m", "most that one motor gives", low=0.01, high=500.0)
    brake_torque: float = setting(120.0, "N m", "parking brake of one motor", low=0.01, high=1000.0)
    caster_from_end: float = setting(0.23, "m", "caster pivot from the end it is next to", low=0.0, high=1.0)
    caster_inset: float = setting(0.06, "m", "outline beyond the caster pivot, on either side", low=0.0, high=0.5)
    caster_radius: float = setting(0.09, "m", "radius of a caster", low=0.02, high=0.3)
    caster_half_width: float = setting(0.02, "m", "semi-axis of a caster across", low=0.005, high=0.1)
    caster_trail: float = setting(0.055, "m", "caster's axle behind its pivot", low=0.0, high=0.2)
    caster_mass: float = setting(1.0, "kg", "one caster", low=0.05, high=20.0)
    fork_mass: float = setting(0.8, "kg", "one caster's fork", low=0.05, high=20.0)
    caster_friction: float = setting(0.7, "", "sliding friction of a caster", low=0.0, high=2.0)
    caster_torsion: float = setting(0.004, "m", "its friction against turning on the spot", low=0.0, high=0.1)
    caster_rolling: float = setting(0.002, "m", "its friction against rolling", low=0.0, high=0.1)
    caster_damping: float = setting(0.02, "N m s/rad", "drag of its axle", low=0.0, high=1.0)
    spring_stiffness: float = setting(8000.0, "N/m", "spring of a caster (mid drive)", low=100.0, high=1e6)
    spring_damping: float = setting(400.0, "N s/m", "damper of a caster (mid drive)", low=0.0, high=1e5)
    spring_share: float = setting(0.35, "", "part of the weight that the springs carry", low=0.05, high=0.9)
    swivel_damping: float = setting(0.12, "N m s/rad", "drag of the pivot", low=0.0, high=5.0)
    swivel_friction: float = setting(0.25, "N m", "dry friction of the pivot", low=0.0, high=5.0)
    swivel_armature: float = setting(0.01, "kg m^2", "inertia added to the pivot", low=0.0, high=1.0)

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.outline_high <= self.outline_low:
            raise ConfigError(
                f"outline_high = {self.outline_high:g} is impossible: it must lie above outline_low = "
                f"{self.outline_low:g} m"
            )


def mjcf(world: World, body: ChairBody, plant: PlantSettings, settings: MujocoSettings, pose: Pose2) -> str:
    """Return the MJCF text of one chair at `pose` (map_from_base) on its level; MuJoCo's world is the map.

    The body `chair` has its origin in the middle of the drive axle. Only the true radii and the true track of `plant`
    are used. Joints and motors are named `left` and `right`, the solid part of the chair `outline`; the sensors at the
    IMU's mount are an accelerometer and a gyro.

    Raises:
        WorldError: pits that are neither parallel nor at right angles to each other.
    """
    s = settings
    return f"""<mujoco model="waychair">
<compiler angle="radian"/>
<option timestep="{s.timestep_ms / 1000.0}" integrator="implicitfast" cone="elliptic" impratio="{s.impratio}"
 gravity="0 0 {-GRAVITY}"/>
<worldbody>
{ground(world, s.floor_friction, s.wall_friction, s.outline_high)}
<body name="chair" pos="{pose.x} {pose.y} {body.wheel_radius}" euler="0 0 {pose.theta}">
<freejoint/>
<site name="imu" pos="{body.imu_x} {body.imu_y} {body.imu_z - body.wheel_radius}"/>
{_seat(body, s)}
{_wheel("left", 0.5 * body.track * plant.track_scale, body.wheel_radius * plant.left_wheel_scale, body, s)}
{_wheel("right", -0.5 * body.track * plant.track_scale, body.wheel_radius * plant.right_wheel_scale, body, s)}
{_casters(body, s)}
</body>
</worldbody>
<actuator>
{_motor("left", s)}
{_motor("right", s)}
</actuator>
<sensor>
<accelerometer site="imu"/>
<gyro site="imu"/>
</sensor>
</mujoco>"""


def _seat(body: ChairBody, s: MujocoSettings) -> str:
    """Return frame and rider, which have mass but no contacts, and the outline, which has contacts but no mass."""
    middle, axle = 0.5 * (body.front - body.rear), body.wheel_radius
    low, high = s.outline_low - axle, s.outline_high - axle
    return f"""<geom type="box" pos="{middle} 0 {0.6 * axle}"
 size="{0.5 * body.length} {0.5 * body.width - s.frame_inset} {0.9 * axle}"
 mass="{s.frame_mass}" contype="0" conaffinity="0"/>
<geom type="ellipsoid" pos="{s.rider_from_rear - body.rear} 0 {s.rider_z - axle}" size="0.22 0.2 0.42"
 mass="{s.rider_mass}" contype="0" conaffinity="0"/>
<geom name="outline" type="box" pos="{middle} 0 {0.5 * (low + high)}"
 size="{0.5 * body.length} {0.5 * body.width} {0.5 * (high - low)}"
 mass="0" friction="{s.wall_friction} 0 0" contype="{FLOOR | WALL}" conaffinity="0"/>"""


def _wheel(name: str, y: float, radius: float, body: ChairBody, s: MujocoSettings) -> str:
    """Return a drive wheel; its axle height follows its true radius, so that it stands on the floor.

    The joint's dry friction is the brake. It is stiffer than MuJoCo's default, which lets locked wheels creep down a
    ramp.
    """
    return f"""<body pos="0 {y} {radius - body.wheel_radius}">
<joint name="{name}" axis="0 1 0" armature="{s.wheel_armature}" damping="{s.wheel_damping}"
 solreffriction="0.005 1" solimpfriction="0.999 0.9999 0.001"/>
<geom type="ellipsoid" size="{radius} {radius} {s.wheel_half_width}" zaxis="0 1 0" mass="{s.wheel_mass}"
 friction="{s.wheel_friction} {s.wheel_torsion} {s.wheel_rolling}" condim="6" solref="0.01 1"
 contype="{FLOOR}" conaffinity="0"/>
</body>"""


def _casters(body: ChairBody, s: MujocoSettings) -> str:
    """Return pairs of casters ahead of the drive wheels, behind them, or both; both are sprung, or the chair rocks."""
    ahead, behind = body.front - s.caster_from_end, s.caster_from_end - body.rear
    ends = {"rear": (ahead,), "mid": (ahead, behind), "front": (behind,)}[body.drive]
    y = 0.5 * body.width - s.caster_inset
    spring = _spring(s) if body.drive == "mid" else ""
    return "\n".join(_caster(x, side * y, spring, body, s) for x in ends for side in (1.0, -1.0))


def _spring(s: MujocoSettings) -> str:
    """Return the sprung slide of one of four casters; in the middle it bears a quarter of the springs' share."""
    mass = s.frame_mass + s.rider_mass + 2.0 * s.wheel_mass + 4.0 * (s.caster_mass + s.fork_mass)
    pressed = s.spring_share * mass * GRAVITY / 4.0 / s.spring_stiffness
    return (
        f'<joint type="slide" axis="0 0 1" stiffness="{s.spring_stiffness}" damping="{s.spring_damping}"'
        f' springref="{-pressed}"/>'
    )


def _caster(x: float, y: float, spring: str, body: ChairBody, s: MujocoSettings) -> str:
    return f"""<body pos="{x} {y} {s.caster_radius - body.wheel_radius}">
{spring}
<joint axis="0 0 1" armature="{s.swivel_armature}" damping="{s.swivel_damping}" frictionloss="{s.swivel_friction}"/>
<geom type="box" pos="{-0.5 * s.caster_trail} 0 0.1" size="0.03 0.03 0.05" mass="{s.fork_mass}"
 contype="0" conaffinity="0"/>
<body pos="{-s.caster_trail} 0 0">
<joint axis="0 1 0" damping="{s.caster_damping}"/>
<geom type="ellipsoid" size="{s.caster_radius} {s.caster_radius} {s.caster_half_width}" zaxis="0 1 0"
 mass="{s.caster_mass}" friction="{s.caster_friction} {s.caster_torsion} {s.caster_rolling}" condim="6"
 contype="{FLOOR}" conaffinity="0"/>
</body>
</body>"""


def _motor(name: str, s: MujocoSettings) -> str:
    return (
        f'<velocity name="{name}" joint="{name}" kv="{s.motor_gain}"'
        f' forcelimited="true" forcerange="{-s.motor_torque} {s.motor_torque}"/>'
    )
