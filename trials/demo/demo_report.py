"""The demo's report: report.html, report.json, pictures, and the rows of the table in the terminal."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from waychair.files import write_json
from waychair.offline.mapping import peak_memory_mb
from waychair.offline.report import (
    COLOURS,
    PngFigure,
    Table,
    draw_map,
    draw_outline,
    draw_places,
    new_figure,
    png_from_figure,
    write_page,
    write_png,
)
from waychair.slam.graph.graph_optimisation import EdgeKind
from waychair.trials.demo.demo import Demo
from waychair.trials.drive import DriveRecord
from waychair.trials.ride import ride_row
from waychair.types import Json, Pose2

HEADER = ("place", "reached", "distance", "time", "error", "contacts", "clearance", "plans", "localised within")
IN_TERMINAL = 7
"""The number of columns that fit into 80 characters."""


def row(leg: DriveRecord) -> tuple[str, ...]:
    """Return one drive as text, in the order of `HEADER`."""
    return (
        leg.place,
        "yes" if leg.reached else f"no: {leg.reason}",
        f"{leg.distance_m:.1f} m",
        f"{leg.duration_s:.0f} s",
        f"{100 * leg.error_m:.0f} cm, {np.degrees(leg.error_rad):.1f} deg",
        f"{leg.contacts}",
        f"{100 * leg.clearance.min():.0f} cm",
        f"{leg.plans}",
        f"{1000 * leg.localisation_error_m:.0f} mm",
    )


def report(demo: Demo) -> Json:
    """Return the demo's results as JSON."""
    near = demo.person_m
    return {
        "world": demo.world,
        "seed": demo.seed,
        "ate_m": round(demo.errors.rmse_m, 4),
        "ate_max_m": round(demo.errors.errors.max_m, 4),
        "loop_closures": sum(edge.kind is EdgeKind.LOOP for edge in demo.mapping.result.edges),
        "found": {
            "found": demo.localised.found,
            "s": round(demo.localised.seconds, 2),
            "m": round(demo.localised.metres, 2),
        },
        "closed_door": demo.closed,
        "goals": len(demo.legs),
        "goals_reached": demo.reached,
        "contacts": sum(leg.contacts for leg in demo.legs),
        "min_person_distance_m": round(near, 3) if np.isfinite(near) else None,
        "min_clearance_m": round(min(float(leg.clearance.min()) for leg in demo.legs), 4),
        "legs": [_leg(leg) for leg in demo.legs],
        "ride": ride_row(demo.world, demo.ride),
        "mapping": demo.mapping.report,
        "stages": {name: round(value, 3) for name, value in demo.seconds.items()},
        "peak_memory_mb": round(peak_memory_mb(), 1),
    }


def write_report(out: Path, demo: Demo) -> None:
    """Write report.json, map.png, drive.png and report.html."""
    write_json(out / "report.json", report(demo))
    pictures = (_map_picture(demo), _drive_picture(demo), _volts_picture(demo), _clearance_picture(demo))
    write_png(out / "map.png", pictures[0])
    write_png(out / "drive.png", pictures[1])
    stages = tuple((name, f"{value:.1f} s") for name, value in demo.seconds.items())
    cpu = tuple((name, f"{value:.2f} s") for name, value in demo.mapping.report["cpu_seconds"].items())
    tables = (
        Table("Goals", HEADER, tuple(row(leg) for leg in demo.legs)),
        Table("Further figures", ("figure", "value"), facts(demo)),
        Table("Comfort", ("figure", "driven", "limit"), _comfort(demo)),
        Table("Wall time per stage", ("stage", "time"), stages),
        Table("Processor time of mapping", ("stage", "time"), cpu),
    )
    lead = (
        f"A rider drove a simulated chair through {demo.world} by joystick while it made the map. A new chair on this "
        f"map localised itself and drove. {demo.reached} of {len(demo.legs)} goals reached, "
        f"{sum(leg.contacts for leg in demo.legs)} contacts, seed {demo.seed}."
    )
    write_page(out / "report.html", f"waychair demo: {demo.world}", lead, tables, pictures)


def facts(demo: Demo) -> tuple[tuple[str, str], ...]:
    """Return the demo's other results as (figure, text)."""
    found, near = demo.localised, demo.person_m
    loops = sum(edge.kind is EdgeKind.LOOP for edge in demo.mapping.result.edges)
    return (
        ("map error (ATE)", f"{1000 * demo.errors.rmse_m:.0f} mm over {demo.mapping.report['distance_m']:.0f} m"),
        ("loop closures", f"{loops}"),
        ("localised itself", f"after {found.seconds:.1f} s, {found.metres:.1f} m by joystick" if found.found else "no"),
        ("closed door", demo.closed or "none"),
        ("nearest person", f"{near:.2f} m" if np.isfinite(near) else "no people"),
    )


def _comfort(demo: Demo) -> tuple[tuple[str, str, str], ...]:
    ride, limits = demo.ride, demo.setup.chair.limiter
    return (
        ("speeding up", f"{ride.speeding_up:.2f} m/s^2", f"{limits.acceleration:.2f}"),
        ("slowing down", f"{ride.slowing_down:.2f} m/s^2", f"{limits.braking:.2f}, emergency {limits.emergency:.2f}"),
        ("sideways", f"{ride.sideways:.2f} m/s^2", f"{limits.lateral:.2f}"),
        ("jerk, 99 % of the time", f"{ride.jerk_p99:.2f} m/s^3", f"{limits.jerk:.2f}"),
        ("weighted r.m.s. (ISO 2631-1)", f"{ride.weighted_rms:.3f} m/s^2", "0.315: not uncomfortable"),
        ("hard stops", f"{ride.hard_stops}", ""),
    )


def _leg(leg: DriveRecord) -> Json:
    tick = np.quantile(leg.tick_ms, [0.5, 0.99])
    return {
        "place": leg.place,
        "reached": leg.reached,
        "reason": leg.reason,
        "error_m": round(leg.error_m, 4),
        "error_deg": round(float(np.degrees(leg.error_rad)), 3),
        "contacts": leg.contacts,
        "min_clearance_m": round(float(leg.clearance.min()), 4),
        "distance_m": round(leg.distance_m, 3),
        "duration_s": round(leg.duration_s, 3),
        "plans": leg.plans,
        "localisation_rmse_m": round(leg.localisation_error_m, 5),
        "tick_ms_median": round(float(tick[0]), 3),
        "tick_ms_p99": round(float(tick[1]), 3),
    }


def _map_picture(demo: Demo) -> PngFigure:
    result = demo.mapping.result
    figure, axes = new_figure(8, 8)
    draw_map(axes, demo.mapping.grid)
    axes.plot(*result.trajectory.poses[:, :2].T, color=COLOURS[0], linewidth=1.0, label="mapping drive")
    loops = [edge for edge in result.edges if edge.kind is EdgeKind.LOOP]
    for edge in loops:
        axes.plot(*result.key_poses[[edge.i, edge.j], :2].T, color=COLOURS[1], linewidth=0.8)
    axes.plot([], [], color=COLOURS[1], linewidth=0.8, label=f"{len(loops)} loop closures")
    axes.legend(loc="upper left", fontsize=8)
    facts = demo.mapping.report
    caption = f"{facts['frames']} scans over {facts['distance_m']:.0f} m, {facts['key_scans']} key scans."
    return PngFigure("The map", caption, png_from_figure(figure))


def _drive_picture(demo: Demo) -> PngFigure:
    figure, axes = new_figure(8, 8)
    every = np.concatenate([leg.truth[:, :2] for leg in demo.legs])
    draw_map(axes, demo.mapping.grid, np.concatenate([every - 1.5, every + 1.5]))
    outline = demo.setup.body.outline()
    for k, leg in enumerate(demo.legs):
        colour = COLOURS[k % len(COLOURS)]
        if len(leg.planned):
            axes.plot(*leg.planned[:, :2].T, color=colour, linewidth=1.0, linestyle=":")
        axes.plot(*leg.truth[:, :2].T, color=colour, linewidth=1.6, label=f"to {leg.place}")
        for pose in leg.truth[::60]:
            draw_outline(axes, outline, Pose2(*pose), colour)
    draw_places(axes, [demo.setup.places[leg.place] for leg in demo.legs])
    axes.legend(loc="upper left", fontsize=8)
    caption = "Dotted: the first planned path. Solid: the path driven, with the chair's footprint every 3 s."
    return PngFigure("Planned and driven", caption, png_from_figure(figure))


def _volts_picture(demo: Demo) -> PngFigure:
    figure, rows = new_figure(9, 5, 2, 1, sharex=True)
    for k, leg in enumerate(demo.legs):
        for axes, column in zip(rows, (0, 1), strict=True):
            axes.plot(leg.times_s, leg.volts[:, column], color=COLOURS[k % len(COLOURS)], linewidth=0.9, label=f"to {leg.place}")  # fmt: skip
    rows[0].set_ylabel("forward axis [V]")
    rows[1].set_ylabel("turn axis [V]")
    rows[1].set_xlabel("time [s]")
    rows[0].legend(fontsize=8)
    for axes in rows:
        axes.grid(alpha=0.3)
    caption = "Volts of the emulated joystick's two lines; above neutral is forward, and right."
    return PngFigure("Joystick volts", caption, png_from_figure(figure))


def _clearance_picture(demo: Demo) -> PngFigure:
    figure, axes = new_figure(9, 3)
    for k, leg in enumerate(demo.legs):
        axes.plot(leg.times_s, leg.clearance, color=COLOURS[k % len(COLOURS)], linewidth=1.0, label=f"to {leg.place}")
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("clearance [m]")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return PngFigure("Clearance", "From the chair's true footprint to the nearest wall.", png_from_figure(figure))
