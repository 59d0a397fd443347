"""Options shared by the commands of `waychair calibrate`: the chair, its ports, its file."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from waychair.cli.options.arguments import BadArgument, NonNegativeInt
from waychair.yaml_files import quoted

if TYPE_CHECKING:
    from waychair.calibration.calibration_file import ChairCalibration
    from waychair.calibration.chair_body import ChairBody
    from waychair.calibration.fits.sweep import SweepSettings
    from waychair.simulation.simulator import SimulatorSettings

PlantName = Literal["kinematic", "mujoco"]
JoystickFamily = Literal["hall_5v", "inductive_12v", "eight_pin_3v3"]
"""As in `calibration_file`, which is imported late."""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ChairOptions:
    """A chair, simulated by default, and its calibration file.

    Parameters
    ----------
    out
        Calibration file of the chair, whose other entries stay; default NAME.json with --chair-id NAME, else chair.json.
    chair_id
        Name of a real chair, the one in its board; a simulated chair is called sim-SEED.
    chair_sim
        Seed of the simulated chair, default 0.
    chair
        The chair's dimensions: a .yaml file, or a built-in chair (A, B, ...). Default for a real chair those in its
        calibration file, for a simulated one A.
    quiet
        Print nothing but errors.
    """

    out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None
    chair_id: str | None = None
    chair_sim: NonNegativeInt | None = None
    chair: str | None = None
    quiet: bool = False

    @property
    def file(self) -> Path:
        """The chair's calibration file.

        Raises:
            BadArgument: the name is none of a file, so that --out must name one.
        """
        if self.out is not None:
            return self.out
        if self.chair_id is None:
            return Path("chair.json")
        if not self.chair_id.strip() or "/" in self.chair_id:
            raise BadArgument(f"--chair-id {quoted(self.chair_id)} is no name of a file: name one with --out")
        return Path(f"{self.chair_id}.json")

    @property
    def seed(self) -> int:
        """Seed of the simulated chair."""
        return self.chair_sim or 0

    @property
    def simulated_name(self) -> str:
        """The simulated chair's name in its file."""
        return f"sim-{self.seed}"

    def real(self, needed_for: str) -> tuple[str, ChairBody]:
        """Return name and body of a real chair, whose file must not belong to another chair.

        The body is that of --chair, else that in the chair's file. Without both it is chair A's, of which `keep` warns.
        `needed_for` names the option that needs the name.

        Raises:
            BadArgument: no name is given, or a simulated chair, too.
            CalibrationMismatch: the file belongs to another chair.
            CalibrationDamaged, ConfigError: the file, or the chair of --chair, cannot be read.
        """
        from waychair.simulation.plant.chair_file import load_chair

        if self.chair_id is None or self.chair_sim is not None:
            raise BadArgument(f"{needed_for} needs --chair-id NAME, the chair's name, and no --chair-sim")
        known = self.known(self.chair_id)
        if self.chair is not None:
            return self.chair_id, replace(load_chair(self.chair).body, chair_id=self.chair_id)
        if known is not None:
            return self.chair_id, known.body
        return self.chair_id, load_chair().body

    def known(self, name: str) -> ChairCalibration | None:
        """Return the content of the chair's file, None if there is none yet.

        Raises:
            CalibrationMismatch: the file belongs to another chair.
            CalibrationDamaged: it cannot be read.
        """
        from waychair.calibration.calibration_file import load_calibration

        return load_calibration(self.file, name) if self.file.exists() else None

    def simulated(self, plant: PlantName = "kinematic") -> tuple[ChairBody, SimulatorSettings]:
        """Return body and simulator settings of the simulated chair of this seed; its file must not be another chair's.

        Raises:
            BadArgument: the name of a real chair is given.
            CalibrationMismatch: the file belongs to another chair.
        """
        from waychair.simulation.plant.chair_file import load_chair, randomised_chair
        from waychair.simulation.simulator import SimulatorSettings

        if self.chair_id is not None:
            raise BadArgument("--chair-id is a real chair's name: add --port or a recording, or omit it")
        self.known(self.simulated_name)
        made = randomised_chair(load_chair(self.chair or "A"), self.seed)
        return made.body, SimulatorSettings(plant_model=plant, plant=made.plant, mujoco=made.mujoco)

    def keep(self, name: str, body: ChairBody, **parts: object) -> None:
        """Add measured parts to the chair's file."""
        from datetime import UTC, datetime

        from waychair.calibration.calibration_file import (
            ChairCalibration,
            has_built_in_body,
            is_simulated_name,
            update_calibration,
        )
        from waychair.install_advice import document

        date = datetime.now(UTC).isoformat(timespec="seconds")
        measured = ChairCalibration(name, date, body, simulated=is_simulated_name(name), **parts)  # type: ignore[arg-type]
        kept = update_calibration(self.file, measured)
        self.say(f"{self.file}: chair {kept.chair_id}")
        if has_built_in_body(kept) and not kept.is_simulated and not self.quiet:
            print(
                f"waychair: {self.file} has the dimensions of the built-in chair {body.chair_id}: give this chair's own with "
                f"`waychair calibrate body` before it drives ({document('docs/hardware.md')})",
                file=sys.stderr,
            )

    def say(self, text: str) -> None:
        """Print unless quiet."""
        if not self.quiet:
            print(text)

    @contextmanager
    def progress(self, what: str) -> Iterator[Callable[[float], None]]:
        """Show on standard error how far a piece of work is while the block runs, and where a kernel is compiled for it."""
        from waychair.cli.options.progress import prepare_kernels, told_share

        prepare_kernels(self.quiet)
        with told_share(what, self.quiet) as show:
            yield show

    @contextmanager
    def lasting(self, what: str) -> Iterator[Callable[[str], None]]:
        """Show on standard error how long work of unknown length lasts, as `progress` does; yield a callback for words on it."""
        from waychair.cli.options.progress import prepare_kernels, told_time

        prepare_kernels(self.quiet)
        with told_time(what, self.quiet) as tell:
            yield tell


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
        Joystick family for which the board was flashed; default the board's own, which is kept in the chair's file.
    speeds_from
        encoders, or lidar (with gyro) for a chair without encoders.
    room
        Greatest distance of the real chair from its start, in metres.
    """

    port: str | None = None
    sensors: str | None = None
    family: JoystickFamily | None = None
    speeds_from: Literal["encoders", "lidar"] = "encoders"
    room: float = 6.0

    def of_family(self, known: JoystickFamily | None) -> PortOptions:
        """Return these options with the family of the chair's file, unless one is given."""
        return replace(self, family=self.family or known)


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
