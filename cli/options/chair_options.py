"""Options shared by the commands of `waychair calibrate`: the chair, its ports, its file."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol

from cyclopts import Parameter

from waychair.cli.options.arguments import NonNegativeInt

if TYPE_CHECKING:
    from waychair.calibration.chair_body import ChairBody
    from waychair.calibration.fits.sweep import SweepSettings
    from waychair.simulation.simulator import SimulatorSettings

PlantName = Literal["kinematic", "mujoco"]


class ProgressCallback(Protocol):
    """A callback for the progress of a task."""

    def __call__(self, share: float) -> None:
        """Show that `share` (0 to 1) of the work is done."""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ChairOptions:
    """A chair, simulated by default, and its calibration file.

    Parameters
    ----------
    out
        Calibration file of the chair; its other entries stay.
    chair_sim
        Seed of the simulated chair, default 0.
    chair
        A built-in chair (A, B, ...), or a simulated chair's .yaml file.
    quiet
        Print nothing but errors.
    """

    out: Path = Path("chair.json")
    chair_sim: NonNegativeInt | None = None
    chair: str = "A"
    quiet: bool = False

    @property
    def seed(self) -> int:
        """Seed of the simulated chair."""
        return self.chair_sim or 0

    @property
    def simulated_name(self) -> str:
        """The simulated chair's name in its file."""
        return f"sim-{self.seed}"

    def body(self) -> ChairBody:
        """Return the chair's body by tape measure."""
        from waychair.simulation.plant.chair_file import load_chair

        return load_chair(self.chair).body

    def simulated(self, plant: PlantName = "kinematic") -> tuple[ChairBody, SimulatorSettings]:
        """Return body and simulator settings of the simulated chair of this seed."""
        from waychair.simulation.plant.chair_file import load_chair, randomised_chair
        from waychair.simulation.simulator import SimulatorSettings

        made = randomised_chair(load_chair(self.chair), self.seed)
        return made.body, SimulatorSettings(plant_model=plant, plant=made.plant, mujoco=made.mujoco)

    def refuse_other_chair(self, name: str) -> None:
        """Raise `CalibrationMismatch` if the file belongs to another chair; called before a drive."""
        from waychair.calibration.calibration_file import load_calibration

        if self.out.exists():
            load_calibration(self.out, name)

    def keep(self, name: str, body: ChairBody, **parts: object) -> None:
        """Add measured parts to the chair's file."""
        from datetime import UTC, datetime

        from waychair.calibration.calibration_file import ChairCalibration, update_calibration

        date = datetime.now(UTC).isoformat(timespec="seconds")
        measured = ChairCalibration(name, date, body, **parts)  # type: ignore[arg-type]
        kept = update_calibration(self.out, measured)
        self.say(f"{self.out}: chair {kept.chair_id}")

    def say(self, text: str) -> None:
        """Print unless quiet."""
        if not self.quiet:
            print(text)

    @contextmanager
    def progress(self, what: str) -> Iterator[ProgressCallback]:
        """Show a progress bar on standard error while the block runs."""
        from rich.console import Console
        from rich.progress import Progress as Bar

        console = Console(file=sys.stderr, quiet=self.quiet)
        with Bar(console=console, transient=True, disable=self.quiet) as bar:
            task = bar.add_task(what, total=1.0)
            yield lambda share: bar.update(task, completed=share)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class PortOptions:
    """A real chair and its board.

    Parameters
    ----------
    port
        Port of a real chair's board: /dev/ttyUSB0, pty:PATH or tcp:HOST:PORT. The chair then drives by itself.
    sensors
        Port of its sensors, which send lines of text: `wheels STAMP LEFT RIGHT`, `imu ...`, `scan ...`; see
        calibration/drives/sensor_lines.py.
    family
        Joystick family for which the board was flashed.
    speeds_from
        encoders, or lidar (with gyro) for a chair without encoders.
    room
        Greatest distance of the real chair from its start, in metres.
    """

    port: str | None = None
    sensors: str | None = None
    family: Literal["hall_5v", "inductive_12v", "eight_pin_3v3"] = "hall_5v"
    speeds_from: Literal["encoders", "lidar"] = "encoders"
    room: float = 6.0


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class SweepOptions:
    """The levels of a sweep, and the converter.

    Parameters
    ----------
    bits
        Bits of the converter, 8 to 16; a real chair's board reports its own.
    volts_max
        Output of the converter at its largest count; a real chair's board reports it.
    volts_min
        Output of the converter at count 0; a real chair's board reports it.
    levels
        Number of levels on each axis.
    repetitions
        Number of runs of each level.
    swing
        Greatest deflection from neutral, in volts; begin with little on an unknown chair.
    rest
        Seconds at neutral between two levels; longer rests keep the motors cooler.
    """

    bits: NonNegativeInt = 12
    volts_max: float = 3.3
    volts_min: float = 0.0
    levels: NonNegativeInt = 89
    repetitions: NonNegativeInt = 3
    swing: float = 1.2
    rest: float = 1.6

    def settings(self, blocks: bool) -> SweepSettings:
        """Return the sweep's settings; with `blocks` no level combines both axes."""
        from waychair.calibration.fits.sweep import SweepSettings

        return SweepSettings(
            bits=self.bits,
            volts_max=self.volts_max,
            volts_min=self.volts_min,
            swing=self.swing,
            levels=self.levels,
            repetitions=self.repetitions,
            rest_s=self.rest,
            combined=0 if blocks else SweepSettings().combined,
        )
