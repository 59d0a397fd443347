"""Figures and report pages of maps and drives: one self-contained HTML file each."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from waychair.files import replacing, write_text
from waychair.geometry import transform_points
from waychair.types import UNKNOWN, FloatArray, OccupancyGrid, Path, Place, Pose2

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
"""Colours that colour-blind readers can tell apart (Okabe and Ito)."""

STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: 0.2rem; } h2 { font-size: 1.2rem; margin-top: 2rem; }
figure { margin: 1rem 0; } img { max-width: 100%; background: white; } figcaption { opacity: 0.8; }
table { border-collapse: collapse; } th, td { padding: 0.3rem 0.8rem; text-align: left; border-bottom: 1px solid #8886; }
section.warnings { border-left: 4px solid #e69f00; padding: 0.1rem 1rem; margin: 1rem 0; background: #e69f0018; }
svg { width: 100%; max-height: 85vh; } .bar { background: #0072b2; height: 0.8rem; border-radius: 2px; min-width: 1px; }
td.bars { width: 20rem; } td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
"""


@dataclass(frozen=True, slots=True)
class Table:
    """A table of text; unless it is `plain`, cells that start with a digit or a sign are set as numbers."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    plain: bool = False


@dataclass(frozen=True, slots=True)
class Bars:
    """A bar chart: name, value, and the value as text."""

    title: str
    rows: tuple[tuple[str, float, str], ...]


@dataclass(frozen=True, slots=True)
class SvgFigure:
    """An SVG element with title and caption."""

    title: str
    caption: str
    svg: str


@dataclass(frozen=True, slots=True)
class PngFigure:
    """A PNG with title and caption."""

    title: str
    caption: str
    png: bytes


def new_figure(width: float, height: float, rows: int = 1, columns: int = 1, **kwargs: Any) -> tuple[Figure, Any]:
    """Return an empty matplotlib figure of a size in inches, and its axes; needs no display."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=110, layout="constrained")
    return figure, figure.subplots(rows, columns, **kwargs)


def png_from_figure(figure: Figure) -> bytes:
    """Return the figure as a PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", bbox_inches="tight", pad_inches=0.1)
    return buffer.getvalue()


def draw_map(axes: Axes, grid: OccupancyGrid, around: FloatArray | None = None) -> None:
    """Draw the grid in metres: white free, black occupied, grey unknown; cropped to its known part or points (N, 2)."""
    shades = np.select([grid.cells == UNKNOWN, grid.cells >= 65], [0.82, 0.0], 1.0)
    height, width = np.array(grid.cells.shape) * grid.resolution
    corner = grid.map_from_grid
    image = axes.imshow(
        shades, cmap="gray", vmin=0, vmax=1, origin="lower", extent=(0, width, 0, height), interpolation="none"
    )
    from matplotlib.transforms import Affine2D

    placed = Affine2D().rotate(corner.theta).translate(corner.x, corner.y)
    image.set_transform(placed + axes.transData)
    if around is None:
        known = np.argwhere(grid.cells != UNKNOWN)[:, ::-1].astype(np.float64) * grid.resolution
        around = transform_points(corner, known) if len(known) else np.array([[0.0, 0.0], [width, height]])
    low, high = around.min(axis=0) - 1.0, around.max(axis=0) + 1.0
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")


def draw_places(axes: Axes, places: Sequence[Place]) -> None:
    """Draw each place as a dot with its name and an arrow for its heading."""
    for place in places:
        pose = place.pose
        tip = pose @ Pose2(0.8, 0.0, 0.0)
        axes.annotate("", (tip.x, tip.y), (pose.x, pose.y), arrowprops={"arrowstyle": "-|>", "color": "#333"})
        axes.plot(pose.x, pose.y, "o", color="#333", markersize=5)
        axes.annotate(
            place.name, (pose.x, pose.y), xytext=(6, 6), textcoords="offset points", fontsize=9,
            bbox={"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": "#999", "alpha": 0.85},
        )  # fmt: skip


def draw_outline(axes: Axes, outline: FloatArray, pose: Pose2, colour: str) -> None:
    """Draw a chair's footprint (4, 2) at a pose."""
    corners = transform_points(pose, np.concatenate([outline, outline[:1]]))
    axes.plot(corners[:, 0], corners[:, 1], color=colour, linewidth=1.0)


def path_picture(grid: OccupancyGrid, path: Path, places: Sequence[Place]) -> PngFigure:
    """Return a picture of a planned path on its map."""
    figure, axes = new_figure(8, 8)
    draw_map(axes, grid)
    axes.plot(*path.poses[:, :2].T, color=COLOURS[1], linewidth=1.6)
    draw_places(axes, places)
    return PngFigure("The path", f"{path.length():.1f} m", png_from_figure(figure))


def write_page(
    path: FilePath,
    title: str,
    lead: str,
    tables: Sequence[Table | Bars],
    pictures: Sequence[PngFigure | SvgFigure],
    warnings: Sequence[str] = (),
) -> None:
    """Write one HTML page with everything inside it: drawings first, then tables, then pictures."""
    parts = [f"<h1>{html.escape(title)}</h1>", f"<p>{html.escape(lead)}</p>"]
    if warnings:
        items = "".join(f"<li>{html.escape(warning)}</li>" for warning in warnings)
        parts.append(f'<section class="warnings"><h2>Warnings</h2><ul>{items}</ul></section>')
    parts += [_drawing(drawing) for drawing in pictures if isinstance(drawing, SvgFigure)]
    parts += [_table(table) if isinstance(table, Table) else _bars(table) for table in tables]
    parts += [_picture(picture) for picture in pictures if isinstance(picture, PngFigure)]
    head = (
        f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{html.escape(title)}</title>'
    )
    body = "\n".join(parts)
    write_text(
        path,
        f'<!doctype html>\n<html lang="en"><head>{head}<style>{STYLE}</style></head>\n<body>{body}</body></html>\n',
    )


def _picture(picture: PngFigure) -> str:
    data = base64.b64encode(picture.png).decode()
    alternative = html.escape(f"{picture.title}: {picture.caption}")
    return _figure(picture.title, picture.caption, f'<img src="data:image/png;base64,{data}" alt="{alternative}">')


def _drawing(drawing: SvgFigure) -> str:
    return _figure(drawing.title, drawing.caption, drawing.svg)


def _figure(title: str, caption: str, inside: str) -> str:
    return f"<h2>{html.escape(title)}</h2><figure>{inside}<figcaption>{html.escape(caption)}</figcaption></figure>"


def _bars(bars: Bars) -> str:
    most = max((value for _, value, _ in bars.rows), default=0.0) or 1.0
    rows = "".join(
        f'<tr><td>{html.escape(name)}</td><td class="number">{html.escape(text)}</td>'
        f'<td class="bars"><div class="bar" style="width:{100 * value / most:.1f}%"></div></td></tr>'
        for name, value, text in bars.rows
    )
    return f"<h2>{html.escape(bars.title)}</h2><table>{rows}</table>"


def write_png(path: FilePath, picture: PngFigure) -> None:
    """Write the picture alone, atomically."""
    with replacing(path) as aside:
        aside.write_bytes(picture.png)


def _table(table: Table) -> str:
    def row(cells: Sequence[str], tag: str) -> str:
        kinds = ["" if table.plain else _kind(cell) for cell in cells]
        return (
            "<tr>" + "".join(f"<{tag}{k}>{html.escape(c)}</{tag}>" for k, c in zip(kinds, cells, strict=True)) + "</tr>"
        )

    head = row(table.header, "th") if any(table.header) else ""
    rows = "".join(row(cells, "td") for cells in table.rows)
    return f"<h2>{html.escape(table.title)}</h2><table>{head}{rows}</table>"


def _kind(cell: str) -> str:
    return ' class="number"' if cell[:1].isdigit() or cell[:1] in "+-" else ""
