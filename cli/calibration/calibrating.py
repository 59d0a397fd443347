"""`waychair calibrate`: commands that measure a chair and store the results in its calibration file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from cyclopts import App

from waychair.cli.options.arguments import BadArgument, NonNegativeInt
from waychair.cli.options.chair_options import ChairOptions, PlantName, PortOptions, SweepOptions

if TYPE_CHECKING:
    from waychair.calibration.chair_body import ChairBody
    from waychair.calibration.drives.dac_and_stops import ChairUnderTest
    from waychair.calibration.fits.drive_log import SweepLog
    from waychair.calibration.fits.fit_dac import DacFit
    from waychair.calibration.fits.fitted_dac import FittedDac
    from waychair.calibration.fits.stick_levels import OnBlocks
    from waychair.calibration.fits.stopping import MeasuredStop, StopSettings, StopTable
    from waychair.calibration.fits.sweep import SweepSettings

calibrate_app = App(name="calibrate", help="Measure a chair and store the results in its calibration file.")
calibrate_app.command(
    "waychair.cli.calibration.calibrating_sensors:time_command", name="time", help="Find the delays of sensors."
)
calibrate_app.command(
    "waychair.cli.calibration.calibrating_sensors:mask_command", name="mask", help="Mask the chair itself in the scans."
)

_MANY_OUTLIERS = 0.02
_CHAIR, _REAL, _SWEEP = ChairOptions(), PortOptions(), SweepOptions()


@dataclass(frozen=True, slots=True)
class _Sweep:
    """The input of a fit: the chair's name and body, its neutral (forward, turn) [V], the sweep's log, and the joystick
    family of its board, None for a log."""

    name: str
    body: ChairBody
    neutral: tuple[float, float]
    log: SweepLog
    family: str | None = None


@calibrate_app.command(name="dac")
def dac_command(
    *,
    options: ChairOptions = _CHAIR,
    real: PortOptions = _REAL,
    plan: SweepOptions = _SWEEP,
    csv: Path | None = None,
    neutral: tuple[float, float] | None = None,
    plant: PlantName = "kinematic",
    blocks: bool = False,
    log: Path | None = None,
    plot: Path | None = None,
) -> None:
    """Fit the joystick's volts to the chair's speeds: dead bands, gains, limits, coupling, delay and lag.

    Drives a simulated chair, or a real one with --port, through a sweep of levels, or reads the sweep from a CSV file.
    Its columns are stamp_ns, forward_counts, turn_counts, v (m/s, forward positive) and omega (rad/s, left positive).
    Each level must last two seconds or more, with rests at neutral between levels.

    Parameters
    ----------
    csv
        Log of a sweep, to fit without a drive.
    neutral
        Volts of the forward and the turn line with the original stick at rest, for --csv. (With --port the board
        measures them.)
    plant
        kinematic: wheels follow their commands; mujoco: mass, motors, casters and slip.
    blocks
        The wheels are off the ground: only measure neutral, dead bands and directions, and write nothing.
    log
        CSV file for the sweep; with --port the default is beside the chair's file. An aborted sweep is kept as
        NAME.part.
    plot
        File for a picture of the fit.
    """
    from waychair.calibration.fits.dac_plot import plot_fit
    from waychair.calibration.fits.fit_dac import fit_dac
    from waychair.calibration.fits.stick_levels import on_blocks
    from waychair.calibration.fits.sweep import NEAR_NEUTRAL

    if csv is not None:
        if neutral is None or real.port is not None:
            raise BadArgument("--csv needs --neutral F T and --chair-id NAME, and no --port")
        swept = _sweep_from_csv(options, plan, csv, neutral)
    elif real.port is not None:
        if neutral is not None:
            raise BadArgument("--port needs no --neutral: the board measures it")
        swept = _sweep_of_real(options, real, plan.settings(blocks), log)
    else:
        swept = _sweep_of_simulated(options, real, plan.settings(blocks), plant, log)
    if blocks:
        _print_blocks(on_blocks(swept.log, swept.neutral, NEAR_NEUTRAL))
        return
    with options.lasting("fitting"):
        fit = fit_dac(swept.log, swept.neutral, swept.body.track)
    options.keep(swept.name, swept.body, dac=fit.model, family=swept.family)
    if plot is not None:
        plot_fit(fit, plot)
    _print_fit(options, fit)


def _sweep_from_csv(options: ChairOptions, plan: SweepOptions, csv: Path, neutral: tuple[float, float]) -> _Sweep:
    from waychair.calibration.fits.drive_log import read_sweep_log

    name, body = options.real("--csv")
    return _Sweep(name, body, neutral, read_sweep_log(csv, plan.bits, plan.volts_max, plan.volts_min))


def _sweep_of_simulated(
    options: ChairOptions, real: PortOptions, plan: SweepSettings, plant: PlantName, log: Path | None
) -> _Sweep:
    from waychair.trials.simulated_calibration import SIMULATED_FAMILY, chair_in_hall

    body, settings = options.simulated(plant)
    chair = chair_in_hall(settings, body, options.seed, encoders=real.speeds_from == "encoders")
    return _Sweep(options.simulated_name, body, chair.neutral, _swept(options, chair, plan, log), SIMULATED_FAMILY)


def _sweep_of_real(options: ChairOptions, real: PortOptions, plan: SweepSettings, log: Path | None) -> _Sweep:
    from waychair.calibration.drives.board_drive import plan_for_board
    from waychair.calibration.drives.dac_and_stops import ChairUnderTest
    from waychair.cli.options.real_chair import armed_chair

    name, body = options.real("--port")
    with armed_chair(real, body, name) as drive:
        chair = ChairUnderTest(drive, drive.neutral, body)
        kept, suited = log or options.file.with_suffix(".sweep.csv"), plan_for_board(plan, drive)
        swept = _swept(options, chair, suited, kept)
    options.say(
        f"{kept}: neutral {chair.neutral[0]:.3f} {chair.neutral[1]:.3f} V, {suited.bits} bits from "
        f"{suited.volts_min:g} to {suited.volts_max:g} V, joystick family {drive.family.name.lower()}"
    )
    return _Sweep(name, body, chair.neutral, swept, drive.family.name.lower())


def _swept(options: ChairOptions, chair: ChairUnderTest, plan: SweepSettings, log: Path | None) -> SweepLog:
    from waychair.calibration.fits.sweep import Recorder, sweep
    from waychair.cli.options.real_chair import keeping

    recorder = Recorder(chair.drive, plan.bits, plan.volts_max, plan.volts_min)
    with keeping(log, recorder), options.progress("sweeping") as show:
        return sweep(recorder, chair.neutral, plan, show)


def _print_blocks(axes: tuple[OnBlocks, OnBlocks]) -> None:
    for axis, found in zip(("forward", "turn"), axes, strict=True):
        print(
            f"{axis}: neutral {found.neutral:.3f} V, dead band {1e3 * found.dead_band_below:.0f} mV below and "
            f"{1e3 * found.dead_band_above:.0f} mV above, {'above' if found.sign > 0 else 'below'} is positive"
        )


def _print_fit(options: ChairOptions, fit: DacFit) -> None:
    for axis, model, step, unit in zip(
        ("forward", "turn"), (fit.model.forward, fit.model.turn), fit.steps, ("m/s", "rad/s"), strict=True
    ):
        options.say(
            f"{axis}: dead band {1e3 * model.below.dead_band:.0f} mV below and {1e3 * model.above.dead_band:.0f} mV "
            f"above neutral, up to {model.below.limit:.2f} and {model.above.limit:.2f} {unit}, delay "
            f"{1e3 * step.delay_s:.0f} ms, lag {1e3 * step.lag_s:.0f} ms"
        )
    options.say(
        f"{fit.holds} holds, {fit.unsettled} more had not settled, {fit.outliers} outliers; rms "
        f"{1e3 * fit.rms[0]:.1f} mm/s and {1e3 * fit.rms[1]:.1f} mrad/s"
    )
    if fit.outliers > _MANY_OUTLIERS * fit.holds:
        options.say(
            "many holds do not fit, as the model does not cover this chair's electronics: check the fit with --plot"
        )


@calibrate_app.command(name="stop")
def stop_command(
    *,
    options: ChairOptions = _CHAIR,
    real: PortOptions = _REAL,
    plant: PlantName = "kinematic",
    fastest: float | None = None,
    repetitions: NonNegativeInt = 3,
    log: Path | None = None,
) -> None:
    """Measure the chair's stopping distances, forward, in reverse and turning; the worst case is stored.

    A chair without measured stops drives at 0.3 m/s at most. Run `waychair calibrate dac` first.

    Parameters
    ----------
    plant
        kinematic: wheels follow their commands; mujoco: mass, motors, casters and slip.
    fastest
        Highest speed to stop from, in m/s; default the chair's top speed.
    repetitions
        Number of stops of each kind.
    log
        CSV file for the drive; with --port the default is beside the chair's file. An aborted drive is kept as
        NAME.part.
    """
    from waychair.calibration.calibration_file import load_calibration
    from waychair.calibration.drives.dac_and_stops import ChairUnderTest
    from waychair.calibration.fits.stopping import StopSettings
    from waychair.cli.options.real_chair import armed_chair
    from waychair.errors import CalibrationError
    from waychair.trials.simulated_calibration import chair_in_hall

    known = load_calibration(options.file, options.chair_id if real.port else options.simulated_name)
    if known.dac is None:
        raise CalibrationError(f"{options.file} holds no model of the joystick: run `waychair calibrate dac` first")
    plan = StopSettings(fastest=fastest or StopSettings().fastest, repetitions=repetitions)
    if real.port is not None:
        with armed_chair(real.of_family(known.family), known.body, known.chair_id) as drive:
            chair = ChairUnderTest(drive, drive.neutral, known.body)
            kept = log or options.file.with_suffix(".stops.csv")
            table, stops = _stopped(options, chair, known.dac, plan, kept)
    else:
        body, settings = options.simulated(plant)
        chair = chair_in_hall(settings, body, options.seed, encoders=real.speeds_from == "encoders")
        table, stops = _stopped(options, chair, known.dac, plan, log)
    options.keep(known.chair_id, chair.body, stops=table)
    _print_stops(options, table, stops)


def _stopped(
    options: ChairOptions, chair: ChairUnderTest, model: FittedDac, plan: StopSettings, log: Path | None
) -> tuple[StopTable, tuple[MeasuredStop, ...]]:
    from waychair.calibration.drives.dac_and_stops import calibrate_stops
    from waychair.calibration.fits.sweep import Recorder
    from waychair.cli.options.real_chair import keeping

    recorder = Recorder(chair.drive, model.bits, model.volts_max, model.volts_min)
    with keeping(log, recorder), options.progress("stopping") as show:
        return calibrate_stops(replace(chair, drive=recorder), model, plan, show)


def _print_stops(options: ChairOptions, table: StopTable, stops: tuple[MeasuredStop, ...]) -> None:
    from waychair.calibration.fits.stopping import permitted_speed

    for speed, distance in zip(table.speeds, table.distances, strict=True):
        options.say(f"from {speed:.2f} m/s within {distance:.2f} m")
    options.say(
        f"{len(stops)} stops, worst delay {table.delay_s:.2f} s; up to {permitted_speed(table):.2f} m/s permitted"
    )


@calibrate_app.command(name="wheels")
def wheels_command(
    *,
    options: ChairOptions = _CHAIR,
    plant: PlantName = "kinematic",
    against: Literal["truth", "map"] = "truth",
    recording: Path | None = None,
    trajectory: Path | None = None,
) -> None:
    """Find the radius of each drive wheel and the track, from a square driven in both directions.

    With --recording and --trajectory the encoders come from the bag of a real drive, and the poses from the
    trajectory.tum that `waychair map` made of it. Drive two squares to the left and two to the right, or turn on the
    spot to both sides during the drive.

    Parameters
    ----------
    plant
        kinematic: wheels follow their commands; mujoco: mass, motors, casters and slip.
    against
        truth: the simulator's true poses; map: poses by lidar localisation on a map.
    recording
        Bag of a real drive with joint states of both drive wheels.
    trajectory
        Poses of the same drive (trajectory.tum).
    """
    from waychair.calibration.drives.recorded_drives import wheels_from_recording
    from waychair.trials.simulated_calibration import WHEELS_HALL, calibrate_wheels

    if recording is not None or trajectory is not None:
        if recording is None or trajectory is None:
            raise BadArgument("--recording and --trajectory belong together: give both or none")
        name, body = options.real("--recording")
        with options.lasting("fitting the wheels"):
            wheels = wheels_from_recording(recording, trajectory, body)
    else:
        from waychair.simulation.simulator import Simulator
        from waychair.trials.open_hall import open_hall

        name, (body, settings) = options.simulated_name, options.simulated(plant)
        simulator = Simulator(open_hall(WHEELS_HALL, 0.05), body, settings, options.seed)
        with options.lasting("driving squares") as tell:
            wheels = calibrate_wheels(
                simulator, mapped=against == "map", progress=lambda way: tell(f"{way:.0f} m driven")
            )
    options.keep(name, body, wheels=wheels)
    options.say(
        f"radius {1e3 * wheels.left_radius:.2f} mm left, {1e3 * wheels.right_radius:.2f} mm right; "
        f"track {1e3 * wheels.track:.1f} mm"
    )


@calibrate_app.command(name="imu")
def imu_command(
    *,
    options: ChairOptions = _CHAIR,
    seconds: float = 60.0,
    recording: Path | None = None,
) -> None:
    """Find bias and noise of the inertial unit; the chair stands still on a level floor.

    Parameters
    ----------
    seconds
        Length of the simulated recording; 20 or more.
    recording
        Bag of a real chair at rest; --seconds has no effect then.
    """
    from waychair.calibration.drives.recorded_drives import imu_from_recording
    from waychair.trials.simulated_calibration import calibrate_imu

    if recording is not None:
        name, body = options.real("--recording")
        with options.lasting("reading"):
            imu = imu_from_recording(recording)
    else:
        from waychair.simulation.simulator import Simulator
        from waychair.trials.open_hall import open_hall
        from waychair.trials.simulated_drive import with_gyro

        name, (body, settings) = options.simulated_name, options.simulated()
        simulator = Simulator(open_hall(), body, with_gyro(settings), options.seed)
        with options.progress("resting") as show:
            imu = calibrate_imu(simulator, seconds, show)
    options.keep(name, body, imu=imu)
    rates, forces = (" ".join(f"{value:+.4f}" for value in bias) for bias in (imu.gyro_bias, imu.accel_bias))
    options.say(f"gyro bias {rates} rad/s, noise {imu.gyro_noise:.2g} rad/s/sqrt(Hz)")
    options.say(f"accel bias {forces} m/s^2, noise {imu.accel_noise:.2g} m/s^2/sqrt(Hz)")


@calibrate_app.command(name="camera")
def camera_command(*, options: ChairOptions = _CHAIR, recording: Path | None = None) -> None:
    """Find the camera's pose relative to the lidar, from walls and floor that both see.

    The simulated chair's camera is off its nominal place by centimetres and degrees, depending on the seed.

    Parameters
    ----------
    recording
        Bag with scans, pictures and depth of a real chair that alternately turned and rested in a room with bare walls.
        --chair must give the places of lidar and camera to within some centimetres.
    """
    from waychair.calibration.calibration_file import mount_from_extrinsics
    from waychair.calibration.drives.camera_views import nominal_mount
    from waychair.calibration.drives.recorded_drives import camera_from_recording
    from waychair.trials.simulated_calibration import calibrate_camera, with_displaced_camera

    if recording is not None:
        name, body = options.real("--recording")
        with options.lasting("reading"):
            found = camera_from_recording(recording, body)
    else:
        name, (body, settings) = options.simulated_name, options.simulated()
        true = with_displaced_camera(body, options.seed)
        with options.progress("looking round") as show:
            found = calibrate_camera(true, nominal_mount(body), settings, options.seed, progress=show)
    options.keep(name, body, camera=mount_from_extrinsics(found))
    x, y, z = found.camera_from_laser.translation
    options.say(
        f"the lidar is at ({x:.3f}, {y:.3f}, {z:.3f}) m in the camera's frame; {found.points} points fit their "
        f"planes to {1e3 * found.rms_m:.0f} mm"
    )


@calibrate_app.command(name="body")
def body_command(chair: Path, /, *, options: ChairOptions = _CHAIR) -> None:
    """Write a chair's dimensions, measured by tape, into its calibration file.

    The .yaml file holds lines such as `body: {length: 1.05, width: 0.62, axle_from_rear: 0.3, track: 0.55,
    wheel_radius: 0.17, laser_x: 0.55, laser_z: 0.3}`; the keys that it lacks have the values of the built-in chair A. Run it
    again after a change to the seat, the leg rests or the sensors' mounts.

    Parameters
    ----------
    chair
        The .yaml file.
    """
    named = replace(options, chair=str(chair))
    name, body = named.real("`waychair calibrate body`")
    named.keep(name, body)
    options.say(
        f"{body.length:g} m long, {body.width:g} m wide, {body.axle_from_rear:g} m from the rear end to the axle"
    )
