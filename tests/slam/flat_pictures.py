"""Pictures of the synthetic flat from one metre above the floor: each wall has its own texture."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates, zoom

from tests.slam.conftest import WALLS
from waychair.types import Float32Array, FloatArray, Pose2, Pose3, RgbdFrame

WIDTH, HEIGHT, FOCAL = 320, 240, 260.0
CAMERA_HEIGHT, WALL_HEIGHT = 1.0, 2.5
MATRIX = np.array([[FOCAL, 0.0, 159.5], [0.0, FOCAL, 119.5], [0.0, 0.0, 1.0]])
BASE_FROM_CAMERA = Pose3(
    np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([0.0, 0.0, CAMERA_HEIGHT])
)

_RANDOM = np.random.default_rng(3)
_SIZE = 240  # squares of a paper, 20 to a metre
_PAPERS = sum(
    zoom(_RANDOM.uniform(0.0, share, (len(WALLS), _SIZE // size, _SIZE // size)), (1, size, size), order=1)
    for size, share in ((1, 80.0), (3, 80.0), (10, 90.0))
)


def picture_at(pose: Pose2, stamp_ns: int) -> RgbdFrame:
    """Grey picture with depth from a true pose."""
    rays = np.stack([np.ones(WIDTH), -(np.arange(WIDTH) - MATRIX[0, 2]) / FOCAL], axis=1)
    c, s = np.cos(pose.theta), np.sin(pose.theta)
    depth, along, wall = _nearest(rays @ np.array([[c, s], [-s, c]]), np.array([pose.x, pose.y]))
    heights = CAMERA_HEIGHT - (np.arange(HEIGHT)[:, None] - MATRIX[1, 2]) / FOCAL * depth
    seen = (heights > 0.0) & (heights < WALL_HEIGHT)
    shade = np.full(seen.shape, 90.0)
    at = [
        np.broadcast_to(wall, seen.shape)[seen],
        20.0 * heights[seen],
        np.broadcast_to(20.0 * along, seen.shape)[seen],
    ]
    shade[seen] = map_coordinates(_PAPERS, [at[0], at[1] % (_SIZE - 1), at[2] % (_SIZE - 1)], order=1)
    metres: Float32Array = np.where(seen, depth, np.nan).astype(np.float32)
    return RgbdFrame(stamp_ns, np.clip(shade, 0, 255).astype(np.uint8), metres, MATRIX)


def _nearest(rays: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (W,) the share of each ray (W, 2) to the nearest wall, the distance along that wall [m], and its
    number."""
    start, way = WALLS[:, :2], WALLS[:, 2:] - WALLS[:, :2]
    cross = rays[:, :1] * way[:, 1] - rays[:, 1:] * way[:, 0]
    offset = start - at
    with np.errstate(divide="ignore", invalid="ignore"):
        ahead = (offset[:, 0] * way[:, 1] - offset[:, 1] * way[:, 0]) / cross
        share = (offset[:, 0] * rays[:, 1:] - offset[:, 1] * rays[:, :1]) / cross
    ahead[~((ahead > 0.0) & (share >= 0.0) & (share <= 1.0))] = np.inf
    wall = np.argmin(ahead, axis=1)
    rows = np.arange(len(rays))
    return ahead[rows, wall], share[rows, wall] * np.hypot(*way[wall].T), wall.astype(float)
