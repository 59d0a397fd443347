"""Commands that drive the chair."""

from __future__ import annotations

from pathlib import Path


def demo_command(*, out: Path = Path("out/demo"), seed: int = 0, small: bool = False, quiet: bool = False) -> None:
    """Map a real recording, then drive the chair to three places in that map through joystick volts.

    The recording is lidar_intel of WAYCHAIR_DATA; without it a small world that ships with waychair is driven and
    mapped instead. Ends in report.html and report.json.

    Parameters
    ----------
    out
        Folder for the map and the report.
    seed
        Seed of the simulated chair, its sensors and its noise.
    small
        Use the small world even where the recording is there.
    quiet
        Print nothing but errors.
    """
    raise SystemExit
