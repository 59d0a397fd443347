"""Commands that make and describe maps."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def map_command(
    recording: Path,
    /,
    *,
    out: Path,
    base_from_laser: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    scan: str | None = None,
    odom: str | None = None,
    config: Path | None = None,
    quiet: bool = False,
) -> None:
    """Make a map of a recording.

    Reads CARMEN logs (.clf, .log, gzipped or not), ROS 1 bags and ROS 2 bags (folder, .mcap, .db3); writes map.yaml,
    map.pgm, trajectory.tum, graph.g2o, config.yaml and report.json.

    Parameters
    ----------
    recording
        The log or bag.
    out
        Folder for the map.
    base_from_laser
        Where the lidar is mounted, X,Y,THETA in metres and radians; for a CARMEN log it also makes the robot's own
        pose the odometry (without it the base is the laser).
    scan
        Topic of the laser scans in a bag.
    odom
        Topic of the odometry in a bag.
    config
        YAML file with settings that differ from the defaults (see `waychair config`).
    quiet
        Print nothing but errors.
    """
    from rich.console import Console
    from rich.progress import Progress

    from waychair import config as configuration
    from waychair.cli.arguments import pose_from_text
    from waychair.recording import read_recording
    from waychair.runtime.mapping import MappingSettings, map_recording, save_mapping

    settings = MappingSettings() if config is None else configuration.load(MappingSettings, config)
    mount = None if base_from_laser is None else pose_from_text(base_from_laser, "--base-from-laser")
    console = Console(file=sys.stderr, quiet=quiet)
    with Progress(console=console, transient=True, disable=quiet) as bar:
        reading = bar.add_task("reading", total=1.0)
        log = read_recording(
            recording,
            base_from_laser=mount,
            scan_topic=scan,
            odom_topic=odom,
            progress=lambda share: bar.update(reading, completed=share),
        )
        for warning in log.warnings:
            console.print(f"warning: {warning}", markup=False, highlight=False)
        mapping_task = bar.add_task("mapping", total=1.0)
        mapping = map_recording(log, settings, lambda share: bar.update(mapping_task, completed=share))
        save_mapping(out, mapping, settings)
    if not quiet:
        report = mapping.report
        print(
            f"{report['frames']} scans over {report['distance_m']:.0f} m, {report['key_scans']} key scans, "
            f"{report['edges']['loop']} loop closures, {report['grid']['known_m2']:.0f} m2 known, "
            f"{report['cpu_seconds']['total']:.1f} s of CPU: {out}/map.yaml"
        )


def places_command(
    *,
    map: Path,
    add: Annotated[tuple[str, str] | None, Parameter(allow_leading_hyphen=True)] = None,
) -> None:
    """List the named places of a map, or add one.

    Parameters
    ----------
    map
        Map folder or its map.yaml.
    add
        NAME X,Y,YAW: a place to add, in metres and radians in the map.
    """
    from waychair.cli.arguments import pose_from_text
    from waychair.maps.map_files import load_map
    from waychair.maps.places import add_place, check_place, load_places
    from waychair.types import Place

    grid = load_map(map)
    if add is not None:
        name, text = add
        place = Place(name, pose_from_text(text, "--add"))
        check_place(grid, place)
        add_place(map, name, place.pose, replace=True)
    places = load_places(map)
    for place in places.values():
        pose = place.pose
        print(f"{place.name}: {pose.x:.2f}, {pose.y:.2f}, {pose.theta:.2f}")
    if not places:
        print(f"no places yet; add one with: waychair places --map {map} --add NAME X,Y,YAW")
