"""A chair in a world, in lockstep: joystick lines in, stamped messages out, the same bytes for the same seed.

Time passes only in `advance`. What holds the joystick lines is the board that was wired in: the shipped firmware, which
gets the rider's stick and is commanded over its own cable. Without a board it is the rider, or whoever clips a
laboratory supply to the lines by `drive`, as a calibration on the bench does. Truth
(pose, twist, contacts, clearance, people) is for scores and reports; what drives the chair must not read it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.config import Settings, setting
from waychair.errors import ConfigError, WorldError
from waychair.firmware_bridge.board import BoardInputs, HostBoard, LineState, at_rest
from waychair.simulation.camera import Camera, CameraSettings
from waychair.simulation.contact import (
    Contact,
    ContactKind,
    clearance,
    in_contact,
    nearest_person,
    nearest_point,
    person_distance,
    solid_from_blocks,
)
from waychair.simulation.imu import Imu, ImuSettings
from waychair.simulation.kinematic_chair import KinematicChair
from waychair.simulation.lidar import Lidar, LidarSettings
from waychair.simulation.mujoco_chair import MujocoChair, substeps
from waychair.simulation.mujoco_model import MujocoSettings
from waychair.simulation.people import CONTACT_GAP, People
from waychair.simulation.plant import Plant, PlantSettings, volts_from_joystick, volts_from_twist
from waychair.simulation.rays import scenery_of
from waychair.simulation.renderer import Renderer, camera_matrix, renderer_problem
from waychair.simulation.scene import PersonPlan, PersonState
from waychair.simulation.slices import slice_at
from waychair.simulation.sonar import Sonars, SonarSettings
from waychair.simulation.tilted_rays import Leaning, terrain_of
from waychair.simulation.world import World
from waychair.topics import CAMERA, IMU, SONAR, WHEELS
from waychair.types import ImuSample, JoystickInput, Pose2, RgbdFrame, Scan, SonarReadings, Twist, WheelTicks

SensorMessage: TypeAlias = WheelTicks | Scan | ImuSample | RgbdFrame | SonarReadings

PLANT_MODELS = ("kinematic", "mujoco")
"""Bare wheels that do as they are told, or mass, motors, casters and slip."""

CONTACT_ENDS = 0.02
"""A contact is over once the chair is this far [m] from everything, so that pushing on counts once."""

PEOPLE_STEP_NS = 50_000_000
"""People move on, and contact with them is looked for, in steps of this."""


@dataclass(frozen=True, slots=True)
class SimulatorSettings(Settings):
    """Plant, sensors and their rates; the periods of encoders, lidar and IMU must be whole numbers of plant steps."""

    plant_model: str = setting("kinematic", "", "kinematic or mujoco")
    plant: PlantSettings = field(default_factory=PlantSettings)
    mujoco: MujocoSettings = field(default_factory=MujocoSettings)
    lidar: LidarSettings = field(default_factory=LidarSettings)
    imu: ImuSettings = field(default_factory=ImuSettings)
    sonar: SonarSettings = field(default_factory=SonarSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    wheels_hz: float = setting(WHEELS.rate_hz, "Hz", "encoder readings per second", low=1.0, high=1000.0)

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


def with_all_sensors(settings: SimulatorSettings) -> SimulatorSettings:
    """The same chair with IMU, sonars and camera switched on, at the rates of `topics`."""
    return replace(
        settings,
        imu=replace(settings.imu, rate_hz=IMU.rate_hz),
        sonar=replace(settings.sonar, rate_hz=SONAR.rate_hz),
        camera=replace(settings.camera, rate_hz=CAMERA.rate_hz),
    )


class Simulator:
    """One chair on one level; starts at `world.start`, at rest, at time 0, with the lines released."""

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
        self.around_board: BoardInputs = at_rest()
        self.contact_reports: list[Contact] = []
        self.lines: LineState | None = None
        """What the board has left on the joystick lines last; None before one was wired in."""
        self.pushed: Twist | None = None
        """How somebody pushes the chair about by hand, its motors out of gear; None: nobody does."""
        self._seed = seed
        self._step_ns = self.settings.plant.step_ms * 1_000_000
        self._lines: tuple[float, float] | None = None
        self._board: HostBoard | None = None
        self._board_volts = (0.0, 0.0)
        self._touching: set[ContactKind] = set()
        self._lidar = Lidar(self.settings.lidar, body, _stream(seed, 1))
        self._imu = Imu(self.settings.imu, _stream(seed, 2))
        self._sonars = Sonars(self.settings.sonar, body, _stream(seed, 3))
        self._ticks_before = (0, 0)
        self._plant_stream = _stream(seed, 0)
        self._place(world, world.start)

    @property
    def camera_problem(self) -> str | None:
        """Why there are no pictures although the settings ask for them; None when there are, or none are asked for."""
        return renderer_problem() if self.settings.camera.rate_hz > 0.0 and self._camera is None else None

    @property
    def in_contact(self) -> bool:
        """Whether the chair touches something solid or a person, or has fallen."""
        return bool(self._touching)

    @property
    def contacts(self) -> int:
        """Contacts so far: each is counted once, however long it lasts."""
        return len(self.contact_reports)

    @property
    def people(self) -> tuple[PersonState, ...]:
        """Everybody on this level, now."""
        return self._people_now

    def populate(self, people: Sequence[PersonPlan]) -> None:
        """From now on these people are about, and nobody else: each begins the plan anew.

        Raises:
            WorldError: a person stands or is to walk where or as nobody can.
        """
        self._people = People(people, self.world.grid, self.body, _stream(self._seed, 4))
        self._people_now = self._people.states
        self.world = replace(self.world, people=tuple(people))

    def wire(self, board: HostBoard | None) -> None:
        """Put a board between the rider's stick and the chair's lines, or take it out; it lives by this clock.

        `around_board` says what else is around it (its reference line, the e-stop, a defect) and may be replaced.
        """
        self._board = board
        if board is not None:
            self.around_board = at_rest(board.settings.family)
            self._step_board(board)

    def drive(self, forward_volts: float, turn_volts: float) -> None:
        """Hold the lines at these volts (turn above neutral is right) until the next call of this or `release`.

        Raises:
            ValueError: the volts are not finite, or a board holds the lines.
        """
        if self._board is not None:
            raise ValueError("a board holds the joystick lines: command it, or take it out with `wire(None)`")
        if not (math.isfinite(forward_volts) and math.isfinite(turn_volts)):
            raise ValueError(f"{forward_volts}, {turn_volts} V cannot be put on the lines: give finite volts")
        self._lines = (forward_volts, turn_volts)

    def release(self) -> None:
        """Let go of the lines: `rider` moves the chair."""
        self._lines = None

    def close(self, *doors: str) -> None:
        """Shut doors of this level.

        Raises:
            WorldError: there is no door of such a name, or the chair stands in it.
        """
        self._place(self.world.with_closed(doors), self.truth())

    def ride(self, level: World) -> None:
        """Take the lift to another level of the building: the chair comes out where it stands in the cabin, at rest.

        Raises:
            WorldError: no lift stops at both levels, or the chair is not within its cabin.
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
        """Let time pass, a whole number of steps; the messages of that time in the order in which they come.

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
        """True distance [m] from the outline to what is solid."""
        return clearance(self._solid, self.body, self._chair.pose)

    def person_distance(self) -> float:
        """True distance [m] from the outline to the nearest person; +inf where there is nobody."""
        return person_distance(self.body, self._chair.pose, self._people_now)

    def _place(self, world: World, pose: Pose2) -> None:
        """Put the chair, at rest, into a world."""
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
        self._scenery = scenery_of(slice_at(world.blocks, self.body.laser_z))
        self._sonar_scenery = scenery_of(slice_at(world.blocks, self.settings.sonar.height))
        self._terrain = terrain_of(world) if self.settings.plant_model == "mujoco" else None  # the other cannot tilt
        self._camera = self._camera_for(world)
        self._chair = _plant(world, pose, self.body, self.settings, self._plant_stream)

    def _camera_for(self, world: World) -> Camera | None:
        camera = self.settings.camera
        if camera.rate_hz == 0.0 or renderer_problem() is not None:
            return None
        matrix = camera_matrix(camera.width, camera.height, camera.field_of_view)
        renderer = Renderer(world, matrix, camera.width, camera.height)
        return Camera(camera, self.body.base_from_camera, _stream(self._seed, 5), renderer)

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
            self._note_people(speed)
        self._note_contacts(free, speed)

    def _volts_of(self, pushed: Twist) -> tuple[float, float]:
        """What the wheels would have to be driven by to turn as they are pushed."""
        return volts_from_twist(self.settings.plant, self.body.track, pushed)

    def _stick_volts(self) -> tuple[float, float]:
        return volts_from_joystick(self.settings.plant, self.rider.forward, self.rider.turn)

    def _step_board(self, board: HostBoard) -> None:
        """The board lives until now; what it leaves on the lines drives the chair from now on."""
        forward, turn = (round(1000.0 * volts) for volts in self._stick_volts())
        inputs = replace(self.around_board, joystick_forward_mv=forward, joystick_turn_mv=turn)
        lines = self.lines = board.step(self.now_ns // 1_000_000, inputs)
        self._board_volts = lines.forward_mv / 1000.0, lines.turn_mv / 1000.0

    def _sense(self, messages: list[SensorMessage]) -> None:
        """Add what the sensors say after a step."""
        now_ns, chair, settings = self.now_ns, self._chair, self.settings
        if self._is_due(settings.imu.rate_hz):
            messages.append(self._imu.sample(now_ns, chair.specific_force, chair.angular_rate))
        if self._is_due(settings.wheels_hz):
            messages.append(WheelTicks(now_ns, *self._ticks()))
        if self._is_due(settings.sonar.rate_hz):
            messages.append(self._sonars.read(self._sonar_scenery, chair.pose, self._people_now, now_ns))
        leaning = Leaning(self._terrain, chair.pose3) if self._terrain is not None else None
        scan = self._lidar.step(self._scenery, chair.pose, self._people_now, now_ns, leaning)
        if scan is not None:
            messages.append(scan)
        if self._camera is not None and self._is_due(settings.camera.rate_hz):
            messages.append(self._camera.frame(now_ns, chair.pose3, chair.twist, self._people_now))

    def _is_due(self, rate_hz: float) -> bool:
        """Whether a sample falls into the step that has just ended; half a nanosecond stands against rounding."""
        if rate_hz == 0.0:
            return False
        before, now = (self.now_ns - self._step_ns + 0.5) * rate_hz * 1e-9, (self.now_ns + 0.5) * rate_hz * 1e-9
        return math.floor(now) > math.floor(before)

    def _ticks(self) -> tuple[int, int]:
        """Encoder counts, which go on when the chair is put into another world."""
        left, right = (sum(pair) for pair in zip(self._ticks_before, self._chair.ticks, strict=True))
        return (left + 2**31) % 2**32 - 2**31, (right + 2**31) % 2**32 - 2**31

    def _note_contacts(self, free: bool, speed: float) -> None:
        """A contact is reported as it begins, at the `speed` before it, and ends once the chair is well away again."""
        pose = self._chair.pose
        if self._begins(ContactKind.SOLID, not free, self.clearance):
            self._report(ContactKind.SOLID, nearest_point(self._solid, self.body, pose), speed)
        if self._begins(ContactKind.FALL, not self._chair.upright, lambda: math.inf):
            self._report(ContactKind.FALL, (pose.x, pose.y), speed)

    def _note_people(self, speed: float) -> None:
        distance, x, y = nearest_person(self.body, self._chair.pose, self._people_now)
        if self._begins(ContactKind.PERSON, distance < 0.5 * CONTACT_GAP, lambda: distance):
            self._report(ContactKind.PERSON, (x, y), speed)

    def _begins(self, kind: ContactKind, touches: bool, distance: Callable[[], float]) -> bool:
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
        return MujocoChair(world, body, settings.plant, settings.mujoco, rng, pose)
    return KinematicChair(body, settings.plant, rng, pose)


def _stream(seed: int, sensor: int) -> np.random.Generator:
    """Its own random stream for each part, so that changing one leaves the others' bytes alone."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(sensor,)))
