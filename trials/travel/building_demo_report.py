"""The report of the demo over storeys: figures, each storey's map with the journey's part on it, and the table of the journey."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.files import write_json
from waychair.maps.drawn.places import load_places
from waychair.maps.folders.map_files import load_map
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
from waychair.trials.travel.building_demo import BuildingDemo
from waychair.trials.travel.journey_runs import row_of
from waychair.types import Json, Pose2

OUTLINE_EVERY = 80
"""Ticks between two outlines of the chair in the picture: 4 s."""


def building_report(demo: BuildingDemo) -> Json:
    """Return the contents of report.json."""
    return {
        "world": demo.world,
        "seed": demo.seed,
        "lift": demo.lift,
        "storeys": {
            storey: {
                "ate_m": round(demo.errors[storey].rmse_m, 4),
                "distance_m": mapping.report["distance_m"],
                "scans": mapping.report["frames"],
            }
            for storey, mapping in demo.mappings.items()
        },
        "journey": row_of(demo.seed, demo.record),
        "stages": {name: round(value, 3) for name, value in demo.seconds.items()},
        "peak_memory_mb": round(peak_memory_mb(), 1),
    }


def write_building_report(out: Path, demo: BuildingDemo) -> None:
    """Write report.json, journey.png and report.html."""
    write_json(out / "report.json", building_report(demo))
    picture = _picture(demo)
    write_png(out / "journey.png", picture)
    stages = tuple((name, f"{value:.1f} s") for name, value in demo.seconds.items())
    phases = tuple((name, f"{value:.1f} s") for name, value in demo.record.phases.items())
    tables = (
        Table("The journey", ("figure", "value"), building_facts(demo)),
        Table("Time in each phase of the journey", ("phase", "time"), phases),
        Table("Wall time per stage", ("stage", "time"), stages),
    )
    lead = (
        f"A rider drove a simulated chair through two storeys of {demo.world} by joystick while it mapped them. Lift {demo.lift} "
        f"joins the maps. The chair drove from {demo.record.start} to {demo.record.goal}. {demo.record.why}"
    )
    write_page(out / "report.html", f"waychair demo: {demo.world}", lead, tables, (picture,))


def building_facts(demo: BuildingDemo) -> tuple[tuple[str, str], ...]:
    """Return the demo's results as (figure, text)."""
    record = demo.record
    maps = tuple(
        (
            f"map error on {storey} (ATE)",
            f"{1000 * demo.errors[storey].rmse_m:.0f} mm over {mapping.report['distance_m']:.0f} m",
        )
        for storey, mapping in demo.mappings.items()
    )
    ok = f"{max(record.ok_s):.1f} s" if record.ok_s else "never"
    return (
        *maps,
        (
            "arrived",
            f"after {record.seconds:.0f} s, {100 * record.error_m:.0f} cm off" if record.arrived else record.why,
        ),
        ("rides", f"{record.rides}"),
        ("contacts", f"{record.contacts}"),
        ("from the open door to a certain place", ok),
        ("crossings near a moving leaf", f"{record.near_leaf}"),
        ("driven on a wrong map", f"{record.wrong_map_s:.1f} s"),
    )


def _picture(demo: BuildingDemo) -> PngFigure:
    storeys = demo.building.hgraph.storeys
    figure, rows = new_figure(12, 5, 1, len(storeys), squeeze=False)
    (start, begin), (goal, end) = (text.split("/", 1) for text in (demo.record.start, demo.record.goal))
    for k, (axes, storey) in enumerate(zip(rows[0], storeys, strict=True)):
        folder = demo.building.map_folder(storey.id)
        assert folder is not None
        draw_map(axes, load_map(folder))
        places, driven = load_places(folder), demo.driven[storey.id]
        if len(driven):
            axes.plot(*driven[:, :2].T, color=COLOURS[k], linewidth=1.8)
            for pose in driven[::OUTLINE_EVERY]:
                draw_outline(axes, CHAIR_A.outline(), Pose2(*pose), COLOURS[k])
        for stop in demo.building.hgraph.lifts[demo.lift].stops:
            if stop.storey == storey.id and stop.cabin is not None:
                axes.annotate(f"lift {demo.lift}", (stop.cabin.x, stop.cabin.y), fontsize=8, ha="center", va="center")
        ends = [name for there, name in ((start, begin), (goal, end)) if there == storey.id]
        draw_places(axes, [places[name] for name in ends if name in places])
        axes.set_title(storey.name)
    distance = sum(float(np.hypot(*np.diff(each[:, :2], axis=0).T).sum()) for each in demo.driven.values())
    caption = f"{distance:.0f} m from {demo.record.start} to {demo.record.goal}, with the chair's footprint every 4 s."
    return PngFigure("Both maps and the journey", caption, png_from_figure(figure))
