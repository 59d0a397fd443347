"""The chair's last pose, by its localiser or its simulator, kept in a file from one run to the next."""

from __future__ import annotations

import json
import math
from pathlib import Path

from waychair.errors import ConfigError
from waychair.files import write_json
from waychair.types import Pose2


def remember_pose(path: Path, map_folder: Path, pose: Pose2) -> None:
    """Save a pose on a map, or in a world by its name, without waiting for the disk.

    Raises:
        OutputError: the file cannot be written.
    """
    write_json(path, {"map": str(map_folder.resolve()), "pose": [pose.x, pose.y, pose.theta]}, lasting=False)


def remembered_pose(path: Path, map_folder: Path) -> Pose2 | None:
    """Return the saved pose; None without one, or for a pose on another map.

    Raises:
        ConfigError: the file is damaged.
    """
    try:
        known = json.loads(path.read_text(encoding="utf-8"))
        if known["map"] != str(map_folder.resolve()):
            return None
        x, y, theta = map(float, known["pose"])
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path} holds no pose ({error}): delete it") from error
    if not all(map(math.isfinite, (x, y, theta))):
        raise ConfigError(f"{path} holds no pose ({x}, {y}, {theta}): delete it")
    return Pose2(x, y, theta)
