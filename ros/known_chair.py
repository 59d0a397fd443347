"""The chair that a node belongs to, by its file or, for a simulated one, by its name."""

from __future__ import annotations

from pathlib import Path

from waychair.calibration.calibration_file import ChairCalibration, load_calibration
from waychair.simulation.chair_file import load_chair
from waychair.trials.simulated_stops import simulated_calibration


def known_chair(file: str, simulated: str) -> ChairCalibration:
    """What is known of the chair of a calibration file; without one, what would be in that of a simulated chair.

    Raises:
        CalibrationError: the file is missing or damaged.
        ConfigError: there is no such simulated chair.
    """
    if file:
        return load_calibration(Path(file))
    return simulated_calibration(load_chair(simulated).body)
