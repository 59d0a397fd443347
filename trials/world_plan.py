"""A picture of a world's plan, and the list of its hazards."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import rectangle, transform_points
from waychair.offline.report import COLOURS, PngFigure, draw_map, draw_outline, draw_places, new_figure, png_from_figure
from waychair.simulation.plan.world import World
from waychair.simulation.scene.scene import MATERIALS, Block, Pit, Reflection, Slope
from waychair.trials.record import route_length
from waychair.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SILL_HIGH = 0.05
"""Highest block [m] that wheels can climb, and that therefore counts as a sill."""

CHAIR_HIGH = 1.2
"""Height [m] of a chair with its rider; blocks above it are no obstacles."""

RAMP, PIT, OVERHANG, PERSON = "#009e73", "#cc0000", "#e69f00", "#aa00aa"
"""Colours in the picture."""

_DECEIVING = {Reflection.DARK: "dark surface", Reflection.GLASS: "glass", Reflection.MIRROR: "mirror"}


def hazard_names(world: World) -> tuple[str, ...]:
    """Return the hazards for lidar and wheels, and the people, each kind with its count, such as `glass (2)`."""
    counts = Counter(_hazards(world))
    return tuple(name if count == 1 else f"{name} ({count})" for name, count in sorted(counts.items()))


def world_picture(world: World) -> PngFigure:
    """Return the plan: blocks by material, ramps, pits, routes, places, the chair at the start, people's paths."""
    height, width = (count * world.grid.resolution for count in world.grid.cells.shape)
    figure, axes = new_figure(12.0, 2.0 + 10.0 * height / max(width, height))
    draw_map(axes, world.grid)
    _draw_ground(axes, world)
    _draw_blocks(axes, world)
    for k, (name, route) in enumerate(world.routes.items()):
        label = f"route {name}, {route_length(route, world.start):.0f} m"
        points = np.concatenate([[[world.start.x, world.start.y]], route])
        axes.plot(*points.T, color=COLOURS[k % len(COLOURS)], linewidth=1.2, alpha=0.8, label=label)
    for k, person in enumerate(world.people):
        axes.plot(*person.path.T, ":", color=PERSON, linewidth=1.2)
        axes.plot(*person.path[0], "o", color=PERSON, markersize=5, label=None if k else "people")
    for lift in world.lifts:
        axes.annotate(lift.name, (lift.middle.x, lift.middle.y), ha="center", va="center", color=COLOURS[0])
    draw_outline(axes, CHAIR_A.outline(), world.start, COLOURS[1])
    draw_places(axes, world.places)
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        axes.legend(handles, labels, loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=4, frameon=False)
    title = world.name if world.level in ("", world.name) else f"{world.name}, {world.level}"
    axes.set_title(title)
    return PngFigure(title, ", ".join(hazard_names(world)) or "no hazards", png_from_figure(figure))


def _hazards(world: World) -> Iterator[str]:
    for slope in world.slopes:
        if slope.high != slope.low:  # else it is a landing
            yield f"ramp 1:{slope.length / abs(slope.high - slope.low):.3g}"
    yield from ("pit" for _ in world.pits)
    for block in world.blocks:
        deceiving = _DECEIVING.get(MATERIALS[block.material].reflection)
        if deceiving is not None:
            yield deceiving
        if 0.0 < block.high <= SILL_HIGH:
            yield f"sill of {block.high * 100:.2g} cm"
        elif CHAIR_A.laser_z < block.low < CHAIR_HIGH:
            yield "overhang"
    yield from (f"{person.behaviour.value} person" for person in world.people)


def _draw_ground(axes: Axes, world: World) -> None:
    """Draw slopes hatched and pits crossed out."""
    things: list[Slope | Pit] = [*world.slopes, *world.pits]
    for thing in things:
        hatch, colour = ("///", RAMP) if isinstance(thing, Slope) else ("xx", PIT)
        axes.fill(*_corners(thing).T, facecolor="none", edgecolor=colour, hatch=hatch, linewidth=0.8)


def _draw_blocks(axes: Axes, world: World) -> None:
    """Draw obstacles in their material's colour; those that the lidar's plane misses are only outlined."""
    from matplotlib.collections import PolyCollection

    in_way = [block for block in world.blocks if block.low < CHAIR_HIGH and block.high > 0.0]
    seen = [block for block in in_way if block.low <= CHAIR_A.laser_z <= block.high]
    missed = [block for block in in_way if block not in seen]
    colours = [np.sqrt(MATERIALS[block.material].colour) * 0.85 for block in seen]  # from linear, roughly
    axes.add_collection(
        PolyCollection([_corners(block) for block in seen], facecolors=colours, edgecolors="#444", linewidths=0.3)
    )
    axes.add_collection(
        PolyCollection([_corners(block) for block in missed], facecolors="none", edgecolors=OVERHANG, linewidths=1.0)
    )


def _corners(thing: Block | Slope | Pit) -> FloatArray:
    """Return the corners (4, 2) [m] in map."""
    return transform_points(thing.middle, rectangle(thing.length / 2, thing.length / 2, thing.width / 2))
