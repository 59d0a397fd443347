"""A chair in a world, in lockstep: joystick lines in, stamped messages out, the same bytes for the same seed.

Time passes only in `advance`. The joystick lines are driven by a wired board (the shipped firmware, which reads the
rider's stick and takes commands over its own cable), or without a board by the rider or by the volts of `drive`, like a
bench calibration. The truth (pose, twist, contacts, clearance, people) is for scores and reports only; software that
drives the chair must not read it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.config import Settings, setting
from waychair.errors import ConfigError, WorldError
from waychair.firmware_bridge.board import BoardInputs, HostBoard, LineState
from waychair.simulation.contact_watch import ContactWatch
from waychair.simulation.joystick_lines import JoystickLines
from waychair.simulation.lifts.lifts import Lifts
from waychair.simulation.people.people import SimulatedPeople
from waychair.simulation.plan.world import World
from waychair.simulation.plant.kinematic_chair import KinematicChair
from waychair.simulation.plant.mujoco_chair import MujocoChair, substeps
from waychair.simulation.plant.mujoco_model import MujocoSettings
from waychair.simulation.plant.plant import Plant, PlantSettings, volts_from_twist
from waychair.simulation.scene.contact import Contact, in_contact, move_leaves, person_distance, solid_from_blocks
from waychair.simulation.scene.scene import PersonPlan, PersonState
from waychair.simulation.scene.seeds import random_stream
from waychair.simulation.sensor_suite import SensorSuite
from waychair.simulation.sensors.camera import CameraSettings
from waychair.simulation.sensors.imu import ImuSettings
from waychair.simulation.sensors.lidar import LidarSettings
from waychair.simulation.sensors.pan_tilt import ServoCameraFaults
from waychair.simulation.sensors.servo_camera import ServoCamera, ServoCameraSettings
from waychair.simulation.sensors.sonar import SonarSettings
from waychair.topics import CAMERA, IMU, SONAR, WHEELS
from waychair.types import JoystickInput, PanTiltCommand, Pose2, SensorMessage, ServoMessage, Twist

PLANT_MODELS = ("kinematic", "mujoco")
"""Ideal wheels, or mass, motors, casters and slip."""

PEOPLE_STEP_NS = 50_000_000
"""Step of the people's motion and of the check for contact with them."""


@dataclass(frozen=True, slots=True)
class SimulatorSettings(Settings):
    """Plant, sensors and their rates; the periods of encoders, lidar and IMU must be whole numbers of plant steps."""

    plant_model: str = setting(
        "kinematic", "", "plant of the simulated chair: kinematic (fast) or mujoco (casters, motors)"
    )
    plant: PlantSettings = field(default_factory=PlantSettings)
    mujoco: MujocoSettings = field(default_factory=MujocoSettings)
    lidar: LidarSettings = field(default_factory=LidarSettings)
    imu: ImuSettings = field(default_factory=ImuSettings)
    sonar: SonarSettings = field(default_factory=SonarSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    servo_camera: ServoCameraSettings = field(default_factory=ServoCameraSettings)
    wheels_hz: float = setting(
        WHEELS.rate_hz,
        "Hz",
        "readings per second of the wheel encoders; larger: speeds are known sooner",
        low=1.0,
        high=1000.0,
    )

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.plant_model not in PLANT_MODELS:
            raise ConfigError(f"plant_model = '{self.plant_model}' is unknown: take {' or '.join(PLANT_MODELS)}")
        if self.plant_model == "mujoco":
            substeps(self.plant, self.mujoco)
        rates = {"wheels_hz": self.wheels_hz, "lidar rate_hz": self.lidar.rate_hz, "imu rate_hz": self.imu.rate_hz}
        for name, rate in rates.items():
            steps = 1000.0 / (rate * self.plant.step_ms) if rate else 1.0
            if steps < 1.0 or not math.isclose(steps, round(steps), rel_tol=1e-9):
                raise ConfigError(
                    f"{name} = {rate:g} is impossible: its period must be a whole number of steps of "
                    f"{self.plant.step_ms} ms"
                )


@dataclass(frozen=True, slots=True)
class SensorSettings(Settings):
    """The simulated sensors; the command or node decides which sensors without a rate here are on, and at which rate."""

    lidar: LidarSettings = field(default_factory=LidarSettings)
    imu: ImuSettings = field(default_factory=ImuSettings)
    sonar: SonarSettings = field(default_factory=SonarSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    servo_camera: ServoCameraSettings = field(default_factory=ServoCameraSettings)
    wheels_hz: float = setting(
        WHEELS.rate_hz,
        "Hz",
        "readings per second of the wheel encoders; larger: speeds are known sooner",
        low=1.0,
        high=1000.0,
    )

    def over(self, settings: SimulatorSettings) -> SimulatorSettings:
        """Return the simulated chair with these sensors; those whose rate is 0 here keep that of `settings`."""
        return replace(
            settings,
            lidar=self.lidar,
            imu=replace(self.imu, rate_hz=self.imu.rate_hz or settings.imu.rate_hz),
            sonar=replace(self.sonar, rate_hz=self.sonar.rate_hz or settings.sonar.rate_hz),
            camera=replace(self.camera, rate_hz=self.camera.rate_hz or settings.camera.rate_hz),
            servo_camera=self.servo_camera if self.servo_camera.rate_hz else settings.servo_camera,
            wheels_hz=self.wheels_hz,
        )


@dataclass(frozen=True, slots=True)
class SimulationSettings(Settings):
    """The settings of a simulation, whichever chair it simulates; a chair's own figures are in its .yaml file."""

    plant_model: str = setting(
        "kinematic", "", "plant of the simulated chair: kinematic (fast) or mujoco (casters, motors)"
    )
    sensors: SensorSettings = field(default_factory=SensorSettings)

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        self.over(SimulatorSettings())  # refuses an unknown plant, and rates that the plant's steps cannot keep

    def over(self, settings: SimulatorSettings) -> SimulatorSettings:
        """Return the simulated chair with this plant and these sensors."""
        return replace(self.sensors.over(settings), plant_model=self.plant_model)


def with_all_sensors(settings: SimulatorSettings) -> SimulatorSettings:
    """Return the same chair with IMU, sonars and camera switched on, at the rates of `topics`."""
    return replace(
        settings,
        imu=replace(settings.imu, rate_hz=IMU.rate_hz),
        sonar=replace(settings.sonar, rate_hz=SONAR.rate_hz),
        camera=replace(settings.camera, rate_hz=CAMERA.rate_hz),
    )


class Simulator:
    """One chair on one level; it starts at `world.start`, at rest, at time 0, with the joystick live."""

    def __init__(
        self,
        world: World,
        body: ChairBody,
        settings: SimulatorSettings | None = None,
        seed: int = 0,
        lifts: Lifts | None = None,
    ) -> None:
        """`lifts` move and carry the chair from level to level; without them, lifts are open and `ride` is at once.

        Raises:
            WorldError: the chair does not fit at the world's start, or its plant does not know moving leaves.
            MissingExtra: the plant is MuJoCo's, which is not installed.
        """
        self.settings = s = settings or SimulatorSettings()
        self.body = body
        self.now_ns = 0
        self.world = world
        self.pushed: Twist | None = None
        """Twist at which a helper pushes the chair by hand, its motors out of gear; None: no one pushes."""
        self._seed = seed
        self._step_ns = s.plant.step_ms * 1_000_000
        self._lines = JoystickLines(s.plant)
        self._contacts = ContactWatch(body)
        self._sensors = SensorSuite(
            body,
            seed,
            self._step_ns,
            lidar=s.lidar,
            imu=s.imu,
            sonar=s.sonar,
            camera=s.camera,
            servo_camera=s.servo_camera,
            wheels_hz=s.wheels_hz,
            leans=s.plant_model == "mujoco",
        )
        self._plant_stream = random_stream(seed, 0)
        self._chair: Plant
        self.lifts = lifts
        if lifts is not None and s.plant_model != "kinematic":
            raise WorldError("lifts move with the kinematic plant only: set plant_model = kinematic")
        if lifts is not None:
            lifts.note_chair(body.chair_id, world.level, world.start, body)
        self._place(world, world.start)

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
        """All people on this level, now."""
        return self._people_now

    def populate(self, people: Sequence[PersonPlan]) -> None:
        """Replace all people by these; each starts its plan from the beginning.

        Raises:
            WorldError: a person's start is not free, or its speed is impossible.
        """
        self._people = SimulatedPeople(people, self.world.grid, self.body, random_stream(self._seed, 4))
        self._people_now = self._everybody()
        self.world = replace(self.world, people=tuple(people))

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

    def close(self, *doors: str) -> None:
        """Close doors of this level.

        Raises:
            WorldError: there is no door of this name, or the chair stands in it.
        """
        self._place(self.world.with_closed(doors), self.truth())

    def refurnish(self, world: World) -> None:
        """Replace the level by another state of it, such as one with a door open again; the chair comes to rest.

        Raises:
            WorldError: the chair does not fit there.
        """
        self._place(world, self.truth())

    def ride(self, level: World) -> None:
        """Take the lift to another level of the building; the chair keeps its pose in the cabin and is at rest.

        Raises:
            WorldError: no lift stops at both levels, or the chair is not in its cabin.
        """
        pose = self.truth()
        shared = [lift for lift in self.world.lifts if lift in level.lifts]
        if not shared:
            raise WorldError(f"no lift goes from {self.world.level or self.world.name} to {level.level or level.name}")
        for lift in shared:
            inside = lift.middle.inverse() @ pose
            if abs(inside.x) <= lift.length / 2 and abs(inside.y) <= lift.width / 2:
                return self._place(level, pose)
        names = ", ".join(lift.name for lift in shared)
        raise WorldError(f"the chair at ({pose.x:.2f}, {pose.y:.2f}) is not in {names}: drive it into the cabin first")

    def advance(self, duration_ns: int) -> tuple[SensorMessage, ...]:
        """Let a whole number of steps pass; return the messages of that time in order.

        Raises:
            ValueError: the duration is negative or not a multiple of the plant's step.
        """
        if duration_ns < 0 or duration_ns % self._step_ns:
            raise ValueError(f"cannot advance by {duration_ns} ns: give a multiple of {self._step_ns} ns")
        messages: list[SensorMessage] = []
        for _ in range(duration_ns // self._step_ns):
            self._step()
            lifted = 0.0 if self.lifts is None else self.lifts.acceleration(self.body.chair_id, self.now_ns)
            messages += self._sensors.sense(self.now_ns, self._chair, self._people_now, lifted)
        return tuple(messages)

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
        return person_distance(self.body, self._chair.pose, self._people_now)

    def _servo_camera(self) -> ServoCamera:
        if self._sensors.servo_camera is None:
            why = self.camera_problem or "set servo_camera.rate_hz above 0"
            raise ConfigError(f"this simulated chair has no camera on servos: {why}")
        return self._sensors.servo_camera

    def _place(self, world: World, pose: Pose2) -> None:
        """Put the chair at rest into a world."""
        leaves = () if self.lifts is None else self.lifts.sliding_leaves(world.level)
        solid = solid_from_blocks(world.blocks, world.pits, leaves)
        if self.lifts is not None:
            move_leaves(solid, self.lifts.leaves(world.level))
        if in_contact(solid, self.body, pose):
            raise WorldError(
                f"chair {self.body.chair_id} does not fit at ({pose.x:g}, {pose.y:g}, {pose.theta:g}) in "
                f"'{world.name}': move it to free ground"
            )
        if self.now_ns:
            self._sensors.carry_over(self._chair)
        if not self.now_ns or world.level != self.world.level:
            self.world = world
            self.populate(world.people)
        self.world = world
        self._contacts.place(solid)
        self._sensors.place(world, leaves)
        if self.lifts is not None:
            self._see_leaves(self.lifts)
        self._chair = _plant(world, pose, self.body, self.settings, self._plant_stream)

    def _step(self) -> None:
        """Let one step of the plant pass; a wired board follows it, and its volts drive the next step."""
        chair, speed = self._chair, abs(self._chair.twist.v)
        volts = self._lines.volts if self.pushed is None else self._volts_of(self.pushed)
        free = chair.step(*volts, self._contacts.is_free)
        self.now_ns += self._step_ns
        self._lines.step(self.now_ns)
        if self.lifts is not None:
            free = self._step_lifts(self.lifts) and free
        if self.now_ns % PEOPLE_STEP_NS == 0 and (self._people_now or self.lifts is not None):
            self._people.step(PEOPLE_STEP_NS, chair.pose, chair.twist)
            self._people_now = self._everybody()
            self._contacts.report_people(self.now_ns, chair.pose, speed, self._people_now)
        self._contacts.report_solid(self.now_ns, chair.pose, speed, free=free, upright=chair.upright)

    def _step_lifts(self, lifts: Lifts) -> bool:
        """Let cars, leaves and passengers move, and the chair with its car; return whether no leaf presses on it."""
        key = self.body.chair_id
        lifts.note_chair(key, self.world.level, self._chair.pose, self.body)
        lifts.step(self.now_ns)
        if lifts.level_of(key) != self.world.level:
            self._place(lifts.levels[lifts.level_of(key)], lifts.pose_of(key))
        elif lifts.moving(self.world.level):
            self._see_leaves(lifts)
        return not lifts.is_struck(key)

    def _see_leaves(self, lifts: Lifts) -> None:
        """Put the leaves of this level where they are now."""
        leaves = lifts.leaves(self.world.level)
        self._contacts.move_leaves(leaves)
        self._sensors.move_leaves(leaves)

    def _everybody(self) -> tuple[PersonState, ...]:
        """Return the people of this level, and the passengers of its lifts."""
        passengers = () if self.lifts is None else self.lifts.people(self.world.level)
        return (*self._people.states, *passengers)

    def _volts_of(self, pushed: Twist) -> tuple[float, float]:
        """Return the volts that would drive the wheels at the speeds of a pushed chair."""
        return volts_from_twist(self.settings.plant, self.body.track, pushed)


def _plant(world: World, pose: Pose2, body: ChairBody, settings: SimulatorSettings, rng: np.random.Generator) -> Plant:
    if settings.plant_model == "mujoco":
        return MujocoChair(world=world, body=body, plant=settings.plant, settings=settings.mujoco, rng=rng, pose=pose)
    return KinematicChair(body, settings.plant, rng, pose)
