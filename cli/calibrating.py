"""`waychair calibrate`: commands that measure a chair and keep what they find in its file."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol

from cyclopts import App

if TYPE_CHECKING:
    from waychair.calibration.calibration_file import ChairCalibration
    from waychair.calibration.chair import ChairBody
    from waychair.calibration.fit_dac import DacFit
    from waychair.simulation.simulator import SimulatorSettings

calibrate_app = App(name="calibrate", help="Measure a chair, and keep what is found in its file.")

_MANY_OUTLIERS = 0.02

Plant = Literal["kinematic", "mujoco"]


class _Progress(Protocol):
    def __call__(self, share: float) -> None:
        """`share` of the work is done."""


@calibrate_app.command(name="dac")
def dac_command(
    *,
    out: Path = Path("chair.json"),
    chair_sim: int | None = None,
    csv: Path | None = None,
    neutral: tuple[float, float] | None = None,
    chair_id: str | None = None,
    chair: str = "A",
    plant: Plant = "kinematic",
    bits: int = 12,
    volts_max: float = 3.3,
    levels: int = 89,
    repetitions: int = 3,
    encoders: bool = True,
    blocks: bool = False,
    plot: Path | None = None,
    quiet: bool = False,
) -> None:
    """Fit the joystick's volts to the chair's speeds: dead bands, gains, limits, coupling, delay and lag.

    Drives a simulated chair through a sweep, or reads the CSV file of one. Its columns are stamp_ns, forward_counts,
    turn_counts, v (m/s, forward positive) and omega (rad/s, left positive); levels are held for two seconds or more
    each, with rests at neutral between them.

    Parameters
    ----------
    out
        File of the chair; what is in it already stays.
    chair_sim
        Seed of the simulated chair (0 unless --csv is given).
    csv
        Log of a sweep, instead of a simulated chair.
    neutral
        Volts of the forward and the turn line with the original stick at rest, for --csv.
    chair_id
        Name of the chair, for --csv; a simulated one is called sim-SEED.
    chair
        One of the chairs that are built in (A, B, ...), or a simulated chair's .yaml file.
    plant
        kinematic: wheels that do as they are told; mujoco: mass, motors, casters and slip.
    bits
        Resolution of the converter, 8 to 16.
    volts_max
        Output of the converter at its largest count.
    levels
        Levels on each axis.
    repetitions
        Times that each level is driven.
    encoders
        Speeds from encoders; --no-encoders: from lidar and gyro.
    blocks
        The wheels are off the ground: find neutral, dead bands and directions only, and write nothing.
    plot
        Where to write a picture of the fit.
    quiet
        Print nothing but errors.
    """
    from waychair.calibration.dac_plot import plot_fit
    from waychair.calibration.drive_log import read_drive_log
    from waychair.calibration.fit_dac import fit_dac
    from waychair.calibration.levels import on_blocks
    from waychair.calibration.sweep import NEAR_NEUTRAL, SweepSettings, sweep
    from waychair.cli.arguments import BadArgument
    from waychair.trials.calibrate import chair_in_hall

    body, settings = _simulated(chair, chair_sim or 0, plant)
    if csv is not None:
        if chair_sim is not None or neutral is None or chair_id is None:
            raise BadArgument("--csv needs --neutral F T and --chair-id NAME, and no --chair-sim")
        log, name = read_drive_log(csv, bits, volts_max), chair_id
    else:
        name = f"sim-{chair_sim or 0}"
        driven = chair_in_hall(settings, body, chair_sim or 0, encoders=encoders)
        neutral = driven.neutral
        plan = SweepSettings(bits=bits, volts_max=volts_max, levels=levels, repetitions=repetitions)
        with _progress("sweeping", quiet) as show:
            log = sweep(driven.drive, neutral, plan, show)
    if blocks:
        for axis, found in zip(("forward", "turn"), on_blocks(log, neutral, NEAR_NEUTRAL), strict=True):
            print(
                f"{axis}: neutral {found.neutral:.3f} V, dead band {1e3 * found.dead_band_below:.0f} mV below and "
                f"{1e3 * found.dead_band_above:.0f} mV above, {'above' if found.sign > 0 else 'below'} is positive"
            )
        return
    fit = fit_dac(log, neutral, body.track)
    _keep(out, name, body, quiet, dac=fit.model)
    if plot is not None:
        plot_fit(fit, plot)
    if not quiet:
        _print_fit(fit)


@calibrate_app.command(name="stop")
def stop_command(
    *, out: Path = Path("chair.json"), chair_sim: int = 0, chair: str = "A", plant: Plant = "kinematic",
    fastest: float = 1.2, repetitions: int = 3, quiet: bool = False,
) -> None:  # fmt: skip
    """Measure how far the chair goes on after Stop, forward, in reverse and turning; the worst case is kept.

    A chair whose stops were never measured is held at 0.3 m/s. Needs what `waychair calibrate dac` has found.

    Parameters
    ----------
    out
        File of the chair.
    chair_sim
        Seed of the simulated chair.
    chair
        One of the chairs that are built in (A, B, ...), or a simulated chair's .yaml file.
    plant
        kinematic: wheels that do as they are told; mujoco: mass, motors, casters and slip.
    fastest
        Fastest speed to stop from, in m/s.
    repetitions
        Stops of each kind.
    quiet
        Print nothing but errors.
    """
    from waychair.calibration.calibration_file import load_calibration
    from waychair.calibration.stopping import StopSettings, permitted_speed
    from waychair.errors import CalibrationError
    from waychair.trials.calibrate import calibrate_stops, chair_in_hall

    name = f"sim-{chair_sim}"
    model = load_calibration(out, name).dac
    if model is None:
        raise CalibrationError(f"{out} has no model of the joystick yet: run `waychair calibrate dac` first")
    body, settings = _simulated(chair, chair_sim, plant)
    driven = chair_in_hall(settings, body, chair_sim)
    with _progress("stopping", quiet) as show:
        table, stops = calibrate_stops(driven, model, StopSettings(fastest=fastest, repetitions=repetitions), show)
    _keep(out, name, body, quiet, stops=table)
    if not quiet:
        for speed, distance in zip(table.speeds, table.distances, strict=True):
            print(f"from {speed:.2f} m/s within {distance:.2f} m")
        print(
            f"{len(stops)} stops, worst delay {table.delay_s:.2f} s; up to {permitted_speed(table):.2f} m/s permitted"
        )


@calibrate_app.command(name="wheels")
def wheels_command(
    *, out: Path = Path("chair.json"), chair_sim: int = 0, chair: str = "A", plant: Plant = "kinematic",
    against: Literal["truth", "map"] = "truth", quiet: bool = False,
) -> None:  # fmt: skip
    """Find the radius of each drive wheel and the track, from a square that is driven both ways round.

    Parameters
    ----------
    out
        File of the chair.
    chair_sim
        Seed of the simulated chair.
    chair
        One of the chairs that are built in (A, B, ...), or a simulated chair's .yaml file.
    plant
        kinematic: wheels that do as they are told; mujoco: mass, motors, casters and slip.
    against
        truth: the simulator's own poses; map: those that the lidar finds on a map.
    quiet
        Print nothing but errors.
    """
    from waychair.simulation.simulator import Simulator
    from waychair.trials.calibrate_sensors import WHEELS_HALL, calibrate_wheels
    from waychair.trials.halls import open_hall

    body, settings = _simulated(chair, chair_sim, plant)
    simulator = Simulator(open_hall(WHEELS_HALL, 0.05), body, settings, chair_sim)
    wheels = calibrate_wheels(simulator, mapped=against == "map")
    _keep(out, f"sim-{chair_sim}", body, quiet, wheels=wheels)
    if not quiet:
        print(
            f"radius {1e3 * wheels.left_radius:.2f} mm left, {1e3 * wheels.right_radius:.2f} mm right; "
            f"track {1e3 * wheels.track:.1f} mm"
        )


@calibrate_app.command(name="imu")
def imu_command(
    *, out: Path = Path("chair.json"), chair_sim: int = 0, chair: str = "A", seconds: float = 60.0, quiet: bool = False
) -> None:
    """Find bias and noise of the inertial unit while the chair stands still on a level floor.

    Parameters
    ----------
    out
        File of the chair.
    chair_sim
        Seed of the simulated chair.
    chair
        One of the chairs that are built in (A, B, ...), or a simulated chair's .yaml file.
    seconds
        How long to record; 20 or more.
    quiet
        Print nothing but errors.
    """
    from waychair.simulation.simulator import Simulator
    from waychair.trials.calibrate_sensors import calibrate_imu
    from waychair.trials.halls import open_hall
    from waychair.trials.simulated_drive import with_gyro

    body, settings = _simulated(chair, chair_sim, "kinematic")
    imu = calibrate_imu(Simulator(open_hall(), body, with_gyro(settings), chair_sim), seconds)
    _keep(out, f"sim-{chair_sim}", body, quiet, imu=imu)
    if not quiet:
        rates, forces = (" ".join(f"{value:+.4f}" for value in bias) for bias in (imu.gyro_bias, imu.accel_bias))
        print(f"gyro bias {rates} rad/s, noise {imu.gyro_noise:.2g} rad/s/sqrt(Hz)")
        print(f"accel bias {forces} m/s^2, noise {imu.accel_noise:.2g} m/s^2/sqrt(Hz)")


@calibrate_app.command(name="camera")
def camera_command(
    *, out: Path = Path("chair.json"), chair_sim: int = 0, chair: str = "A", quiet: bool = False
) -> None:
    """Find where the camera is, seen from the lidar, from walls and floor that both see.

    The simulated chair's camera is off its nominal place by centimetres and degrees, by the seed.

    Parameters
    ----------
    out
        File of the chair.
    chair_sim
        Seed of the simulated chair.
    chair
        One of the chairs that are built in (A, B, ...), or a simulated chair's .yaml file.
    quiet
        Print nothing but errors.
    """
    from waychair.calibration.calibration_file import mount_from_extrinsics
    from waychair.trials.calibrate_sensors import calibrate_camera, nominal_mount, with_displaced_camera

    body, settings = _simulated(chair, chair_sim, "kinematic")
    true = with_displaced_camera(body, chair_sim)
    found = calibrate_camera(true, nominal_mount(body), settings, chair_sim)
    _keep(out, f"sim-{chair_sim}", body, quiet, camera=mount_from_extrinsics(found))
    if not quiet:
        x, y, z = found.camera_from_laser.translation
        print(
            f"the lidar is at ({x:.3f}, {y:.3f}, {z:.3f}) m in the camera's frame; {found.points} points lie on their "
            f"planes to {1e3 * found.rms_m:.0f} mm"
        )


def _simulated(chair: str, seed: int, plant: Plant) -> tuple[ChairBody, SimulatorSettings]:
    from waychair.simulation.chair_file import load_chair, randomised_chair
    from waychair.simulation.simulator import SimulatorSettings

    made = randomised_chair(load_chair(chair), seed)
    return made.body, SimulatorSettings(plant_model=plant, plant=made.plant, mujoco=made.mujoco)


def _keep(out: Path, name: str, body: ChairBody, quiet: bool, **parts: object) -> None:
    """Add what was measured to the chair's file."""
    from datetime import UTC, datetime

    from waychair.calibration.calibration_file import ChairCalibration, update_calibration

    date = datetime.now(UTC).isoformat(timespec="seconds")
    kept: ChairCalibration = update_calibration(out, ChairCalibration(name, date, body, **parts))  # type: ignore[arg-type]
    if not quiet:
        print(f"{out}: chair {kept.chair_id}")


def _print_fit(fit: DacFit) -> None:
    for axis, model, step, unit in zip(
        ("forward", "turn"), (fit.model.forward, fit.model.turn), fit.steps, ("m/s", "rad/s"), strict=True
    ):
        print(
            f"{axis}: dead band {1e3 * model.below.dead_band:.0f} mV below and {1e3 * model.above.dead_band:.0f} mV above "
            f"neutral, up to {model.below.limit:.2f} and {model.above.limit:.2f} {unit}, delay "
            f"{1e3 * step.delay_s:.0f} ms, lag {1e3 * step.lag_s:.0f} ms"
        )
    print(
        f"{fit.holds} holds, {fit.unsettled} stretches left out, {fit.outliers} outliers; rms "
        f"{1e3 * fit.rms[0]:.1f} mm/s and {1e3 * fit.rms[1]:.1f} mrad/s"
    )
    if fit.outliers > _MANY_OUTLIERS * fit.holds:
        print(
            "many holds do not fit: this chair's electronics do something that the model has no figure for; see --plot"
        )


@contextmanager
def _progress(what: str, quiet: bool) -> Iterator[_Progress]:
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(file=sys.stderr, quiet=quiet), transient=True, disable=quiet) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda share: bar.update(task, completed=share)
