"""`waychair map-all`: many recordings at once, each in a process of its own."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from waychair.cli.options.arguments import BadArgument, NonEmptyPath, PositiveInt
from waychair.cli.options.recording_options import RecordingOptions

if TYPE_CHECKING:
    from waychair.offline.many.bags import Bag
    from waychair.offline.many.cluster import SharedFolder
    from waychair.offline.many.outcomes import Outcome
    from waychair.offline.many.pools import Pool

AS_RECORDED = RecordingOptions()

PROCESS = "waychair.cli.mapping.bag_process"
"""The module that maps one recording."""

_MULTIPLES = {"": 1, "K": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}
_LEAST_MEMORY = 200_000_000  # bytes; the program alone takes more than half of it


def map_all_command(
    recordings: tuple[Path, ...],
    /,
    *,
    out: Annotated[NonEmptyPath, Parameter(name=["--out", "-o"])],
    jobs: PositiveInt | None = None,
    cluster: str | None = None,
    shared: tuple[str, ...] = (),
    per_bag_memory: str = "4G",
    retry_failed: bool = False,
    reading: RecordingOptions = AS_RECORDED,
    config: NonEmptyPath | None = None,
    quiet: bool = False,
) -> None:
    """Make maps of many recordings at once, each in a process of its own.

    Each map is made as `waychair map` makes it, in DIR/NAME/; NAME is the recording's file name without suffixes. One that
    cannot be mapped stops none of the others. index.html shows all of them, report.json tells state, reason, time, memory
    and computer of each.

    After Ctrl-C, a crash or a power cut the same command goes on: finished maps are kept, begun ones resume. A recording
    that changed since, or other options, are mapped anew. Exits with 1 if any recording has no map.

    Parameters
    ----------
    recordings
        Logs, bags and picture folders as for `waychair map`, or lists of them: .txt files with one path a line.
    out
        Folder for all maps. A folder in it that is not from this command is left alone.
    jobs
        Recordings at a time; default: one a processor core, as long as the memory suffices.
    cluster
        Address of a Dask scheduler, such as tcp://HOST:8786: its workers map the recordings. Needs the extra [cluster].
    shared
        PREFIX=PREFIX: a folder's path on this computer and on the workers; may be repeated. A worker that has no path to a
        recording is sent it, up to 2 GB.
    per_bag_memory
        Memory that one recording may need, such as 4G or 800M; one that needs more fails.
    retry_failed
        Also try again the recordings that could not be mapped in an earlier run.
    config
        YAML file with settings that differ from the defaults (see `waychair config map`).
    quiet
        Print nothing but errors.
    """
    from waychair.cli.options.messages import warn
    from waychair.cli.options.progress import told_share
    from waychair.errors import NotAllMapped
    from waychair.offline.many.bags import listed, named_bags
    from waychair.offline.many.many_maps import INDEX, MapOptions, map_many

    limit = _bytes(per_bag_memory)
    pool = _pool(jobs, cluster, shared, limit, quiet)
    bags, doubts = named_bags(listed(recordings))
    if not quiet:
        for doubt in doubts:
            warn(doubt)

    kept = 0

    def told(bag: Bag, outcome: Outcome, number: int) -> None:
        nonlocal kept
        kept += outcome.kept  # which took no time
        show((number - kept) / max(len(bags) - kept, 1))
        if not quiet:
            print(f"[{number}/{len(bags)}] {_line(outcome)}", flush=True)

    options = MapOptions(PROCESS, _words(reading), config, limit, retry_failed)
    try:
        with told_share("mapping", quiet) as show:
            maps = map_many(bags, out, options, pool, told)
    except KeyboardInterrupt as stop:
        stop.add_note(f"run the same command again to go on: finished maps are in {out}")
        raise
    if not quiet:
        print(
            f"{len(bags) - maps.failed} of {len(bags)} recordings mapped in {maps.seconds:.0f} s: {out / INDEX}",
            flush=True,
        )
    if maps.failed:
        names = [bag.name for bag in bags if not _is_done(maps.outcomes.get(bag.name))]
        first = maps.outcomes[names[0]].why if names[0] in maps.outcomes else "not begun"
        more = f"; {len(names) - 1} more in {out / INDEX}" if len(names) > 1 else ""
        raise NotAllMapped(f"{maps.failed} of {len(bags)} recordings could not be mapped: {names[0]}: {first}{more}")


def _is_done(outcome: Outcome | None) -> bool:
    return outcome is not None and outcome.state == "done"


def _line(outcome: Outcome) -> str:
    """Return the line about a recording that has ended."""
    kept = ", kept from before" if outcome.kept else ""
    cost = f"{outcome.seconds:.1f} s, {outcome.cpu_s:.1f} s of CPU, {outcome.peak_memory_mb:.0f} MB"
    if _is_done(outcome):
        return f"{outcome.name}: done{kept}, {cost} on {outcome.host}"
    return f"{outcome.name}: {outcome.state}{kept}: {outcome.why}"


def _words(reading: RecordingOptions) -> tuple[str, ...]:
    """Return the options for reading as words of a command line."""
    from dataclasses import fields

    words: list[str] = []
    for each in fields(reading):
        value = getattr(reading, each.name)
        for one in value if isinstance(value, tuple) else () if value is None else (value,):
            words.append(f"--{each.name.replace('_', '-')}={one}")
    return tuple(words)


def _bytes(text: str) -> int:
    """Return a number of bytes such as 4G.

    Raises:
        BadArgument: it is none, or too little for any recording.
    """
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([KMGT]?)i?B?", text.strip(), re.IGNORECASE)
    if found is None:
        raise BadArgument(
            f"--per-bag-memory '{text}' is no amount of memory: give a number of bytes such as 4G or 800M"
        )
    count = round(float(found[1]) * _MULTIPLES[found[2].upper()])
    if count < _LEAST_MEMORY:
        raise BadArgument(f"--per-bag-memory {text} is too little for any recording: give at least 200M")
    return count


def _pool(jobs: int | None, cluster: str | None, shared: tuple[str, ...], limit: int, quiet: bool) -> Pool:
    """Return the place where recordings are mapped.

    Raises:
        BadArgument: the options contradict each other.
    """
    from waychair.offline.many.cluster import ClusterPool
    from waychair.offline.many.pools import ProcessPool, cores, processes_of

    if cluster is None:
        if shared:
            raise BadArgument("--shared tells paths on the workers of a cluster: give --cluster too, or omit it")
        count = processes_of(limit) if jobs is None else jobs
        if jobs is None and count < cores() and not quiet:
            print(
                f"{count} at a time, as memory for {limit / 1e9:g} GB each allows (--per-bag-memory)", file=sys.stderr
            )
        return ProcessPool(count)
    if jobs is not None:
        raise BadArgument(
            "--jobs counts processes of this computer: omit it, the cluster's workers have their own number"
        )
    return ClusterPool(cluster, [_shared(each) for each in shared])


def _shared(text: str) -> SharedFolder:
    """Return the folder of `HERE=THERE`.

    Raises:
        BadArgument: it has another form.
    """
    from waychair.offline.many.cluster import SharedFolder

    here, separator, there = text.partition("=")
    if not separator or not here.startswith("/") or not there.startswith("/"):
        raise BadArgument(f"--shared '{text}' must be a path here and a path on the workers: --shared /data=/mnt/data")
    return SharedFolder(here, there)
