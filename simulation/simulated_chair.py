"""One chair in a simulated level: its plant, its joystick lines, its sensors and its contacts.

`Simulator` has one of them, `FleetSimulator` several. The joystick lines are driven by a wired board (the shipped firmware,
which reads the rider's stick and takes commands over its own cable), or without a board by the rider or by the volts of
`drive`, like a bench calibration.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.errors import ConfigError, WorldError
from waychair.firmware_bridge.board import BoardInputs, HostBoard, LineState
from waychair.simulation.contact_watch import ContactWatch
from waychair.simulation.joystick_lines import JoystickLines
from waychair.simulation.level import Level
from waychair.simulation.lifts.lifts import Lifts
from waychair.simulation.lifts.sill import jolt
from waychair.simulation.plan.world import World
from waychair.simulation.plant.kinematic_chair import KinematicChair
from waychair.simulation.plant.mujoco_chair import MujocoChair
from waychair.simulation.plant.plant import Plant, volts_from_twist
from waychair.simulation.scene.contact import Contact, in_contact, move_leaves, person_distance, solid_from_blocks
from waychair.simulation.scene.scene import PersonState
from waychair.simulation.scene.seeds import chair_seed, random_stream
from waychair.simulation.sensor_suite import SensorSuite
from waychair.simulation.sensors.pan_tilt import ServoCameraFaults
from waychair.simulation.sensors.servo_camera import ServoCamera
from waychair.simulation.simulator_settings import SimulatorSettings
from waychair.types import JoystickInput, PanTiltCommand, Pose2, SensorMessage, ServoMessage, Twist


class SimulatedChair:
    """A chair in a level, at rest at first; each of its parts draws random numbers of its own."""

    def __init__(
        self, level: Level, body: ChairBody, settings: SimulatorSettings, pose: Pose2, world: World | None = None
    ) -> None:
        """`world`: the chair's level of the building; by default the one of `level`.

        Raises:
            WorldError: the chair does not fit at the pose.
            MissingExtra: the plant is MuJoCo's, which is not installed.
        """
        self.settings = s = settings
        self.body = body
        self.pushed: Twist | None = None
        """Twist at which a helper pushes the chair by hand, its motors out of gear; None: no one pushes."""
        self._level = level
        self._world = level.world if world is None else world
        self._number = level.enter(self)
        seed = chair_seed(level.seed, self._number)
        self._lines = JoystickLines(s.plant)
        self._contacts = ContactWatch(body)
        self._sensors = SensorSuite(
            body,
            seed,
            s.plant.step_ms * 1_000_000,
            lidar=s.lidar,
            imu=s.imu,
            sonar=s.sonar,
            camera=s.camera,
            servo_camera=s.servo_camera,
            wheels_hz=s.wheels_hz,
            leans=s.plant_model == "mujoco",
            barometer_hz=s.barometer_hz,
        )
        self._plant_stream = random_stream(seed, 0)
        self._chair: Plant
        self._before = Twist()  # before the latest step
        self._free = True
        self._met: int | None = None  # the chair that stopped this one in the latest step
        self._struck = False  # whether a leaf of a lift presses on it
        self.place(self._world, pose)

    @property
    def now_ns(self) -> int:
        """The level's time."""
        return self._level.now_ns

    @property
    def world(self) -> World:
        """The chair's level as it is now."""
        return self._world

    @property
    def key(self) -> str:
        """The chair's name in lifts: that of its body, with its number if it is not the first."""
        return self.body.chair_id if self._number == 0 else f"{self.body.chair_id} {self._number + 1}"

    @property
    def rider(self) -> JoystickInput:
        """The rider's stick."""
        return self._lines.rider

    @rider.setter
    def rider(self, stick: JoystickInput) -> None:
        self._lines.rider = stick

    @property
    def board_inputs(self) -> BoardInputs:
        """The board's other inputs: reference line, e-stop, a defect."""
        return self._lines.inputs

    @board_inputs.setter
    def board_inputs(self, inputs: BoardInputs) -> None:
        self._lines.inputs = inputs

    @property
    def lines(self) -> LineState | None:
        """State of the joystick lines after the board's last step; None before a board was wired in."""
        return self._lines.state

    @property
    def camera_problem(self) -> str | None:
        """Why a camera of the settings cannot render; None if it can, or if there is no camera."""
        return self._sensors.camera_problem

    @property
    def in_contact(self) -> bool:
        """Whether the chair touches something solid or a person, or has fallen."""
        return self._contacts.touches

    @property
    def contact_reports(self) -> list[Contact]:
        """The contacts so far; each is reported once, however long it lasts."""
        return self._contacts.reports

    @property
    def contacts(self) -> int:
        """Number of contacts so far."""
        return len(self._contacts.reports)

    @property
    def people(self) -> tuple[PersonState, ...]:
        """All people on the chair's level, now."""
        return self._level.people_on(self._world.level)

    def wire(self, board: HostBoard | None) -> None:
        """Connect a board between the rider's stick and the chair's lines, or remove it; it runs on simulated time.

        `board_inputs` holds its other inputs (reference line, e-stop, a defect) and may be replaced.
        """
        self._lines.wire(board, self.now_ns)

    def drive(self, forward_volts: float, turn_volts: float) -> None:
        """Hold the lines at these volts (turn volts above neutral turn right) until the next `drive` or `release`.

        Raises:
            ValueError: the volts are not finite, or a board holds the lines.
        """
        self._lines.hold(forward_volts, turn_volts)

    def release(self) -> None:
        """Release the lines, so that `rider` drives the chair."""
        self._lines.release()

    def aim(self, command: PanTiltCommand) -> None:
        """Give an order to the camera on servos.

        Raises:
            ConfigError: this chair has no such camera.
            ValueError: an angle is not finite.
        """
        self._servo_camera().order(command)

    def look(self) -> tuple[ServoMessage, ...]:
        """Return the newest messages of the camera on servos since the last call, in order; without such a camera none."""
        looked = tuple(self._sensors.looked)
        self._sensors.looked.clear()
        return looked

    def break_servo_camera(self, faults: ServoCameraFaults) -> None:
        """Give the camera on servos these defects, instead of those before.

        Raises:
            ConfigError: this chair has no such camera.
        """
        self._servo_camera().faults = faults

    def servo_angles(self) -> tuple[float, float]:
        """Return the true pan and tilt [rad] of the camera on servos.

        Raises:
            ConfigError: this chair has no such camera.
        """
        return self._servo_camera().servos.angles

    def truth(self) -> Pose2:
        """True `map_from_base`."""
        return self._chair.pose

    def twist(self) -> Twist:
        """True twist over the ground, base frame."""
        return self._chair.twist

    def clearance(self) -> float:
        """Return the true distance [m] from the chair's rectangle to the nearest obstacle."""
        return self._contacts.clearance(self._chair.pose)

    def person_distance(self) -> float:
        """Return the true distance [m] from the chair's rectangle to the nearest person; +inf without people."""
        return person_distance(self.body, self._chair.pose, self.people)

    def place(self, world: World, pose: Pose2) -> None:
        """Put the chair at rest into a world.

        Raises:
            WorldError: it does not fit there.
        """
        lifts = self._level.lifts
        leaves = () if lifts is None else lifts.sliding_leaves(world.level)
        solid = solid_from_blocks(world.blocks, world.pits, leaves)
        if lifts is not None:
            move_leaves(solid, lifts.leaves(world.level))
        if in_contact(solid, self.body, pose):
            raise WorldError(
                f"chair {self.body.chair_id} does not fit at ({pose.x:g}, {pose.y:g}, {pose.theta:g}) in "
                f"'{world.name}': move it to free ground"
            )
        if self.now_ns:
            self._sensors.carry_over(self._chair)
        self._world = world
        self._contacts.place(solid)
        self._sensors.place(world, leaves)
        if lifts is not None:
            self._see_leaves(lifts, world)
        self._chair = _plant(world, pose, self.body, self.settings, self._plant_stream)

    @property
    def speed_before(self) -> float:
        """The speed [m/s] over the ground before the latest step."""
        return abs(self._before.v)

    def move(self) -> None:
        """Let one step of the plant pass at the volts that are on the lines."""
        chair = self._chair
        self._before, self._met = chair.twist, None
        volts = self._lines.volts if self.pushed is None else self._volts_of(self.pushed)
        self._free = chair.step(*volts, self._is_free)

    def answer(self) -> None:
        """Let a wired board follow the step; its volts drive the next one."""
        self._lines.step(self.now_ns)

    def follow_lifts(self, lifts: Lifts) -> None:
        """Go with the lift to another level, or see its leaves where they are now."""
        self._struck = lifts.is_struck(self.key)
        level = lifts.level_of(self.key)
        if level != self.world.level:
            self.place(lifts.levels[level], lifts.pose_of(self.key))
        elif lifts.moving(self.world.level):
            self._see_leaves(lifts, self.world)

    def report(self, people_moved: bool) -> None:
        """Report the contacts that begin with this step; `people_moved`: whether people were moved in it."""
        chair, speed = self._chair, self.speed_before
        if people_moved:
            self._contacts.report_people(self.now_ns, chair.pose, speed, self.people)
        if self._met is not None:
            self._level.report_touch(self._number, self._met)
        free = (self._free or self._met is not None) and not self._struck
        self._contacts.report_solid(self.now_ns, chair.pose, speed, free=free, upright=chair.upright)

    def sense(self) -> Iterator[SensorMessage]:
        """Yield the messages of the step."""
        lifts = self._level.lifts
        lifted = height = 0.0
        if lifts is not None:
            lifted, height = lifts.acceleration(self.key, self.now_ns), lifts.height(self.key, self.now_ns)
        lifted += jolt(self.world.gaps, self.body, self._chair.pose, self._chair.twist.v)
        yield from self._sensors.sense(self.now_ns, self._chair, self._level.seen_by(self._number), lifted, height)

    def _see_leaves(self, lifts: Lifts, world: World) -> None:
        """Put the leaves of a level where they are now."""
        leaves = lifts.leaves(world.level)
        self._contacts.move_leaves(leaves)
        self._sensors.move_leaves(leaves)

    def _is_free(self, pose: Pose2) -> bool:
        self._met = self._level.taken_by(self._number, pose)
        return self._met is None and self._contacts.is_free(pose)

    def _servo_camera(self) -> ServoCamera:
        if self._sensors.servo_camera is None:
            why = self.camera_problem or "set servo_camera.rate_hz above 0"
            raise ConfigError(f"this simulated chair has no camera on servos: {why}")
        return self._sensors.servo_camera

    def _volts_of(self, pushed: Twist) -> tuple[float, float]:
        """Return the volts that would drive the wheels at the speeds of a pushed chair."""
        return volts_from_twist(self.settings.plant, self.body.track, pushed)


def _plant(world: World, pose: Pose2, body: ChairBody, settings: SimulatorSettings, rng: np.random.Generator) -> Plant:
    if settings.plant_model == "mujoco":
        return MujocoChair(world=world, body=body, plant=settings.plant, settings=settings.mujoco, rng=rng, pose=pose)
    return KinematicChair(body, settings.plant, rng, pose)
