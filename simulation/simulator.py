"""A chair in a world, in lockstep: joystick lines in, stamped messages out, the same bytes for the same seed.

Time passes only in `advance`. The joystick lines are driven by a wired board (the shipped firmware, which reads the
rider's stick and takes commands over its own cable), or without a board by the rider or by the volts of `drive`, like a
bench calibration. The truth (pose, twist, contacts, clearance, people) is for scores and reports only; software that
drives the chair must not read it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.config import Settings, setting
from waychair.errors import ConfigError, WorldError
from waychair.firmware_bridge.board import BoardInputs, HostBoard, LineState, at_rest
from waychair.simulation.people.people import CONTACT_GAP, SimulatedPeople
from waychair.simulation.plan.world import World
from waychair.simulation.plant.kinematic_chair import KinematicChair
from waychair.simulation.plant.mujoco_chair import MujocoChair, substeps
from waychair.simulation.plant.mujoco_model import MujocoSettings
from waychair.simulation.plant.plant import Plant, PlantSettings, volts_from_joystick, volts_from_twist
from waychair.simulation.scene.contact import (
    Contact,
    ContactKind,
    clearance,
    in_contact,
    nearest_person,
    nearest_point,
    person_distance,
    solid_from_blocks,
)
from waychair.simulation.scene.scene import PersonPlan, PersonState
from waychair.simulation.sensors.camera import CameraSettings, RgbdCamera
from waychair.simulation.sensors.height_slices import slice_at
from waychair.simulation.sensors.imu import Imu, ImuSettings
from waychair.simulation.sensors.lidar import Lidar, LidarSettings
from waychair.simulation.sensors.rays import scenery_from_slice
from waychair.simulation.sensors.renderer import Renderer, camera_matrix, renderer_problem
from waychair.simulation.sensors.sonar import Sonars, SonarSettings
from waychair.simulation.sensors.tilted_rays import TiltedPose, terrain_from_world
from waychair.topics import CAMERA, IMU, SONAR, WHEELS
from waychair.types import JoystickInput, Pose2, SensorMessage, Twist, WheelTicks

PLANT_MODELS = ("kinematic", "mujoco")
"""Ideal wheels, or mass, motors, casters and slip."""

CONTACT_ENDS = 0.02
"""Distance [m] at which a contact has ended, so that continued pushing counts once."""

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

    def __init__(self, world: World, body: ChairBody, settings: SimulatorSettings | None = None, seed: int = 0) -> None:
        """
        Raises:
            WorldError: the chair does not fit at the world's start.
            MissingExtra: the plant is MuJoCo's, which is not installed.
        """
        self.settings = settings or SimulatorSettings()
        self.body = body
        self.rider = JoystickInput(0)
        self.now_ns = 0
        self.world = world
        self.board_inputs: BoardInputs = at_rest()
        self.contact_reports: list[Contact] = []
        self.lines: LineState | None = None
        """State of the joystick lines after the board's last step; None before a board was wired in."""
        self.pushed: Twist | None = None
        """Twist at which a helper pushes the chair by hand, its motors out of gear; None: no one pushes."""
        self._seed = seed
        self._step_ns = self.settings.plant.step_ms * 1_000_000
        self._lines: tuple[float, float] | None = None
        self._board: HostBoard | None = None
        self._board_volts = (0.0, 0.0)
        self._touching: set[ContactKind] = set()
        self._lidar = Lidar(self.settings.lidar, body, _random_stream(seed, 1))
        self._imu = Imu(self.settings.imu, _random_stream(seed, 2))
        self._sonars = Sonars(self.settings.sonar, body, _random_stream(seed, 3))
        self._ticks_before = (0, 0)
        self._plant_stream = _random_stream(seed, 0)
        self._place(world, world.start)

    @property
    def camera_problem(self) -> str | None:
        """Why the camera of the settings cannot render; None if it can, or if there is no camera."""
        return renderer_problem() if self.settings.camera.rate_hz > 0.0 and self._camera is None else None

    @property
    def in_contact(self) -> bool:
        """Whether the chair touches something solid or a person, or has fallen."""
        return bool(self._touching)

    @property
    def contacts(self) -> int:
        """Number of contacts so far; each counts once, however long it lasts."""
        return len(self.contact_reports)

    @property
    def people(self) -> tuple[PersonState, ...]:
        """All people on this level, now."""
        return self._people_now

    def populate(self, people: Sequence[PersonPlan]) -> None:
        """Replace all people by these; each starts its plan from the beginning.

        Raises:
            WorldError: a person's start is not free, or its speed is impossible.
        """
        self._people = SimulatedPeople(people, self.world.grid, self.body, _random_stream(self._seed, 4))
        self._people_now = self._people.states
        self.world = replace(self.world, people=tuple(people))

    def wire(self, board: HostBoard | None) -> None:
        """Connect a board between the rider's stick and the chair's lines, or remove it; it runs on simulated time.

        `board_inputs` holds its other inputs (reference line, e-stop, a defect) and may be replaced.
        """
        self._board = board
        if board is not None:
            self.board_inputs = at_rest(board.settings.family)
            self._step_board(board)

    def drive(self, forward_volts: float, turn_volts: float) -> None:
        """Hold the lines at these volts (turn volts above neutral turn right) until the next `drive` or `release`.

        Raises:
            ValueError: the volts are not finite, or a board holds the lines.
        """
        if self._board is not None:
            raise ValueError("a board holds the joystick lines: command it, or take it out with `wire(None)`")
        if not (math.isfinite(forward_volts) and math.isfinite(turn_volts)):
            raise ValueError(f"{forward_volts}, {turn_volts} V cannot be put on the lines: give finite volts")
        self._lines = (forward_volts, turn_volts)

    def release(self) -> None:
        """Release the lines, so that `rider` drives the chair."""
        self._lines = None

    def close(self, *doors: str) -> None:
        """Close doors of this level.

        Raises:
            WorldError: there is no door of this name, or the chair stands in it.
        """
        self._place(self.world.with_closed(doors), self.truth())

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
            self._sense(messages)
        return tuple(messages)

    def truth(self) -> Pose2:
        """True `map_from_base`."""
        return self._chair.pose

    def twist(self) -> Twist:
        """True twist over the ground, base frame."""
        return self._chair.twist

    def clearance(self) -> float:
        """Return the true distance [m] from the chair's rectangle to the nearest obstacle."""
        return clearance(self._solid, self.body, self._chair.pose)

    def person_distance(self) -> float:
        """Return the true distance [m] from the chair's rectangle to the nearest person; +inf without people."""
        return person_distance(self.body, self._chair.pose, self._people_now)

    def _place(self, world: World, pose: Pose2) -> None:
        """Put the chair at rest into a world."""
        solid = solid_from_blocks(world.blocks, world.pits)
        if in_contact(solid, self.body, pose):
            raise WorldError(
                f"chair {self.body.chair_id} does not fit at ({pose.x:g}, {pose.y:g}, {pose.theta:g}) in "
                f"'{world.name}': move it to free ground"
            )
        if self.now_ns:
            self._ticks_before = self._ticks()
        if not self.now_ns or world.level != self.world.level:
            self.world = world
            self.populate(world.people)
        self.world, self._solid = world, solid
        self._scenery = scenery_from_slice(slice_at(world.blocks, self.body.laser_z))
        self._sonar_scenery = scenery_from_slice(slice_at(world.blocks, self.settings.sonar.height))
        self._terrain = (
            terrain_from_world(world) if self.settings.plant_model == "mujoco" else None
        )  # the other cannot tilt
        self._camera = self._camera_for(world)
        self._chair = _plant(world, pose, self.body, self.settings, self._plant_stream)

    def _camera_for(self, world: World) -> RgbdCamera | None:
        camera = self.settings.camera
        if camera.rate_hz == 0.0 or renderer_problem() is not None:
            return None
        matrix = camera_matrix(camera.width, camera.height, camera.field_of_view)
        renderer = Renderer(world, matrix, camera.width, camera.height)
        return RgbdCamera(camera, self.body.base_from_camera, _random_stream(self._seed, 5), renderer)

    def _step(self) -> None:
        volts = self._lines or self._stick_volts()
        speed = abs(self._chair.twist.v)
        volts = self._board_volts if self._board is not None else volts
        free = self._chair.step(*(volts if self.pushed is None else self._volts_of(self.pushed)), self._is_free)
        self.now_ns += self._step_ns
        if self._board is not None:
            self._step_board(self._board)
        if self._people_now and self.now_ns % PEOPLE_STEP_NS == 0:
            self._people.step(PEOPLE_STEP_NS, self._chair.pose, self._chair.twist)
            self._people_now = self._people.states
            self._report_person_contact(speed)
        self._report_contacts(free, speed)

    def _volts_of(self, pushed: Twist) -> tuple[float, float]:
        """Return the volts that would drive the wheels at the speeds of a pushed chair."""
        return volts_from_twist(self.settings.plant, self.body.track, pushed)

    def _stick_volts(self) -> tuple[float, float]:
        return volts_from_joystick(self.settings.plant, self.rider.forward, self.rider.turn)

    def _step_board(self, board: HostBoard) -> None:
        """Run the board up to now; its line volts drive the chair in the next step."""
        forward, turn = (round(1000.0 * volts) for volts in self._stick_volts())
        inputs = replace(self.board_inputs, joystick_forward_mv=forward, joystick_turn_mv=turn)
        lines = self.lines = board.step(self.now_ns // 1_000_000, inputs)
        self._board_volts = lines.forward_mv / 1000.0, lines.turn_mv / 1000.0

    def _sense(self, messages: list[SensorMessage]) -> None:
        """Append the sensors' messages after a step."""
        now_ns, chair, settings = self.now_ns, self._chair, self.settings
        if self._is_due(settings.imu.rate_hz):
            messages.append(self._imu.sample(now_ns, chair.specific_force, chair.angular_rate))
        if self._is_due(settings.wheels_hz):
            messages.append(WheelTicks(now_ns, *self._ticks()))
        if self._is_due(settings.sonar.rate_hz):
            messages.append(self._sonars.read(self._sonar_scenery, chair.pose, self._people_now, now_ns))
        leaning = TiltedPose(self._terrain, chair.pose3) if self._terrain is not None else None
        scan = self._lidar.step(self._scenery, chair.pose, self._people_now, now_ns, leaning)
        if scan is not None:
            messages.append(scan)
        if self._camera is not None and self._is_due(settings.camera.rate_hz):
            messages.append(self._camera.frame(now_ns, chair.pose3, chair.twist, self._people_now))

    def _is_due(self, rate_hz: float) -> bool:
        """Return whether a sample falls into the last step; half a nanosecond guards against rounding."""
        if rate_hz == 0.0:
            return False
        before, now = (self.now_ns - self._step_ns + 0.5) * rate_hz * 1e-9, (self.now_ns + 0.5) * rate_hz * 1e-9
        return math.floor(now) > math.floor(before)

    def _ticks(self) -> tuple[int, int]:
        """Return the encoder counts, which continue when the chair is put into another world."""
        left, right = (sum(pair) for pair in zip(self._ticks_before, self._chair.ticks, strict=True))
        return (left + 2**31) % 2**32 - 2**31, (right + 2**31) % 2**32 - 2**31

    def _report_contacts(self, free: bool, speed: float) -> None:
        """Report a contact when it begins, with the `speed` before it; it ends at a distance of CONTACT_ENDS."""
        pose = self._chair.pose
        if self._contact_begins(ContactKind.SOLID, not free, self.clearance):
            self._report(ContactKind.SOLID, nearest_point(self._solid, self.body, pose), speed)
        if self._contact_begins(ContactKind.FALL, not self._chair.upright, lambda: math.inf):
            self._report(ContactKind.FALL, (pose.x, pose.y), speed)

    def _report_person_contact(self, speed: float) -> None:
        distance, x, y = nearest_person(self.body, self._chair.pose, self._people_now)
        if self._contact_begins(ContactKind.PERSON, distance < 0.5 * CONTACT_GAP, lambda: distance):
            self._report(ContactKind.PERSON, (x, y), speed)

    def _contact_begins(self, kind: ContactKind, touches: bool, distance: Callable[[], float]) -> bool:
        if touches and kind not in self._touching:
            self._touching.add(kind)
            return True
        if not touches and kind in self._touching and distance() > CONTACT_ENDS:
            self._touching.discard(kind)
        return False

    def _report(self, kind: ContactKind, at: tuple[float, float], speed: float) -> None:
        self.contact_reports.append(Contact(self.now_ns, kind, *at, speed))

    def _is_free(self, pose: Pose2) -> bool:
        return not in_contact(self._solid, self.body, pose)


def _plant(world: World, pose: Pose2, body: ChairBody, settings: SimulatorSettings, rng: np.random.Generator) -> Plant:
    if settings.plant_model == "mujoco":
        return MujocoChair(world=world, body=body, plant=settings.plant, settings=settings.mujoco, rng=rng, pose=pose)
    return KinematicChair(body, settings.plant, rng, pose)


def _random_stream(seed: int, sensor: int) -> np.random.Generator:
    """Return a part's own random stream, so that a change of one part does not change the others' bytes."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(sensor,)))
