"""The physical chair as MJCF, MuJoCo's model language; writing it needs no MuJoCo.

The shape of the drive wheels matters most, by comparison with the true motion. An ellipsoid touches the floor in one
point and turns on the spot with 1 to 2 degrees of odometry error per turn; a cylinder touches at both rims and resists
the turn (28 degrees). Friction cones must be elliptic: pyramidal ones slip in yaw.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from waychair.calibration.chair_body import ChairBody
from waychair.errors import ConfigError
from waychair.simulation.plan.world import World
from waychair.simulation.plant.figure_limits import Limits, check_limits
from waychair.simulation.plant.mujoco_ground import FLOOR, WALL, ground
from waychair.simulation.plant.plant import GRAVITY, PlantSettings
from waychair.types import Pose2

# Contact figures that all chairs share; plausible, chosen against the true motion of the model.
IMPRATIO = 10.0  # stiffness of friction over that of contact; MuJoCo's default of 1 lets wheels creep
WALL_FRICTION = 0.3  # sliding friction of walls and outline
WHEEL_TORSION = 0.01  # m; friction of a drive wheel against turning on the spot
CASTER_TORSION = 0.004  # m; friction of a caster against turning on the spot
CASTER_ROLLING = 0.002  # m; friction of a caster against rolling
SPRING_SHARE = 0.35  # part of the weight that the casters' springs carry (mid drive)


@dataclass(frozen=True, slots=True)
class MujocoSettings:
    """Masses, wheels, casters and motors of the physical chair; plausible for 149 kg with rider, not measured.

    For two touching geoms MuJoCo takes the larger friction, element by element (modelling manual, contact parameters):
    a wet floor needs low `floor_friction`, `wheel_friction` and `caster_friction`.
    """

    timestep_ms: Annotated[float, Limits(0.1, 5.0)] = 2.5  # ms; integration step of the physics
    floor_friction: Annotated[float, Limits(0.0, 2.0)] = 0.9  # sliding friction of the floor
    frame_mass: Annotated[float, Limits(1.0, 300.0)] = 58.0  # kg; frame with batteries and motors
    frame_inset: Annotated[float, Limits(0.0, 0.3)] = 0.06  # m; outline beyond the frame, on either side
    rider_mass: Annotated[float, Limits(0.001, 300.0)] = 75.0  # kg; rider
    rider_from_rear: Annotated[float, Limits(0.0, 2.0)] = 0.42  # m; rider's centre ahead of the rear end
    rider_z: Annotated[float, Limits(0.0, 2.0)] = 0.625  # m; rider's centre above the floor
    outline_low: Annotated[float, Limits(0.005, 1.0)] = 0.10  # m; lower edge of the outline, clear of ramps and steps
    outline_high: Annotated[float, Limits(0.05, 2.0)] = 0.90  # m; upper edge of the outline
    wheel_mass: Annotated[float, Limits(0.1, 50.0)] = 6.0  # kg; one drive wheel
    wheel_half_width: Annotated[float, Limits(0.005, 0.1)] = 0.03  # m; semi-axis of a drive wheel across
    wheel_friction: Annotated[float, Limits(0.0, 2.0)] = 0.9  # sliding friction of a drive wheel
    wheel_rolling: Annotated[float, Limits(0.0, 0.1)] = 0.0015  # m; rolling friction of a drive wheel
    wheel_armature: Annotated[float, Limits(0.0, 5.0)] = 0.3  # kg m^2; inertia of motor and gear at the wheel
    wheel_damping: Annotated[float, Limits(0.0, 10.0)] = 0.3  # N m s/rad; drag of motor and gear
    motor_gain: Annotated[float, Limits(0.01, 1000.0)] = 60.0  # N m s/rad; torque per missing wheel speed
    motor_torque: Annotated[float, Limits(0.01, 500.0)] = 55.0  # N m; greatest torque of one motor
    brake_torque: Annotated[float, Limits(0.01, 1000.0)] = 120.0  # N m; parking brake of one motor
    caster_from_end: Annotated[float, Limits(0.0, 1.0)] = 0.23  # m; caster pivot from the nearer end
    caster_inset: Annotated[float, Limits(0.0, 0.5)] = 0.06  # m; outline beyond the caster pivot, on either side
    caster_radius: Annotated[float, Limits(0.02, 0.3)] = 0.09  # m; radius of a caster
    caster_half_width: Annotated[float, Limits(0.005, 0.1)] = 0.02  # m; semi-axis of a caster across
    caster_trail: Annotated[float, Limits(0.0, 0.2)] = 0.055  # m; caster's axle behind its pivot
    caster_mass: Annotated[float, Limits(0.05, 20.0)] = 1.0  # kg; one caster
    fork_mass: Annotated[float, Limits(0.05, 20.0)] = 0.8  # kg; one caster's fork
    caster_friction: Annotated[float, Limits(0.0, 2.0)] = 0.7  # sliding friction of a caster
    caster_damping: Annotated[float, Limits(0.0, 1.0)] = 0.02  # N m s/rad; drag of a caster's axle
    spring_stiffness: Annotated[float, Limits(100.0, 1e6)] = 8000.0  # N/m; spring of a caster (mid drive)
    spring_damping: Annotated[float, Limits(0.0, 1e5)] = 400.0  # N s/m; damper of a caster (mid drive)
    swivel_damping: Annotated[float, Limits(0.0, 5.0)] = 0.12  # N m s/rad; drag of a caster's pivot
    swivel_friction: Annotated[float, Limits(0.0, 5.0)] = 0.25  # N m; dry friction of a caster's pivot
    swivel_armature: Annotated[float, Limits(0.0, 1.0)] = 0.01  # kg m^2; inertia added to a caster's pivot

    def __post_init__(self) -> None:
        check_limits(self)
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
<option timestep="{s.timestep_ms / 1000.0}" integrator="implicitfast" cone="elliptic" impratio="{IMPRATIO}"
 gravity="0 0 {-GRAVITY}"/>
<worldbody>
{ground(world, s.floor_friction, WALL_FRICTION, s.outline_high)}
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
 mass="0" friction="{WALL_FRICTION} 0 0" contype="{FLOOR | WALL}" conaffinity="0"/>"""


def _wheel(name: str, y: float, radius: float, body: ChairBody, s: MujocoSettings) -> str:
    """Return a drive wheel; its axle height follows its true radius, so that it stands on the floor.

    The joint's dry friction is the brake. It is stiffer than MuJoCo's default, which lets locked wheels creep down a
    ramp.
    """
    return f"""<body pos="0 {y} {radius - body.wheel_radius}">
<joint name="{name}" axis="0 1 0" armature="{s.wheel_armature}" damping="{s.wheel_damping}"
 solreffriction="0.005 1" solimpfriction="0.999 0.9999 0.001"/>
<geom type="ellipsoid" size="{radius} {radius} {s.wheel_half_width}" zaxis="0 1 0" mass="{s.wheel_mass}"
 friction="{s.wheel_friction} {WHEEL_TORSION} {s.wheel_rolling}" condim="6" solref="0.01 1"
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
    pressed = SPRING_SHARE * mass * GRAVITY / 4.0 / s.spring_stiffness
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
 mass="{s.caster_mass}" friction="{s.caster_friction} {CASTER_TORSION} {CASTER_ROLLING}" condim="6"
 contype="{FLOOR}" conaffinity="0"/>
</body>
</body>"""


def _motor(name: str, s: MujocoSettings) -> str:
    return (
        f'<velocity name="{name}" joint="{name}" kv="{s.motor_gain}"'
        f' forcelimited="true" forcerange="{-s.motor_torque} {s.motor_torque}"/>'
    )
