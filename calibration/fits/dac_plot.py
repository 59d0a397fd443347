"""Plot of a fitted DAC model: measured speeds, model and residuals of each axis."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from waychair.calibration.fits.fit_dac import DacFit
from waychair.files import replacing

_UNITS = ("m/s", "rad/s")


def plot_fit(fit: DacFit, path: Path) -> None:
    """Write the picture in the format of the path's suffix (.png, .svg, .pdf).

    Raises:
        OutputError: it cannot be written there.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 6.5), layout="constrained")
    rows = figure.subplots(2, 2, sharex="col", height_ratios=(2.0, 1.0))
    for column, (axis, model, unit) in enumerate(
        zip(("forward", "turn"), (fit.model.forward, fit.model.turn), _UNITS, strict=True)
    ):
        levels = [level for level in fit.levels if level.axis == axis]
        volts = np.array([level.volts for level in levels])
        along = np.linspace(volts.min(), volts.max(), 400)
        above, below = rows[0, column], rows[1, column]
        above.plot(volts, [level.speed for level in levels], ".", label="measured, median of each level")
        above.plot(along, [model.speed(float(value)) for value in along], label="model, this axis alone")
        above.axvline(model.neutral, color="0.6", linestyle=":", label=f"neutral, margin {1e3 * model.margin:.0f} mV")
        above.set_ylabel(f"{axis} [{unit}]")
        above.legend(loc="best", fontsize="small")
        below.axhline(0.0, color="0.6")
        below.plot(volts, [level.residual for level in levels], ".")
        below.set_ylabel(f"missed [{unit}]")
        below.set_xlabel(f"{axis} line [V]")
    figure.suptitle(f"{fit.holds} holds, rms {1e3 * fit.rms[0]:.1f} mm/s and {1e3 * fit.rms[1]:.1f} mrad/s")
    with replacing(path) as aside:
        figure.savefig(aside)
