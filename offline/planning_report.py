"""Figures of the harmonic planner: potential, streamlines, compared paths, and the histogram of their turns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from waychair.geometry import transform_points
from waychair.offline.report import COLOURS, PngFigure, draw_map, draw_places, new_figure, png_from_figure
from waychair.planning.harmonic.harmonic_field import LogField, streamline
from waychair.planning.route.path_turns import BIN_DEG, EVERY_M, turn_histogram
from waychair.types import OccupancyGrid, Path, Place

_LINES = 60


def potential_picture(
    grid: OccupancyGrid,
    found: LogField,
    paths: Mapping[str, Path],
    places: Sequence[Place],
    every: float = EVERY_M,
    unit: str = "m",
) -> PngFigure:
    """Return a picture of log v in colour on the map, streamlines to the goal, paths by name, and their turns.

    `every` is the distance between measured turns, in the `unit` of the paths.
    """
    figure, (axes, below) = new_figure(8, 11, 2, 1, height_ratios=[3, 1])
    draw_map(axes, grid)
    shown = np.where(np.isfinite(found.logs), found.logs, np.nan)
    height, width = np.array(shown.shape) * grid.resolution
    from matplotlib.transforms import Affine2D

    corner = grid.map_from_grid
    placed = Affine2D().rotate(corner.theta).translate(corner.x, corner.y) + axes.transData
    image = axes.imshow(shown, origin="lower", extent=(0, width, 0, height), cmap="viridis", interpolation="none")
    image.set_transform(placed)
    figure.colorbar(image, ax=axes, label="log v", shrink=0.7)
    cells = np.argwhere(np.isfinite(found.logs))
    for row, column in cells[:: max(len(cells) // _LINES, 1)]:
        line = streamline(found, np.array([column + 0.5, row + 0.5])) * grid.resolution
        axes.plot(*transform_points(corner, line).T, color="white", linewidth=0.4, alpha=0.6)
    for (name, path), colour in zip(paths.items(), COLOURS[1:], strict=False):
        axes.plot(*path.poses[:, :2].T, color=colour, linewidth=1.8, label=f"{name}, {path.length():.2f} {unit}")
        edges, counts = turn_histogram(path, every)
        below.step(edges + BIN_DEG / 2, counts, where="mid", color=colour, label=name)
    axes.set(xlabel=f"x [{unit}]", ylabel=f"y [{unit}]")
    axes.legend(loc="upper right")
    draw_places(axes, places)
    below.set(xlabel=f"turn at every {every:.2f} {unit} [deg]", ylabel="count", yscale="symlog")
    below.legend()
    lengths = ", ".join(f"{name} {path.length():.1f} {unit}" for name, path in paths.items())
    return PngFigure("Potential and paths", lengths, png_from_figure(figure))
