"""`waychair journeys`: seeded journeys over the storeys of a simulated building, and their counts."""

from __future__ import annotations

from waychair.cli.options.arguments import NonNegativeInt, PositiveInt


def journeys_command(
    *,
    world: str = "hospital",
    runs: PositiveInt = 1,
    seed: NonNegativeInt = 0,
    passengers: NonNegativeInt = 3,
    imu: bool = True,
    jobs: PositiveInt | None = None,
    json: bool = False,
) -> None:
    """Let a chair travel between random places on different storeys, by lifts that move, and count how it fares.

    Parameters
    ----------
    world
        World of several levels: hospital, hospital:SEED, two_floors, or a plan's file.
    runs
        Number of journeys.
    seed
        Seed of the first journey; each has the next one.
    passengers
        People who travel by the lifts all the time.
    imu
        Whether the chair has an IMU, which feels the rides.
    jobs
        Number of processes; default one per core.
    json
        Print JSON, with a row per journey.
    """
    import json as text

    from waychair.cli.options.messages import sayer
    from waychair.trials.travel.journey_runs import run_journeys, summary
    from waychair.trials.travel.journeys import JourneyRecord

    seeds = range(seed, seed + runs)
    say = sayer(json)

    def told(done: int, record: JourneyRecord) -> None:
        way = f"{record.start} to {record.goal}"
        ends = f"arrived after {record.seconds:.0f} s" if record.arrived else f"not arrived: {record.why}"
        say(f"{done} of {runs}: {way}: {ends}")

    result = summary(run_journeys(world, seeds, passengers, imu, jobs, told), seeds)
    if json:
        print(text.dumps(result, indent=2, allow_nan=False))
        return
    print(
        f"{result['arrived']} of {result['runs']} arrived without help, {result['contacts']} contacts (below "
        f"{result['contact_below']:.3f} of the journeys with 95 % confidence), {result['near_a_moving_leaf']} entries or exits "
        f"within 2 s of a moving leaf, {result['drives_on_a_wrong_map']} drives on a wrong map, asked {result['asked']} times, "
        f"from the open door to a certain place {result['open_door_to_ok_s']} s"
    )
