"""`waychair calibrate time` and `mask`: the delays of a chair's sensors, and the lidar's view of the chair itself."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from waychair.cli.options.arguments import BadArgument
from waychair.cli.options.chair_options import ChairOptions

if TYPE_CHECKING:
    from waychair.calibration.chair_body import ChairBody
    from waychair.calibration.drives.sensor_delays import TimeCalibrator
    from waychair.recordings.recording import Recording
    from waychair.types import Scan


def time_command(
    recording: Path | None = None,
    /,
    *,
    options: ChairOptions = ChairOptions(),  # noqa: B008
    seconds: float = 30.0,
    camera: bool = True,
    inject: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> None:
    """Find the delays of the stamps of lidar, encoders and camera, relative to the gyro.

    Turns a simulated chair left and right, or reads a recording of a chair that turned left and right for half a minute
    in a static room.

    Parameters
    ----------
    recording
        A ROS bag with an IMU, instead of a simulated chair.
    seconds
        Duration of the simulated chair's turns.
    camera
        Find the camera's delay, too.
    inject
        Delays in ms to add to the stamps of the simulated lidar, encoders and camera, as a test.
    """
    from waychair.calibration.drives.sensor_delays import TimeCalibrator, merged, milliseconds

    if recording is not None:
        if any(inject):
            raise BadArgument("--inject needs a simulated chair: omit it, or omit the recording")
        name, body, read = _recorded(recording, options)
        calibrator = TimeCalibrator(body)
        for frame in read.frames:
            for message in (*frame.imu, *frame.wheels, *([frame.scan] if frame.scan is not None else [])):
                calibrator.add(message)
        for picture in read.pictures() if camera else ():
            calibrator.add(picture)
    else:
        name = options.simulated_name
        body, calibrator = _turned(options, seconds, camera, inject)
    found = calibrator.result()
    for problem in found.problems:
        print(f"waychair: {problem}", file=sys.stderr)
    known = options.known(name)
    options.keep(name, body, sensor_delays=merged(None if known is None else known.sensor_delays, found))
    for sensor, offset in found.offsets.items():
        options.say(f"{sensor}: {milliseconds(offset)} by {offset.turns} turns, correlation {offset.correlation:.4f}")


def mask_command(
    recording: Path | None = None,
    /,
    *,
    options: ChairOptions = ChairOptions(),  # noqa: B008
) -> None:
    """Learn which beams of the lidar hit the chair itself (legs, leg rests, a bag), so that they are no obstacles.

    Turns a simulated chair with visible legs once round, or reads a recording of a chair that turned or drove with its
    rider.

    Parameters
    ----------
    recording
        Any recording that `waychair map` reads, instead of a simulated chair.
    """
    import math

    from waychair.calibration.fits.self_mask import learn_self_mask

    if recording is not None:
        name, body, read = _recorded(recording, options)
        scans = [frame.scan for frame in read.frames if frame.scan is not None]
    else:
        name = options.simulated_name
        body, scans = _seen_while_turning(options)
    mask = learn_self_mask(scans, body)
    options.keep(name, body, self_mask=mask)
    for begin, end, reach in zip(mask.begins, mask.ends, mask.reaches, strict=True):
        options.say(f"{math.degrees(begin):+.1f} to {math.degrees(end):+.1f} degrees: within {reach:.2f} m")
    if not mask.begins:
        options.say("no beam hits the chair itself: none is masked")
    hidden = sum(int(mask.hides(scan).sum()) for scan in scans) / sum(len(scan.ranges) for scan in scans)
    options.say(f"{hidden:.1%} of all readings in {len(scans)} scans hit the chair itself")


def _recorded(path: Path, options: ChairOptions) -> tuple[str, ChairBody, Recording]:
    """Return the chair's name, its body with the recording's lidar mount, and the recording."""
    from waychair.recordings.recording import read_recording

    name, body = options.real("a recording")
    with options.progress("reading") as show:
        read = read_recording(path, progress=show)
    return name, _with_laser_of(read, body), read


def _with_laser_of(recording: Recording, body: ChairBody) -> ChairBody:
    """Return the body with the recording's lidar mount, if the recording has one."""
    from waychair.types import Pose2

    at = recording.base_from_laser
    return body if at == Pose2() else replace(body, laser_x=at.x, laser_y=at.y, laser_theta=at.theta)


def _turned(
    options: ChairOptions, seconds: float, camera: bool, inject: tuple[float, float, float]
) -> tuple[ChairBody, TimeCalibrator]:
    """Turn a simulated chair left and right; return its body and a calibrator with its messages."""
    from waychair.calibration.drives.sensor_delays import TimeCalibrator
    from waychair.calibration.fits.time_offset import SensorDelays, without_delay
    from waychair.simulation.simulator import Simulator, with_all_sensors
    from waychair.trials.open_hall import open_hall
    from waychair.trials.simulated_calibration import TIME_HALL, turns_to_and_fro
    from waychair.trials.simulated_drive import with_gyro

    body, settings = options.simulated()
    settings = with_all_sensors(settings) if camera else with_gyro(settings)
    simulator = Simulator(open_hall(TIME_HALL, 0.05), body, settings, options.seed)
    if simulator.camera_problem is not None:
        print(f"waychair: no camera is simulated: {simulator.camera_problem}", file=sys.stderr)
    late = [round(-1e6 * delay) for delay in inject]
    delays = SensorDelays(*late)
    calibrator = TimeCalibrator(body)
    with options.progress("turning") as show:
        for message in turns_to_and_fro(simulator, seconds, options.seed):
            calibrator.add(without_delay(message, delays))
            show(min(1.0, simulator.now_ns * 1e-9 / seconds))
    return body, calibrator


def _seen_while_turning(options: ChairOptions) -> tuple[ChairBody, list[Scan]]:
    """Turn a simulated chair once round; return its body and scans."""
    from waychair.simulation.simulator import Simulator
    from waychair.trials.open_hall import open_hall
    from waychair.trials.simulated_calibration import MASK_HALL, scans_while_turning, with_legs

    body, settings = options.simulated()
    simulator = Simulator(open_hall(MASK_HALL, 0.05), body, with_legs(settings), options.seed)
    with options.progress("turning") as show:
        return body, scans_while_turning(simulator, progress=show)
