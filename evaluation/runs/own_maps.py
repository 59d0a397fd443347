"""Maps of a chair's own making, as its user makes them: a drive through a world, or a recorded log, and `waychair map`.

They are made once and stay under `out/acceptance/maps/`, so that drives before and after a change have the same map.
To make one again, delete its folder.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

MAPS = Path("out") / "acceptance" / "maps"


def map_of_world(world: str) -> Path:
    """Return the folder of the map of a shipped world; the drive along its mapping route began at the world's start."""
    folder = MAPS / world
    if not (folder / "map.yaml").exists():
        with tempfile.TemporaryDirectory() as place:
            bag = Path(place) / "drive.mcap"
            _waychair("simulate", "--world", world, "--no-camera", "--no-people", "--record", str(bag), "--quiet")
            _waychair("map", str(bag), "--out", str(folder), "--quiet")
    return folder


def map_of_log(name: str, log: Path) -> Path:
    """Return the folder of the map of a recorded log, under a name."""
    folder = MAPS / name
    if not (folder / "map.yaml").exists():
        _waychair("map", str(log), "--out", str(folder), "--quiet")
    return folder


def _waychair(*words: str) -> None:
    subprocess.run([sys.executable, "-c", "from waychair.cli.main import main; main()", *words], check=True)
