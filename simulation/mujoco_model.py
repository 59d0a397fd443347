"""The physical chair and the walls round it as MJCF, MuJoCo's model language: data to text, no MuJoCo needed.

The parameter set is one that was measured against truth: what decides is the shape of the drive wheels. An ellipsoid
touches the floor in one point and turns in place with 1 to 2 degrees of odometry error per turn; a cylinder touches at
both rims and resists the turn (28 degrees). Friction cones must be elliptic: pyramidal ones slip in yaw.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.config import Settings, setting
from waychair.geometry import transform_points
from waychair.maps.grid import occupied
from waychair.simulation.plant import PlantSettings
from waychair.types import BoolArray, IntArray, OccupancyGrid, Pose2

FLOOR, WALL = 1, 2
"""Collision bits: wheels meet the floor, the outline meets the walls, and no part of the chair meets another."""

WALL_HEIGHT = 2.0
"""Height of the walls [m]: taller than the chair is all that matters."""

OUTLINE_LOW, OUTLINE_HIGH = 0.10, 0.90
"""Height [m] above the floor between which the outline is solid; its lower edge clears the floor when it pitches."""


@dataclass(frozen=True, slots=True)
class MujocoSettings(Settings):
    """Masses, wheels, casters and motors of the physical chair; plausible for 149 kg with rider, measured on none.

    Of two frictions in contact MuJoCo takes the larger, element by element (its modelling manual, contact parameters):
    a wet floor is a low `floor_friction` and a low `wheel_friction`.
    """

    timestep_ms: float = setting(2.5, "ms", "integration step", low=0.1, high=5.0)
    impratio: float = setting(10.0, "", "stiffness of friction over that of contact", low=0.1, high=1000.0)
    floor_friction: float = setting(0.9, "", "sliding friction of the floor", low=0.0, high=2.0)
    wall_friction: float = setting(0.3, "", "sliding friction of walls and outline", low=0.0, high=2.0)
    frame_mass: float = setting(58.0, "kg", "frame with batteries and motors", low=1.0, high=300.0)
    frame_inset: float = setting(0.06, "m", "outline beyond the frame, on either side", low=0.0, high=0.3)
    rider_mass: float = setting(75.0, "kg", "rider", low=0.001, high=300.0)
    rider_x: float = setting(0.17, "m", "rider's centre ahead of the drive axle", low=-1.0, high=1.0)
    rider_z: float = setting(0.46, "m", "rider's centre above the drive axle", low=0.0, high=1.5)
    wheel_mass: float = setting(6.0, "kg", "one drive wheel", low=0.1, high=50.0)
    wheel_half_width: float = setting(0.03, "m", "semi-axis of a drive wheel across", low=0.005, high=0.1)
    wheel_friction: float = setting(0.9, "", "sliding friction of a drive wheel", low=0.0, high=2.0)
    wheel_torsion: float = setting(0.01, "m", "its friction against turning on the spot", low=0.0, high=0.1)
    wheel_rolling: float = setting(0.0015, "m", "its friction against rolling", low=0.0, high=0.1)
    wheel_armature: float = setting(0.3, "kg m^2", "inertia of motor and gear at the wheel", low=0.0, high=5.0)
    wheel_damping: float = setting(0.3, "N m s/rad", "drag of motor and gear", low=0.0, high=10.0)
    motor_gain: float = setting(60.0, "N m s/rad", "torque per missing wheel speed", low=1.0, high=1000.0)
    motor_torque: float = setting(55.0, "N m", "most that one motor gives", low=1.0, high=500.0)
    caster_from_front: float = setting(0.23, "m", "caster pivot behind the front end", low=0.0, high=1.0)
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
    swivel_damping: float = setting(0.12, "N m s/rad", "drag of the pivot", low=0.0, high=5.0)
    swivel_friction: float = setting(0.25, "N m", "dry friction of the pivot", low=0.0, high=5.0)
    swivel_armature: float = setting(0.01, "kg m^2", "inertia added to the pivot", low=0.0, high=1.0)


def rectangles_from_cells(cells: BoolArray) -> IntArray:
    """Few disjoint rectangles (N, 4) of row, column, height, width [cells] that cover the set cells (H, W) exactly.

    Greedy: from the first cell left over, the larger of the widest and the tallest rectangle that starts there.
    """
    left = cells.copy()
    rectangles = []
    for row, col in np.argwhere(cells).tolist():
        if not left[row, col]:
            continue
        wide, tall = _run(left[row, col:]), _run(left[row:, col])
        reach = left[row : row + tall, col : col + wide]
        widest, tallest = (_run(np.all(reach, axis=1)), wide), (tall, _run(np.all(reach, axis=0)))
        height, width = max(widest, tallest, key=lambda shape: shape[0] * shape[1])
        left[row : row + height, col : col + width] = False
        rectangles.append((row, col, height, width))
    return np.array(rectangles, np.int64).reshape(-1, 4)


def mjcf(grid: OccupancyGrid, body: ChairBody, plant: PlantSettings, settings: MujocoSettings, pose: Pose2) -> str:
    """MJCF text of one chair at `pose` (map_from_base) and the occupied cells of `grid`; MuJoCo's world is the map.

    The body `chair` has its origin in the middle of the drive axle, at wheel height. Of `plant` only the true radii
    and the true track count here. Joints and motors are named `left` and `right`; walls are the geoms of
    `conaffinity` `WALL`.
    """
    s = settings
    return f"""<mujoco model="waychair">
<compiler angle="radian"/>
<option timestep="{s.timestep_ms / 1000.0}" integrator="implicitfast" cone="elliptic" impratio="{s.impratio}"/>
<worldbody>
<geom name="floor" type="plane" size="0 0 1" friction="{s.floor_friction} 0 0" contype="0" conaffinity="{FLOOR}"/>
{_walls(grid, s)}
<body name="chair" pos="{pose.x} {pose.y} {body.wheel_radius}" euler="0 0 {pose.theta}">
<freejoint/>
{_seat(body, s)}
{_wheel("left", 0.5 * body.track * plant.track_scale, body.wheel_radius * plant.left_wheel_scale, body, s)}
{_wheel("right", -0.5 * body.track * plant.track_scale, body.wheel_radius * plant.right_wheel_scale, body, s)}
{_caster(0.5 * body.width - s.caster_inset, body, s)}
{_caster(s.caster_inset - 0.5 * body.width, body, s)}
</body>
</worldbody>
<actuator>
{_motor("left", s)}
{_motor("right", s)}
</actuator>
</mujoco>"""


def _walls(grid: OccupancyGrid, s: MujocoSettings) -> str:
    # They belong to the world's own body: MuJoCo then neither moves them nor asks each one for contact in every step.
    half, corner = 0.5 * grid.resolution, grid.map_from_grid
    rows, cols, heights, widths = rectangles_from_cells(occupied(grid)).T
    middles = transform_points(corner, half * np.stack([2 * cols + widths, 2 * rows + heights], axis=-1))
    return "\n".join(
        f'<geom type="box" pos="{x} {y} {0.5 * WALL_HEIGHT}" euler="0 0 {corner.theta}"'
        f' size="{width * half} {height * half} {0.5 * WALL_HEIGHT}" friction="{s.wall_friction} 0 0"'
        f' contype="0" conaffinity="{WALL}"/>'
        for (x, y), height, width in zip(middles.tolist(), heights.tolist(), widths.tolist(), strict=True)
    )


def _seat(body: ChairBody, s: MujocoSettings) -> str:
    """Frame and rider, which weigh and touch nothing, and the outline, which touches walls and weighs nothing."""
    middle = 0.5 * (body.front - body.rear)
    low, high = OUTLINE_LOW - body.wheel_radius, OUTLINE_HIGH - body.wheel_radius
    return f"""<geom type="box" pos="{middle} 0 0.1" size="{0.5 * body.length} {0.5 * body.width - s.frame_inset} 0.15"
 mass="{s.frame_mass}" contype="0" conaffinity="0"/>
<geom type="ellipsoid" pos="{s.rider_x} 0 {s.rider_z}" size="0.22 0.2 0.42"
 mass="{s.rider_mass}" contype="0" conaffinity="0"/>
<geom type="box" pos="{middle} 0 {0.5 * (low + high)}"
 size="{0.5 * body.length} {0.5 * body.width} {0.5 * (high - low)}"
 mass="0" friction="{s.wall_friction} 0 0" contype="{WALL}" conaffinity="0"/>"""


def _wheel(name: str, y: float, radius: float, body: ChairBody, s: MujocoSettings) -> str:
    """A wheel that is not of nominal radius has its axle higher or lower, so that it stands on the floor."""
    return f"""<body pos="0 {y} {radius - body.wheel_radius}">
<joint name="{name}" axis="0 1 0" armature="{s.wheel_armature}" damping="{s.wheel_damping}"/>
<geom type="ellipsoid" size="{radius} {radius} {s.wheel_half_width}" zaxis="0 1 0" mass="{s.wheel_mass}"
 friction="{s.wheel_friction} {s.wheel_torsion} {s.wheel_rolling}" condim="6" solref="0.01 1"
 contype="{FLOOR}" conaffinity="0"/>
</body>"""


def _caster(y: float, body: ChairBody, s: MujocoSettings) -> str:
    return f"""<body pos="{body.front - s.caster_from_front} {y} {s.caster_radius - body.wheel_radius}">
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


def _run(mask: BoolArray) -> int:
    """Number of leading set values of (N,)."""
    return len(mask) if mask.all() else int(np.argmin(mask))
