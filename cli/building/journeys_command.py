"""`waychair journeys`: seeded journeys over the storeys of a simulated building, and their counts."""

from __future__ import annotations

from pathlib import Path

from waychair.cli.options.arguments import NonNegativeInt, PositiveInt


def journeys_command(
    *,
    world: str = "hospital",
    runs: PositiveInt = 1,
    seed: NonNegativeInt = 0,
    passengers: NonNegativeInt = 3,
    imu: bool = True,
    jobs: PositiveInt | None = None,
    keep: Path | None = None,
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
    keep
        File to which each journey is added as it ends, a line of JSON each. Journeys that are in it are not run again.
    json
        Print JSON at the end, with a row per journey.
    """
    import json as text

    from waychair.cli.options.messages import sayer
    from waychair.cli.options.progress import prepare_kernels, told_share
    from waychair.planning.warm_up import warm_up
    from waychair.trials.travel.journey_runs import keep_record, kept_records, run_journeys, summary
    from waychair.trials.travel.journeys import JourneyRecord

    seeds, say = range(seed, seed + runs), sayer(json)
    records = {} if keep is None else kept_records(keep, world, passengers, imu)
    records = {each: record for each, record in records.items() if each in seeds}
    if records:
        say(f"{len(records)} of {runs} journeys are in {keep}")

    def told(ended: int, record: JourneyRecord) -> None:
        records[ended] = record
        if keep is not None:
            keep_record(keep, world, passengers, imu, ended, record)
        way = f"seed {ended}, {record.start} to {record.goal}"
        ends = f"arrived after {record.seconds:.0f} s" if record.arrived else f"not arrived: {record.why}"
        say(f"{len(records)} of {runs}: {way}: {ends}")
        show(1.0 - (runs - len(records)) / max(len(missing), 1))

    missing = [each for each in seeds if each not in records]
    prepare_kernels()
    with told_share("travelling") as show:
        if missing:
            warm_up()  # here, where it is told, and not by each of the worker processes
        run_journeys(world, missing, passengers, imu, jobs, told)
    result = summary([records[each] for each in seeds], seeds)
    if json:
        print(text.dumps(result, indent=2, allow_nan=False))
        return
    print(
        f"{result['arrived']} of {result['runs']} arrived without help, {result['contacts']} contacts (below "
        f"{result['contact_below']:.3f} of the journeys with 95 % confidence), {result['near_a_moving_leaf']} entries or exits "
        f"within 2 s of a moving leaf, {result['drives_on_a_wrong_map']} drives on a wrong map, asked {result['asked']} times, "
        f"from the open door to a certain place {result['open_door_to_ok_s']} s"
    )
