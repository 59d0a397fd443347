"""`waychair guide`: a simulated driver without sight is led to a place by the glove."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from waychair.cli.options.arguments import BadArgument, Minutes, NonNegativeInt, body_named

if TYPE_CHECKING:
    from waychair.control.haptics.next_door import DoorSide
    from waychair.trials.guiding.guided import GuidedRecord


def guide_command(
    *,
    world: Annotated[str, Parameter(name=["--world", "--sim"])],
    goal: Annotated[str, Parameter(allow_leading_hyphen=True)],
    start: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    rider: Literal["blind", "stick"] = "blind",
    level: Literal["inform", "guard", "guide"] | None = None,
    sensors: Literal["usual", "paper"] = "usual",
    driver: str = "default",
    body: str = "A",
    layout: str = "glove_3x3",
    people: NonNegativeInt = 0,
    seed: NonNegativeInt = 0,
    minutes: Minutes = 10.0,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
    sound: Path | None = None,
    quiet: bool = False,
) -> None:
    """Lead a simulated driver without sight to a place, by the motors of a glove.

    The driver feels the motors and nothing else; the programs of the chair's board and of the glove run as shipped. A
    simulated driver shows faults of the guidance, never that it helps a person.

    Parameters
    ----------
    world
        Name of a world (see `waychair worlds`), or a plan's .yaml file.
    goal
        Name of a place, or X,Y or X,Y,YAW in metres and radians; or door-left, door-ahead or door-right: the next door that leads
        to that side of the chair, found on the way, without a map.
    start
        The chair's start, in the same form; default the world's.
    rider
        blind: feels the glove; stick: sees, and steers along the same steps, for comparison.
    level
        inform: advice alone; guard: the stick is held within caps, and nobody says anything; guide: both. Default guide; inform
        with the paper's sensors, by which nobody can guard.
    sensors
        usual: lidar and map; paper: eight sonars and a camera with a laser's line on servos, without lidar and map.
    driver
        default, waist, older, second_task, noisy_hand, sure_85, sure_70, warnings_90 or fast_swivel; or one who cannot be
        led: at_random, opposite, idle.
    body
        The chair's body: A, B, A_mid, A_front or robot.
    layout
        Motors on the body: glove_3x3, belt_8, bracelets or arm_rest_4.
    people
        Number of people who walk about.
    seed
        Seed of the chair, its sensors, the driver and the people.
    minutes
        Time limit of the simulated drive.
    out
        Folder for the report (guided.json) and the symbols over time (symbols.csv).
    sound
        WAV file for all that the rider would hear, speech and tones, at its time in the drive.
    quiet
        Print nothing but errors.
    """
    from waychair.cli.options.progress import prepare_kernels, told_time
    from waychair.cli.planning import place_among
    from waychair.simulation.plan.world import load_world
    from waychair.trials.guiding.guided import NO_GUARD, GuidedSensors, GuidedSetup, RiderTold, guided_drive
    from waychair.trials.guiding.guided_report import save_report, summary
    from waychair.trials.guiding.sound_track import SoundTrack
    from waychair.trials.navigate import world_with_people
    from waychair.types import HelpLevel

    plan = load_world(world)
    own, owner = {place.name: place for place in plan.places}, f"the world '{plan.name}'"
    door = door_goals().get(goal)
    to = place_among(own, goal, "--goal", owner) if door is None else door
    begin = plan.start if start is None else place_among(own, start, "--start", owner).pose
    chair = body_named(body)
    if sound is not None and rider == "stick":
        raise BadArgument("a rider who sees the steps hears nothing: leave --sound or --rider stick out")
    if rider == "stick" and (door is not None or sensors == "paper"):
        raise BadArgument("a rider who sees steers by the map: give a place as --goal, and leave --sensors out")
    if sensors == "paper" and level in ("guard", "guide"):
        raise BadArgument(f"--level {level}: {NO_GUARD}")
    track = None if sound is None else SoundTrack()
    setup = GuidedSetup(
        world=world_with_people(plan, begin, people, seed),
        grid=plan.grid,
        body=chair,
        driver=driver,
        level=HelpLevel(level or ("inform" if sensors == "paper" else "guide")),
        layout=layout,
        seed=seed,
        told=RiderTold.SEES if rider == "stick" else RiderTold.GUIDED,
        sensors=GuidedSensors(sensors) if door is None or sensors == "paper" else GuidedSensors.WITH_DOORWAYS,
        track=track,
    )
    prepare_kernels(quiet)
    with told_time("leading the rider", quiet) as tell:
        record = guided_drive(setup, to, 60.0 * minutes, lambda metres: tell(f"{metres:.0f} m on the way to {goal}"))
    if out is not None:
        save_report(record, setup, out)
    if track is not None and sound is not None:
        track.save(sound)
    if not quiet:
        print(summary(record, setup))
    _fail_unless_reached(record, goal)


def door_goals() -> dict[str, DoorSide]:
    """Return the next doors by their names as a goal."""
    from waychair.control.haptics.next_door import DoorSide

    return {f"door-{side.value}": side for side in DoorSide}


def _fail_unless_reached(record: GuidedRecord, goal: str) -> None:
    if not record.reached:
        print(f"waychair: {goal} was not reached: {record.reason}", file=sys.stderr)
        sys.exit(1)
