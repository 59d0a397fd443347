"""The calibration of a node's chair: from the chair's file, or for a simulated chair by name."""

from __future__ import annotations

from pathlib import Path

from waychair.calibration.calibration_file import ChairCalibration, load_calibration
from waychair.simulation.plant.chair_file import load_chair
from waychair.trials.simulated_stops import simulated_calibration


def known_chair(file: str, simulated: str) -> ChairCalibration:
    """Return the calibration from a file; without a file (''), the calibration of the named simulated chair.

    Raises:
        CalibrationError: the file is missing or damaged.
        ConfigError: the simulated chair does not exist.
    """
    if file:
        return load_calibration(Path(file))
    return simulated_calibration(load_chair(simulated).body)
