"""Twenty sessions on one floor with moving furniture: the map stays small and right, and old furniture vanishes."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from evaluation.scenes.maps.lifelong import Lifelong, drive_sessions
from waychair.maps.folders.map_files import load_map
from waychair.types import UNKNOWN, Json

SESSIONS, SEED = 20, 3
MOST_GROWTH, LEAST_HEALTH, MOST_GHOSTS = 1.3, 0.99, 0.01


def lifelong(out: Path, count: int = SESSIONS, seed: int = SEED) -> Json:
    """Twenty sessions of the second floor, twelve pieces of furniture of which four are moved each time.

    Bars: at most 1.3 times the first session's nodes; localisation OK for 99 % of the time on the map of the earlier
    sessions; at most 1 % ghost cells of pieces that were absent in two sessions.
    """
    return _lived(out, "second_floor", count, seed)


def _lived(out: Path, floor: str, count: int, seed: int) -> Json:
    with tempfile.TemporaryDirectory() as work:
        life = Lifelong(Path(work) / "map")
        for drive in drive_sessions(floor, count, seed):
            life.add(drive)
        _plot(out.with_suffix(".png"), life)
    figures = life.figures()
    passed = (
        figures["growth"] <= MOST_GROWTH
        and figures["health_ok_mean"] >= LEAST_HEALTH
        and figures["ghost_share"] <= MOST_GHOSTS
    )
    return {"passed": bool(passed), **figures, "rows": life.rows}


def _plot(path: Path, life: Lifelong) -> None:
    """Draw nodes and health by session, and the last map with present (green) and removed (red) pieces."""
    import matplotlib.pyplot as plt

    path.parent.mkdir(parents=True, exist_ok=True)
    figure, (nodes, drawn) = plt.subplots(2, 1, figsize=(10, 8), height_ratios=(1, 2), layout="constrained")
    number = [row["session"] for row in life.rows]
    nodes.plot(number, [row["nodes"] for row in life.rows], "o-", label="key scans")
    nodes.axhline(MOST_GROWTH * life.rows[0]["nodes"], color="0.7", ls="--", label="1.3 times the first session's")
    nodes.set(xlabel="session", ylabel="nodes", ylim=(0, None))
    health = nodes.twinx()
    health.plot(number, [100 * row["health_ok"] for row in life.rows], "s:", color="C1")
    health.set(ylabel="health OK [%]", ylim=(90, 100.5))
    nodes.plot([], [], "s:", color="C1", label="health OK")
    nodes.legend(loc="lower right")
    grid, origin = load_map(life.folder), life.sessions[0].truth.poses[0]
    shades = np.where(grid.cells == UNKNOWN, 0.8, 1.0 - np.clip(grid.cells, 0, 100) / 100.0)
    (height, width), side, low = grid.cells.shape, grid.resolution, grid.map_from_grid
    drawn.imshow(
        shades, cmap="gray", origin="lower", extent=(low.x, low.x + width * side, low.y, low.y + height * side)
    )
    standing = set(life.sessions[-1].pieces)
    c, s = np.cos(origin[2]), np.sin(origin[2])
    for piece in {piece for drive in life.sessions for piece in drive.pieces}:
        x, y = np.array(piece.centre) - origin[:2]
        drawn.plot(c * x + s * y, c * y - s * x, "+", color="C2" if piece in standing else "C3", ms=6)
    drawn.set(xlabel="[m]", ylabel="[m]")
    figure.savefig(path, dpi=120)
    plt.close(figure)
