"""Options that all of `waychair calibrate` share: which chair, and where what is found of it is kept."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol

from cyclopts import Parameter

from waychair.cli.arguments import Count

if TYPE_CHECKING:
    from waychair.calibration.chair import ChairBody
    from waychair.calibration.sweep import SweepSettings
    from waychair.simulation.simulator import SimulatorSettings

PlantName = Literal["kinematic", "mujoco"]


class Progress(Protocol):
    """Is told how much is done."""

    def __call__(self, share: float) -> None:
        """`share` of the work is done."""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ChairOptions:
    """A chair, simulated unless the command is told otherwise, and its file.

    Parameters
    ----------
    out
        File of the chair; what is in it already stays.
    chair_sim
        Seed of the simulated chair, 0 unless given.
    chair
        One of the chairs that are built in (A, B, ...), or a simulated chair's .yaml file.
    quiet
        Print nothing but errors.
    """

    out: Path = Path("chair.json")
    chair_sim: Count | None = None
    chair: str = "A"
    quiet: bool = False

    @property
    def seed(self) -> int:
        """Of the simulated chair."""
        return self.chair_sim or 0

    @property
    def simulated_name(self) -> str:
        """What the simulated chair's file calls it."""
        return f"sim-{self.seed}"

    def body(self) -> ChairBody:
        """Its body, as measured with a tape."""
        from waychair.simulation.chair_file import load_chair

        return load_chair(self.chair).body

    def simulated(self, plant: PlantName = "kinematic") -> tuple[ChairBody, SimulatorSettings]:
        """Body and drive of the simulated chair of this seed."""
        from waychair.simulation.chair_file import load_chair, randomised_chair
        from waychair.simulation.simulator import SimulatorSettings

        made = randomised_chair(load_chair(self.chair), self.seed)
        return made.body, SimulatorSettings(plant_model=plant, plant=made.plant, mujoco=made.mujoco)

    def refuse_other_chair(self, name: str) -> None:
        """Before anything is driven: raises `CalibrationMismatch` when the file is another chair's."""
        from waychair.calibration.calibration_file import load_calibration

        if self.out.exists():
            load_calibration(self.out, name)

    def keep(self, name: str, body: ChairBody, **parts: object) -> None:
        """Add what was measured to the chair's file."""
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
    def progress(self, what: str) -> Iterator[Progress]:
        """A bar on standard error while the block runs."""
        from rich.console import Console
        from rich.progress import Progress as Bar

        console = Console(file=sys.stderr, quiet=self.quiet)
        with Bar(console=console, transient=True, disable=self.quiet) as bar:
            task = bar.add_task(what, total=1.0)
            yield lambda share: bar.update(task, completed=share)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class PortOptions:
    """A real chair behind its board.

    Parameters
    ----------
    port
        Port of the board of a real chair, which then drives by itself: /dev/ttyUSB0, pty:PATH or tcp:HOST:PORT.
    sensors
        Port of its sensors, which come as lines of text: `wheels STAMP LEFT RIGHT`, `imu ...`, `scan ...`; see
        trials/sensor_lines.py.
    family
        Family of its joystick, for which the board was flashed.
    speeds_from
        encoders, or lidar: lidar and gyro, for the many chairs that have no encoders.
    room
        Farthest that the real chair may go from where it stands, in metres.
    """

    port: str | None = None
    sensors: str | None = None
    family: Literal["hall_5v", "inductive_12v", "eight_pin_3v3"] = "hall_5v"
    speeds_from: Literal["encoders", "lidar"] = "encoders"
    room: float = 6.0


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class SweepOptions:
    """What is swept, with which converter.

    Parameters
    ----------
    bits
        Resolution of the converter, 8 to 16; a real chair's board names its own.
    volts_max
        Output of the converter at its largest count; likewise.
    volts_min
        Output of the converter at count 0; likewise.
    levels
        Levels on each axis.
    repetitions
        Times that each level is driven.
    swing
        Farthest from neutral, in volts: begin with little on a chair that nobody knows.
    rest
        Seconds at neutral between two levels: more of them keep motors cool.
    """

    bits: Count = 12
    volts_max: float = 3.3
    volts_min: float = 0.0
    levels: Count = 89
    repetitions: Count = 3
    swing: float = 1.2
    rest: float = 1.6

    def settings(self, blocks: bool) -> SweepSettings:
        """As they are; on `blocks` nothing is asked about both axes together."""
        from waychair.calibration.sweep import SweepSettings

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
