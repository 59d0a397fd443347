"""The report of a mapping run: report.json, and report.html with a drawing of map, trajectory and loop closures."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from waychair import __version__
from waychair.offline.report import COLOURS, Bars, SvgFigure, Table, write_page
from waychair.png import grey_png
from waychair.recordings.recording import Recording
from waychair.slam.graph.graph_optimisation import EdgeKind
from waychair.slam.graph.least_squares import connected_parts
from waychair.slam.mapping.mapper_result import MapperResult
from waychair.types import UNKNOWN, FloatArray, Json, OccupancyGrid

_MARGIN = 1.0  # [m] around the known part of the map
_WAY_STEP = 0.1  # [m] between drawn points of the trajectory
_FREE, _OCCUPIED, _UNKNOWN_SHADE = 50.0, 65.0, 209  # [%] drawn white, [%] drawn black, grey level of unknown cells
_LEAST_PART = 5  # key scans of a part that the odometry alone holds
_TICKS = (1, 2, 5, 10, 20, 50, 100, 200)  # [m] possible lengths of the scale bar


@dataclass(frozen=True, slots=True)
class Cost:
    """The cost of a run: CPU seconds by stage and of each full scan match, wall seconds, peak memory [MB]."""

    stages: Mapping[str, float]
    key_seconds: Sequence[float]
    wall_seconds: float
    peak_memory_mb: float


def mapping_report(
    recording: Recording,
    warnings: Sequence[str],
    result: MapperResult,
    grid: OccupancyGrid,
    cost: Cost,
    resumed_at: int,
) -> Json:
    """Return the report as JSON: input, counts, loop closures with their stamps, times by stage, memory."""
    poses, stamps = result.drive_trajectory.poses, result.drive_trajectory.stamps_ns
    duration_s = float(stamps.max() - stamps.min()) * 1e-9
    kinds = [edge.kind for edge in result.edges]
    return {
        "waychair": __version__,
        "input": str(recording.path),
        "parts": [str(part) for part in recording.parts],
        "source": recording.source,
        "base_from_laser": [round(value, 6) for value in recording.base_from_laser.array().tolist()],
        "warnings": list(warnings),
        "health": [finding.as_json() for finding in recording.findings],
        "frames": len(stamps),
        "duration_s": round(duration_s, 3),
        "times_real_time": round(duration_s / max(cost.wall_seconds, 1e-3), 1),
        "distance_m": round(float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum()), 3),
        "key_scans": len(result.key_poses),
        "edges": {kind.value: kinds.count(kind) for kind in EdgeKind},
        "loops": _loops(result),
        "loop_search": _loop_search(result),
        "tears": tears_of(result),
        "rejected_loops": [str(rejected) for rejected in result.rejected],
        "counts": result.counts,
        "grid": {
            "width": grid.cells.shape[1],
            "height": grid.cells.shape[0],
            "resolution_m": grid.resolution,
            "known_m2": round(float((grid.cells >= 0).sum()) * grid.resolution**2, 2),
        },
        "resumed_at_frame": resumed_at,
        "cpu_seconds": {stage: round(value, 3) for stage, value in cost.stages.items()},
        "key_scan_ms": _milliseconds(cost.key_seconds),
        "wall_seconds": round(cost.wall_seconds, 3),
        "peak_memory_mb": round(cost.peak_memory_mb, 1),
    }


def torn_warnings(result: MapperResult) -> list[str]:
    """Return a sentence about the breaks in the scan matching that a loop closure has bridged, one about the others, one about
    the places where only the odometry holds the map together, and one about scans that do not show the motion
    where there is no odometry."""
    tears = tears_of(result)
    joined = [tear["at_s"] for tear in tears if tear["joined_again"]]
    apart = [tear["at_s"] for tear in tears if not tear["joined_again"]]
    lost = "the part after it is not joined to the rest: record a drive that returns to known ground"
    loose = "odometry alone joins the map there: what lies beyond may be turned or moved; record a drive back to known ground"
    told = (
        (joined, "do not match those before; a loop closure has joined the map again"),
        (apart, f"do not match those before, and {lost}"),
        (odometry_joints_of(result), f"do not show the chair's motion, and {loose}"),
    )
    sentences = [f"{_times(times)} the scans {sentence}" for times, sentence in told if times]
    if unseen := result.counts.get("motion_unseen", 0):
        sentences.append(
            f"{unseen} scans do not show how far the chair drove along bare walls, and there is no odometry: the map may be too "
            "short or too long there; record the drive with the wheels' odometry"
        )
    return sentences


def _times(times: Sequence[float]) -> str:
    """Return the first of some times [s] in words, and the number of the others."""
    later = {1: "", 2: " and once later"}.get(len(times), f" and {len(times) - 1} times later")
    return f"at {min(times):.1f} s{later}"


def odometry_joints_of(result: MapperResult) -> list[float]:
    """Return the times [s] since the start of this drive at which nothing but the odometry joins two parts of the map.

    No match of scans, and no loop, leads from one part to the other. Ends of a few key scans count for nothing.
    """
    whole = [edge for edge in result.edges if edge.kind is not EdgeKind.UNKNOWN]
    ends = np.array([(edge.i, edge.j) for edge in whole], np.int64).reshape(-1, 2)
    count, times = len(result.key_poses), []
    for k, edge in enumerate(whole):
        if edge.kind is not EdgeKind.ODOMETRY or result.key_frames[edge.j] < result.earlier_frames:
            continue
        others = np.delete(ends, k, axis=0)
        piece = connected_parts(others[:, 0], others[:, 1], count)
        sizes = [np.count_nonzero(piece == piece[node]) for node in (edge.i, edge.j)]
        if piece[edge.i] != piece[edge.j] and min(sizes) >= _LEAST_PART:
            times.append(_time_of(result, edge.j))
    return times


def tears_of(result: MapperResult) -> list[Json]:
    """Return every tear of this drive: its time [s] since the start, why it is there, and whether loops have joined the part
    after it to any before it."""
    torn = [e for e in result.edges if e.kind is EdgeKind.UNKNOWN and result.key_frames[e.j] >= result.earlier_frames]
    if not torn:
        return []
    whole = [edge for edge in result.edges if edge.kind is not EdgeKind.UNKNOWN]
    ends = np.array([(edge.i, edge.j) for edge in whole], np.int64).reshape(-1, 2)
    piece = connected_parts(ends[:, 0], ends[:, 1], len(result.key_poses))
    return [
        {
            "at_s": _time_of(result, edge.j),
            "why": "the drive begins at an unknown place of the map"
            if result.key_frames[edge.j] == result.earlier_frames
            else "the scans contradict those before, also after some metres more",
            "joined_again": bool((piece[: edge.j] == piece[edge.j]).any()),
        }
        for edge in torn
    ]


def _time_of(result: MapperResult, node: int) -> float:
    """Return the time [s] of a key scan since the start of this drive."""
    start = int(result.drive_trajectory.stamps_ns[0])
    return round((int(result.trajectory.stamps_ns[result.key_frames[node]]) - start) * 1e-9, 3)


def _loop_search(result: MapperResult) -> Json:
    """Return how many places were proposed as loops, how many the scans verified, how many the map keeps, and which submaps
    were searched as a whole, or never, although the chair could have been there."""
    counts = result.counts
    return {
        "proposed": counts.get("loops_proposed", 0) + counts.get("glimpses_tried", 0),
        "verified": counts.get("loops_closed", 0) + counts.get("loops_sighted", 0),
        "closed": sum(edge.kind is EdgeKind.LOOP for edge in result.edges),
        "rejected": len(result.rejected),
        "submaps_searched": counts.get("submaps_searched", 0),
        "submaps_never_searched": counts.get("submaps_never_searched", 0),
    }


def _milliseconds(seconds: Sequence[float]) -> Json:
    """Return mean, 95th percentile and maximum [ms]."""
    if not seconds:
        return {}
    values = 1e3 * np.array(seconds)
    figures = {"mean": values.mean(), "p95": np.quantile(values, 0.95), "max": values.max()}
    return {name: round(float(value), 2) for name, value in figures.items()}


def write_mapping_page(path: Path, report: Json, grid: OccupancyGrid, result: MapperResult) -> None:
    """Write report.html, which loads nothing from elsewhere.

    Raises:
        OutputError: the file cannot be written.
    """
    total = report["cpu_seconds"]["total"]
    lead = (
        f"{report['frames']} scans over {report['distance_m']:.0f} m and {report['duration_s']:.0f} s became "
        f"{report['key_scans']} key scans with {report['edges']['loop']} loop closures; "
        f"{report['grid']['known_m2']:.0f} m\N{SUPERSCRIPT TWO} are known."
    )
    wall = report["wall_seconds"]
    rows = [
        ("file", Path(report["input"]).name),
        ("format", report["source"]),
        ("laser on the base", "x {:.3f} m, y {:.3f} m, yaw {:.3f} rad".format(*report["base_from_laser"])),
        ("peak memory", f"{report['peak_memory_mb']:.0f} MB"),
        ("time", f"{wall:.1f} s, {report['times_real_time']:.0f} times as fast as it was recorded"),
    ]
    if report["resumed_at_frame"]:
        rows.append(("resumed", f"at scan {report['resumed_at_frame']}, from the checkpoint of a stopped run"))
    facts = Table("The recording", ("", ""), tuple(rows), plain=True)
    stages = {name: value for name, value in report["cpu_seconds"].items() if name != "total"}
    stages["rest"] = max(0.0, total - sum(stages.values()))
    bars = Bars(
        f"Processor time, {total:.1f} s", tuple((name, value, f"{value:.2f} s") for name, value in stages.items())
    )
    counts = Table("Counts", ("", ""), tuple((name.replace("_", " "), str(n)) for name, n in report["counts"].items()))
    search = Table(
        "The search for loops", ("", ""), tuple((k.replace("_", " "), str(n)) for k, n in report["loop_search"].items())
    )
    drawing = SvgFigure("The map", _caption(report), draw_mapping(grid, result))
    write_page(path=path, title=f"waychair map: {Path(report['input']).name}", lead=lead, tables=(facts, bars, search, _loop_table(report), *_tear_tables(report), counts), pictures=(drawing,), warnings=report["warnings"])  # fmt: skip


def draw_mapping(grid: OccupancyGrid, result: MapperResult) -> str:
    """Return map, trajectory and loop closures as one SVG in the grid's axes: one user unit per metre, y up."""
    known = np.argwhere(grid.cells != UNKNOWN)
    low, high = (
        (known.min(axis=0), known.max(axis=0) + 1) if len(known) else (np.zeros(2, int), np.array(grid.cells.shape))
    )
    cells = grid.cells[low[0] : high[0], low[1] : high[1]]
    (height, width), (y, x) = np.array(cells.shape) * grid.resolution, low * grid.resolution
    way = _in_grid(result.drive_trajectory.poses[:, :2], grid)
    keys = _in_grid(result.key_poses[:, :2], grid)
    corner = np.minimum([x, y], way.min(axis=0)) - _MARGIN
    size = np.maximum([x + width, y + height], way.max(axis=0)) + _MARGIN - corner
    stroke = max(size) / 400
    length = max((tick for tick in _TICKS if tick <= size[0] / 4), default=1)
    stamps = result.trajectory.stamps_ns[list(result.key_frames)]
    loops = [edge for edge in result.edges if edge.kind is EdgeKind.LOOP]
    lines = "".join(
        f'<line x1="{keys[e.i, 0]:.2f}" y1="{keys[e.i, 1]:.2f}" x2="{keys[e.j, 0]:.2f}" y2="{keys[e.j, 1]:.2f}">'
        f"<title>{abs(int(stamps[e.j]) - int(stamps[e.i])) * 1e-9:.0f} s apart</title></line>"
        for e in loops
    )
    points = " ".join(f"{px:.2f},{py:.2f}" for px, py in _thinned(way))
    bottom, left = corner[1] + 0.5 * _MARGIN, corner[0] + 0.5 * _MARGIN
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{corner[0]:.2f} {-corner[1] - size[1]:.2f} {size[0]:.2f} {size[1]:.2f}" '
        f'role="img" aria-label="map with the trajectory"><g transform="scale(1,-1)">'
        f'<rect x="{corner[0]:.2f}" y="{corner[1]:.2f}" width="{size[0]:.2f}" height="{size[1]:.2f}" fill="#d1d1d1"/>'
        f'<g transform="translate({x:.3f},{y:.3f}) scale(1,-1)"><image href="{_png(cells)}" x="0" y="{-height:.3f}" '
        f'width="{width:.3f}" height="{height:.3f}" style="image-rendering:pixelated"/></g>'
        f'<polyline points="{points}" fill="none" stroke="{COLOURS[0]}" stroke-width="{stroke:.3f}" stroke-linejoin="round"/>'
        f'<g stroke="{COLOURS[1]}" stroke-width="{stroke:.3f}" stroke-linecap="round">{lines}</g>'
        f'<circle cx="{way[0, 0]:.2f}" cy="{way[0, 1]:.2f}" r="{3 * stroke:.3f}" fill="{COLOURS[2]}"><title>start</title></circle>'
        f'<circle cx="{way[-1, 0]:.2f}" cy="{way[-1, 1]:.2f}" r="{3 * stroke:.3f}" fill="{COLOURS[3]}"><title>end</title></circle>'
        f'<line x1="{left:.2f}" y1="{bottom:.2f}" x2="{left + length:.2f}" y2="{bottom:.2f}" stroke="#333" '
        f'stroke-width="{2 * stroke:.3f}"/></g>'
        f'<text x="{left + length + 2 * stroke:.2f}" y="{-bottom + 2 * stroke:.2f}" font-size="{7 * stroke:.2f}" '
        f'font-family="system-ui, sans-serif" fill="#333">{length} m</text></svg>'
    )  # fmt: skip


def _caption(report: Json) -> str:
    return (
        "White is free, black occupied, grey unknown. Blue is the trajectory, from the green dot to the pink one; "
        f"the {report['edges']['loop']} orange lines are loop closures."
    )


def _in_grid(points: FloatArray, grid: OccupancyGrid) -> FloatArray:
    """Return points (N, 2) of the map in the grid's axes [m]."""
    corner = grid.map_from_grid
    c, s = np.cos(corner.theta), np.sin(corner.theta)
    away = points - (corner.x, corner.y)
    in_grid: FloatArray = away @ np.array([[c, -s], [s, c]])
    return in_grid


def _thinned(points: FloatArray) -> FloatArray:
    """Return the points without those nearer than a step to the last one kept."""
    kept = [points[0]]
    for point in points:
        if np.hypot(*(point - kept[-1])) >= _WAY_STEP:
            kept.append(point)
    return np.array([*kept, points[-1]])


def _png(cells: np.ndarray) -> str:
    """Return cells (H, W), lowest row first, as a data URI of a PNG with the top row first."""
    dark = np.clip((cells.astype(np.float64) - _FREE) / (_OCCUPIED - _FREE), 0.0, 1.0)
    shades = np.where(cells == UNKNOWN, _UNKNOWN_SHADE, 255 * (1.0 - dark)).astype(np.uint8)
    return "data:image/png;base64," + base64.b64encode(grey_png(np.flipud(shades))).decode()


def _loops(result: MapperResult) -> list[Json]:
    """Return every loop closure: its two stamps, and the later pose in the earlier one's frame."""
    stamps = result.trajectory.stamps_ns[list(result.key_frames)].tolist()
    return [
        {
            "from_stamp_s": round(stamps[edge.i] * 1e-9, 6),
            "to_stamp_s": round(stamps[edge.j] * 1e-9, 6),
            "apart_s": round(abs(stamps[edge.j] - stamps[edge.i]) * 1e-9, 3),
            "pose": [round(value, 4) for value in edge.i_from_j.array().tolist()],
        }
        for edge in result.edges
        if edge.kind is EdgeKind.LOOP
    ]


def _loop_table(report: Json) -> Table:
    """Return a table of the loop closures over the longest times."""
    longest = sorted(report["loops"], key=lambda loop: -loop["apart_s"])[:10]
    rows = tuple(
        (f"{loop['from_stamp_s']:.3f}", f"{loop['to_stamp_s']:.3f}", f"{loop['apart_s']:.0f} s") for loop in longest
    )
    return Table("The longest loops", ("from", "to", "apart"), rows or (("none", "", ""),))


def _tear_tables(report: Json) -> tuple[Table, ...]:
    """Return a table of the places where the scans contradict those before, if there are any."""
    rows = tuple(
        (f"{tear['at_s']:.1f} s", tear["why"], "joined again by loops" if tear["joined_again"] else "not joined")
        for tear in report["tears"]
    )
    return (Table("Tears", ("at", "why", ""), rows),) if rows else ()
