"""Hazards that may be missing on the map or invisible to the lidar: drop-offs, glass, people who move or step out.

A `Hazard` is a world, the chair's map of it, its zones and sensors, and the goals. `run_hazard` drives the complete
chair there and reports the contacts and their causes.

Protection from a drop-off: no lidar sees one, and no sensor looks down behind or beside the chair. The camera sees the
floor from about 1.3 m before the footrest, so it finds a drop-off ahead; beside or behind the chair knows it only from
memory. A keep-out zone or a drop-off on the map protects in all three cases.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from evaluation.scenes.tight_places import TightScene, map_of
from waychair.calibration.chair_body import CHAIR_A, ROBOT, ChairBody
from waychair.calibration.fits.dac import DEFAULT
from waychair.control.drive.navigator import NavigatorSettings
from waychair.control.drive.recovery import RecoverySettings
from waychair.control.safety.arc_clearance import MonitorSettings
from waychair.control.speed.limiter import LimiterSettings
from waychair.geometry import rectangle, transform_points
from waychair.maps.drawn.zones import Rule, Zone
from waychair.maps.grid.cells import occupied_points, points_from_cells
from waychair.maps.grid.distance_field import distance_field
from waychair.planning.body.personal_space import LegClearanceSettings, PersonalSpaceSettings
from waychair.planning.seen.person_tracks import TrackSettings
from waychair.planning.window.motion_limits import DwaSettings
from waychair.runtime.chair import ChairSettings
from waychair.simulation.plan.floor_plan import FloorPlan, PlanPit, PlanWall, walls_round
from waychair.simulation.plan.plan_blocks import fill_rectangle
from waychair.simulation.plan.world import World, load_world, world_from_plan
from waychair.simulation.scene.contact import HIGHEST, LOWEST, Contact, ContactKind, clearance, solid_from_blocks
from waychair.simulation.scene.scene import MATERIALS, Block, PersonBehaviour, PersonPlan, Pit, Reflection
from waychair.simulation.sensors.lidar import LidarSettings
from waychair.simulation.simulator import SimulatorSettings
from waychair.topics import SONAR
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import DriveSetup, drive_to_places
from waychair.trials.ride import RecordingSimulator, Ride, TrueMotion, ride_of
from waychair.types import FloatArray, OccupancyGrid, Place, Pose2


class Protection(enum.Enum):
    """The chair's protection from drop-offs or glass that are missing in a lidar's map."""

    CAMERA = "camera"
    SONAR = "sonar"
    ZONE = "zone"
    MAP = "map"
    NOTHING = "nothing"


class ContactCause(enum.Enum):
    """The kind of a contact: the object that the chair touched, or a person who walked into the chair."""

    EDGE = "edge"
    GLASS = "glass"
    PERSON = "person"
    SOLID = "solid"
    BUMPED = "bumped"  # a person walked into the chair, which did not move towards the person


@dataclass(frozen=True, slots=True)
class Hazard:
    """A world with the chair's start, the chair's map, and the goals, in order. `scanned`: the part of the map that scans show."""

    name: str
    world: World
    grid: OccupancyGrid
    goals: tuple[Place, ...]
    body: ChairBody = CHAIR_A
    zones: tuple[Zone, ...] = ()
    sensors: SimulatorSettings = field(default_factory=SimulatorSettings)
    chair: ChairSettings = field(default_factory=ChairSettings)
    scanned: OccupancyGrid | None = None


@dataclass(frozen=True, slots=True)
class HazardResult:
    """The result of a run.

    `seconds`, `distance_m` (distance driven) [m] and `plans` are sums over all legs. `drop_off_m`, `person_m`: least distances
    [m] to a drop-off and, while the chair moves, to a person.
    """

    scene: str
    seed: int
    reached: bool
    reason: str
    seconds: float
    contacts: tuple[tuple[ContactCause, float], ...]
    drop_off_m: float
    person_m: float
    ride: Ride
    plans: int
    distance_m: float

    def count(self, *kinds: ContactCause) -> int:
        """Return the number of contacts of these kinds."""
        return sum(kind in kinds for kind, _ in self.contacts)


MOVING_SPEED = 0.02
"""A chair, or the nearest point of its footprint, stands below this speed [m/s]."""


def run_hazard(hazard: Hazard, seed: int, time_limit_s: float = 150.0) -> HazardResult:
    """Drive a simulated chair of this seed to the hazard's goals, for at most `time_limit_s` each.

    Raises:
        BoardBuildError: the firmware cannot be built: no C compiler.
    """
    plant = replace(hazard.sensors, plant=randomised_settings(seed).plant)
    simulator = RecordingSimulator(hazard.world, hazard.body, plant, seed)
    legs = drive_to_places(setup_of(hazard), simulator, [goal.name for goal in hazard.goals], time_limit_s)
    motion = simulator.motion()
    failed = next((leg for leg in legs if not leg.reached), None)
    return HazardResult(
        scene=hazard.name,
        seed=seed,
        reached=failed is None,
        reason="" if failed is None else f"{failed.place}: {failed.reason}",
        seconds=sum(leg.duration_s for leg in legs),
        contacts=tuple(
            (contact_cause(contact, hazard.world, hazard.body, motion), contact.speed)
            for contact in simulator.contact_reports
        ),
        drop_off_m=least_to_drop_off(hazard.world, hazard.body, motion),
        person_m=least_to_people(motion),
        ride=ride_of(motion),
        plans=sum(leg.plans for leg in legs),
        distance_m=sum(leg.distance_m for leg in legs),
    )


def setup_of(hazard: Hazard) -> DriveSetup:
    """Return the setting of the drive as the chair knows it."""
    places = {goal.name: goal for goal in hazard.goals}
    return DriveSetup(
        grid=hazard.grid,
        places=places,
        body=hazard.body,
        calibration=DEFAULT,
        chair=hazard.chair,
        zones=hazard.zones,
        scanned=hazard.scanned,
    )


def contact_cause(contact: Contact, world: World, body: ChairBody, motion: TrueMotion) -> ContactCause:
    """Classify a contact. The chair hit a person if the chair's footprint moved towards this person."""
    at = np.array([contact.x, contact.y])
    if contact.kind is ContactKind.FALL or any(_contains(pit, at) for pit in world.pits):
        return ContactCause.EDGE
    if contact.kind is ContactKind.PERSON:
        return (
            ContactCause.PERSON
            if closing_speed(at, body, motion, contact.stamp_ns) > MOVING_SPEED
            else ContactCause.BUMPED
        )
    return (
        ContactCause.GLASS
        if any(_contains(pane, at) for pane in world.blocks if _is_glass(pane))
        else ContactCause.SOLID
    )


def closing_speed(at: FloatArray, body: ChairBody, motion: TrueMotion, stamp_ns: int) -> float:
    """Return the speed [m/s] at which the footprint's point nearest to `at` (2,) [m, map] moves towards it."""
    pose, twist = motion.at(stamp_ns)
    x, y = transform_points(pose.inverse(), at[None])[0].tolist()
    near = np.clip(x, -body.rear, body.front), np.clip(y, -body.width / 2, body.width / 2)
    away = np.array([x - near[0], y - near[1]])
    distance = float(np.hypot(*away))
    if distance == 0.0:  # the point lies within the footprint
        away, distance = np.array([x, y]), max(math.hypot(x, y), 1e-9)
    return float((twist.v - twist.omega * near[1]) * away[0] + twist.omega * near[0] * away[1]) / distance


def least_to_drop_off(world: World, body: ChairBody, motion: TrueMotion) -> float:
    """Return the least distance [m] from the footprint (wheels included) to a drop-off; +inf without any."""
    if not world.pits:
        return math.inf
    edges = solid_from_blocks((), world.pits)
    return min(clearance(edges, body, Pose2(*pose)) for pose in motion.poses[::5].tolist())


def least_to_people(motion: TrueMotion) -> float:
    """Return the least distance [m] to a person while the chair moves; +inf without people or motion."""
    moves = np.abs(motion.twists).max(axis=1) > MOVING_SPEED
    return float(motion.people[moves].min(initial=math.inf))


def hazard_of_scene(scene: TightScene) -> Hazard:
    """Return a tight scene as a hazard, so that it is driven and scored alike."""
    return Hazard(
        name=scene.name,
        world=scene.world,
        grid=map_of(scene.world),
        goals=(scene.goal,),
        body=scene.body,
        chair=scene.chair,
    )


# --- drop-offs and glass ------------------------------------------------------------------------------------------


def drop_off_ahead(protection: Protection, seed: int) -> Hazard:
    """Return a hall with a pit across it and a bridge of 1.5 m on one side; the goal lies straight behind the pit."""
    rng = np.random.default_rng(seed)
    side = float(rng.choice([-1.0, 1.0]))
    middle = 1.7 + 0.75 * side
    plan = hall_plan((8.5, 3.4), [PlanPit((4.9, middle), (1.0, 1.9))])
    start = Pose2(rng.uniform(0.8, 1.4), middle + rng.uniform(-0.3, 0.3), rng.uniform(-0.2, 0.2))
    goal = Place("beyond", Pose2(7.2, middle, 0.0))
    return _protected(f"edge ahead, {protection.value}", plan, start, (goal,), protection)


def drop_off_beside(protection: Protection, seed: int) -> Hazard:
    """Return a corridor that leads into a gallery of 1.9 m: the chair turns round the corner of a stairwell beside it.

    A chair that leaves the corridor sees the drop-off ahead before it is beside it.
    """
    rng = np.random.default_rng(seed)
    corridor = [PlanWall(start=(1.9, 0.0), end=(1.9, 2.9)), PlanWall(start=(1.9, 2.9), end=(6.4, 2.9))]
    plan = hall_plan((6.4, 6.8), [PlanPit((4.15, 3.9), (4.5, 2.0))], corridor)
    start = Pose2(rng.uniform(0.75, 1.1), rng.uniform(0.6, 0.9), math.pi / 2 + rng.uniform(-0.1, 0.1))
    return _protected(
        f"edge beside, {protection.value}", plan, start, (Place("round", Pose2(5.2, 5.8, 0.0)),), protection
    )


def drop_off_behind(protection: Protection, seed: int) -> Hazard:
    """Return a booth opposite a stairwell: the chair drives in and has to back out, towards the drop-off."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(4.0, 5.0)
    walls = [
        PlanWall(start=(x - 0.55, 3.0), end=(x - 0.55, 4.2)),
        PlanWall(start=(x + 0.55, 3.0), end=(x + 0.55, 4.2)),
        PlanWall(start=(0.0, 3.0), end=(x - 0.55, 3.0)),
        PlanWall(start=(x + 0.55, 3.0), end=(8.0, 3.0)),
    ]
    plan = hall_plan((8.0, 4.2), [PlanPit((5.0, 0.65), (4.0, 1.3))], walls)
    start = Pose2(rng.uniform(0.8, 1.2), rng.uniform(1.8, 2.1), rng.uniform(-0.2, 0.2))
    booth = Place("booth", Pose2(x, 3.25, math.pi / 2), tolerance_m=0.15)
    out = Place("out", Pose2(1.0, 2.0, math.pi))
    return _protected(f"edge behind, {protection.value}", plan, start, (booth, out), protection)


DROP_OFFS = {"ahead": drop_off_ahead, "beside": drop_off_beside, "behind": drop_off_behind}


def glass(protection: Protection, seed: int) -> Hazard:
    """Return a room with a closed glass door, seen at some angle, as its straight exit; another door is open."""
    rng = np.random.default_rng(seed)
    world = load_world("glass_door")
    start = Pose2(rng.uniform(1.0, 3.0), rng.uniform(0.8, 2.4), rng.uniform(-0.4, 0.4))
    return _with_protection(f"glass, {protection.value}", replace(world, start=start), (world.places[0],), protection)


def map_of_lidar(world: World) -> OccupancyGrid:
    """Return the best map that a lidar can make of a world: all solid blocks, but no glass and no drop-offs."""
    grid = replace(world.grid, cells=np.zeros_like(world.grid.cells))
    for block in world.blocks:
        if block.high > LOWEST and block.low < HIGHEST and not _is_glass(block):
            fill_rectangle(grid.cells, grid, block.middle, block.length, block.width)
    return grid


ZONE_MARGIN = 0.10
"""Margin [m] of a carefully drawn keep-out zone round its object."""


def zones_round(things: Iterable[Block | Pit]) -> tuple[Zone, ...]:
    """Return keep-out zones round glass and pits."""
    return tuple(
        Zone(
            f"zone {k + 1}",
            Rule.KEEP_OUT,
            transform_points(
                thing.middle,
                rectangle(
                    thing.length / 2 + ZONE_MARGIN, thing.length / 2 + ZONE_MARGIN, thing.width / 2 + ZONE_MARGIN
                ),
            ),
        )
        for k, thing in enumerate(things)
    )


def _protected(name: str, plan: FloorPlan, start: Pose2, goals: tuple[Place, ...], protection: Protection) -> Hazard:
    return _with_protection(name, replace(world_from_plan(plan, "edge"), start=start), goals, protection)


def _with_protection(name: str, world: World, goals: tuple[Place, ...], protection: Protection) -> Hazard:
    hazard = Hazard(name, world, map_of_lidar(world), goals)
    if protection is Protection.MAP:
        return replace(hazard, grid=world.grid)
    if protection is Protection.ZONE:
        return replace(hazard, zones=zones_round([*world.pits, *filter(_is_glass, world.blocks)]))
    return replace(hazard, sensors=sensors_for(protection))


def sensors_for(protection: Protection) -> SimulatorSettings:
    """Return wheels, lidar and the protecting sensor; the camera has the lowest rate that the chair accepts."""
    bare = SimulatorSettings()
    if protection is Protection.CAMERA:
        return replace(bare, camera=replace(bare.camera, rate_hz=5.0))
    if protection is Protection.SONAR:
        return replace(bare, sonar=replace(bare.sonar, rate_hz=SONAR.rate_hz))
    return bare


def hall_plan(size: tuple[float, float], pits: Sequence[PlanPit] = (), walls: Sequence[PlanWall] = ()) -> FloorPlan:
    """Return a rectangular floor with four walls round it, and pits."""
    return FloorPlan(name="edge", size=size, start=(0.0, 0.0, 0.0), walls=[*walls_round(size), *walls], pits=[*pits])


def _is_glass(block: Block) -> bool:
    return MATERIALS[block.material].reflection is Reflection.GLASS


def _contains(thing: Block | Pit, at: FloatArray) -> bool:
    """Return whether a point (2,) [m] lies in a rectangle or on its border."""
    x, y = transform_points(thing.middle.inverse(), at[None])[0]
    return bool(abs(x) <= thing.length / 2 + _ON_EDGE and abs(y) <= thing.width / 2 + _ON_EDGE)


_ON_EDGE = 1e-3


# --- people -------------------------------------------------------------------------------------------------------


def movers(count: int, seed: int) -> Hazard:
    """Return the dynamic test of harmonic planning: a robot of 0.30 m drives 2.21 m among discs, placed by the seed.

    The discs do not avoid the robot, not even from behind. So the lidar sees all round, as on such robots.
    """
    world = load_world("movers")
    rng = np.random.default_rng(seed)
    walls = occupied_points(world.grid)
    free = np.argwhere(distance_field(world.grid).metres > _MOVER.radius + world.grid.resolution)
    points = points_from_cells(world.grid, free)
    points = points[(points > walls.min(axis=0)).all(axis=1) & (points < walls.max(axis=0)).all(axis=1)]
    points = points[np.hypot(*(points - (world.start.x, world.start.y)).T) > _CLEAR_OF_START]
    people = []
    for _ in range(count):
        at = points[rng.integers(len(points))]
        people.append(replace(_MOVER, path=at[None]))
        points = points[np.hypot(*(points - at).T) > 2 * _MOVER.radius]
    world = replace(world, people=tuple(people))
    sensors = SimulatorSettings(lidar=LidarSettings(field_of_view=6.28))
    return Hazard(
        name=f"{count} movers",
        world=world,
        grid=world.grid,
        goals=(world.places[0],),
        body=ROBOT,
        zones=(),
        sensors=sensors,
        chair=robot_settings(),
    )


def robot_settings() -> ChairSettings:
    """Return the settings of a small robot among discs of its size.

    Without a rider there are no comfort limits. A disc is as wide as its visible part, so no margin for shoulders is
    needed, and clearances scale with the robot.
    """
    return ChairSettings(
        navigator=NavigatorSettings(
            goal_wait_distance=0.6,
            recovery=RecoverySettings(patience=150.0),  # discs never stand for long
            tracks=TrackSettings(movers="robots"),
            personal_space=PersonalSpaceSettings(radius=0.2, squeezed=0.2),
            dwa=DwaSettings(alpha_jerk=30.0, clearance=0.02, people_weight=0.3),
        ),
        limiter=LimiterSettings(
            max_speed=0.5,
            max_omega=0.8,  # any faster, its corners would hit discs that drift past
            acceleration=1.0,
            braking=1.0,
            alpha=3.0,
            emergency_alpha=6.0,
            jerk=10.0,
        ),
        monitor=MonitorSettings(
            legs=LegClearanceSettings(ahead=0.12, beside=0.05, turning=0.05, ahead_after=0.10, beside_after=0.05)
        ),
    )


_MOVER = PersonPlan(PersonBehaviour.BOUNCE, np.zeros((1, 2)), speed=0.15, yields=False, radius=0.15)
_CLEAR_OF_START = 0.6


def to_the_lift(seed: int) -> Hazard:
    """Return the source paper's first drive: along the second floor's corridor to the lift, among walking people."""
    rng = np.random.default_rng(seed)
    world = load_world("second_floor")
    start = Pose2(rng.uniform(20.0, 30.0), rng.uniform(6.9, 7.3), rng.uniform(-0.3, 0.3))
    people = tuple(_started_anywhere(person, rng) for person in world.people)
    lift = next(place for place in world.places if place.name == "lift")
    return Hazard("corridor to the lift", replace(world, start=start, people=people), world.grid, (lift,))


def to_the_restroom(seed: int) -> Hazard:
    """Return the source paper's second drive: through the basement to the restroom; a person steps out of the store."""
    rng = np.random.default_rng(seed)
    world = load_world("basement")
    start = Pose2(rng.uniform(1.2, 3.0), rng.uniform(1.2, 1.6), rng.uniform(-0.3, 0.3))
    sudden = PersonPlan(
        PersonBehaviour.SUDDEN,
        np.array([[8.8, 3.4], [8.8, rng.uniform(1.0, 1.8)]]),
        speed=float(rng.uniform(0.8, 1.4)),
        trigger=float(rng.uniform(1.0, 3.0)),
    )
    people = (*(_started_anywhere(person, rng) for person in world.people), sudden)
    restroom = next(place for place in world.places if place.name == "restroom")
    return Hazard("basement to the restroom", replace(world, start=start, people=people), world.grid, (restroom,))


def _started_anywhere(person: PersonPlan, rng: np.random.Generator) -> PersonPlan:
    """Return the person with a start anywhere on the first part of the path."""
    if person.behaviour not in (PersonBehaviour.PATH, PersonBehaviour.SOCIAL):
        return person
    first, second = person.path[:2]
    return replace(
        person, path=np.concatenate([(first + rng.uniform(0.0, 0.7) * (second - first))[None], person.path[1:]])
    )
