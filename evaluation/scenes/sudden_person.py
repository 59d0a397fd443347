"""A person who suddenly appears ahead of a chair at full speed: does the chair brake in time?"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from evaluation.scenes.hazards import MOVING_SPEED, hall_plan
from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.dac import DEFAULT
from waychair.control.speed.limiter import LimiterSettings
from waychair.geometry import transform_points
from waychair.simulation.plan.world import world_from_plan
from waychair.simulation.scene.scene import PersonBehaviour, PersonPlan
from waychair.topics import COMMAND
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import DriveSetup, advance_tick, simulated_chair, start_drive
from waychair.trials.ride import RecordingSimulator, Ride, ride_of
from waychair.types import Goal, Place, Pose2

_PERSON_RADIUS = 0.25  # m
_SUDDEN_PERSON_S = 20.0  # longest run


@dataclass(frozen=True, slots=True)
class SuddenPerson:
    """The result of a run in which a person suddenly appears `ahead_m` [m] ahead of a chair at `speed` [m/s].

    `nearest_m`: least distance from the footprint to the person while the chair moved. `contact_speed` [m/s]: 0 without
    contact. `braking` [m/s^2]: mean deceleration from 80 % to 30 % of the speed, nan if the chair did not slow down so
    far. `can_brake` [m/s^2]: the emergency deceleration, or the plant's limit if that is less. `reaction_s`: time until
    the chair had lost a tenth of its speed.
    """

    seed: int
    ahead_m: float
    speed: float
    nearest_m: float
    contact_speed: float
    braking: float
    can_brake: float
    reaction_s: float
    ride: Ride


def run_sudden_person(ahead_m: float, seed: int) -> SuddenPerson:
    """Drive at the full 0.8 m/s in a wide corridor; a person suddenly stands in the chair's lane.

    `ahead_m` is the gap from the front of the footprint to the person's disc; the lidar sees the person's two legs.

    Raises:
        BoardBuildError: the firmware cannot be built: no C compiler.
    """
    rng = np.random.default_rng(seed)
    goal = Place("end", Pose2(11.0, 1.5, 0.0))
    world = replace(
        world_from_plan(hall_plan((12.5, 3.0)), "corridor"), start=Pose2(1.2, 1.5, rng.uniform(-0.05, 0.05))
    )
    simulator = RecordingSimulator(world, CHAIR_A, randomised_settings(seed), seed)
    setup = DriveSetup(world.grid, {goal.name: goal}, CHAIR_A, DEFAULT)
    appears_x, across, appeared_ns, speed = rng.uniform(4.0, 5.0), rng.uniform(-0.25, 0.25), None, 0.0
    with simulated_chair(setup, simulator) as chair:
        start_drive(simulator, chair, Goal(goal.name))
        for _ in range(round(_SUDDEN_PERSON_S * COMMAND.rate_hz)):
            messages = advance_tick(simulator, chair)
            chair.step(simulator.now_ns, messages)
            pose = simulator.truth()
            if appeared_ns is None and pose.x > appears_x:
                at = transform_points(pose, np.array([[CHAIR_A.front + ahead_m + _PERSON_RADIUS, across]]))
                simulator.populate([PersonPlan(PersonBehaviour.PATH, at, radius=_PERSON_RADIUS)])
                appeared_ns, speed = simulator.now_ns, simulator.twist().v
            elif appeared_ns is not None and abs(simulator.twist().v) < MOVING_SPEED:
                break
    can_brake = min(LimiterSettings().emergency, simulator.settings.plant.deceleration)
    return _sudden_person(
        seed=seed, ahead_m=ahead_m, speed=speed, appeared_ns=appeared_ns, can_brake=can_brake, simulator=simulator
    )


def _sudden_person(
    seed: int, ahead_m: float, speed: float, appeared_ns: int | None, can_brake: float, simulator: RecordingSimulator
) -> SuddenPerson:
    """Return the result, computed from the simulator's true motion."""
    motion = simulator.motion()
    if appeared_ns is None:  # the chair never came so far
        return SuddenPerson(
            seed=seed,
            ahead_m=ahead_m,
            speed=0.0,
            nearest_m=math.inf,
            contact_speed=0.0,
            braking=math.nan,
            can_brake=can_brake,
            reaction_s=math.nan,
            ride=ride_of(motion),
        )
    after = motion.stamps_ns >= appeared_ns
    seconds, v = (motion.stamps_ns[after] - appeared_ns) * 1e-9, motion.twists[after, 0]
    moving = v > MOVING_SPEED
    reacts, first, last = (int(np.argmax(v < share * speed)) for share in (0.9, 0.8, 0.3))
    contact_speed = next((contact.speed for contact in simulator.contact_reports), 0.0)
    return SuddenPerson(
        seed=seed,
        ahead_m=ahead_m,
        speed=speed,
        nearest_m=float(motion.people[after][moving].min(initial=math.inf)),
        contact_speed=contact_speed,
        braking=float((v[first] - v[last]) / (seconds[last] - seconds[first])) if last > first else math.nan,
        can_brake=can_brake,
        reaction_s=float(seconds[reacts]) if reacts else math.nan,
        ride=ride_of(motion),
    )
