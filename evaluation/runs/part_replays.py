"""The parts of a chair, each fed from a tape alone: odometry, localiser, pilot, and base.

Each replay returns the part's outputs, a row per tick (localiser: per scan).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from evaluation.runs.replay import DIGITS, Row, Tape, TapedTick, Value
from waychair.calibration.calibration_file import ChairCalibration
from waychair.control.drive.navigation import ACTIVE
from waychair.control.safety.stops import STOPS, Halt
from waychair.control.safety.supervisor import SupervisorVerdict
from waychair.firmware_bridge.transports import Reconnecting
from waychair.runtime.black_box.box_file import LoggedHalt, LoggedLocalisation, Moment, Tick
from waychair.runtime.drive_base import DriveBase
from waychair.runtime.pilot import Pilot
from waychair.slam.localising.localisation import Localisation, LocalisationState
from waychair.slam.localising.localiser import Localiser
from waychair.slam.odometry.odometry_filter import OdometryFilter
from waychair.trials.drive import DriveSetup, calibration_of
from waychair.types import ImuSample, Pose2, RgbdFrame, Scan, SonarReadings, Twist, WheelTicks


def part_replays(setup: DriveSetup) -> Mapping[str, Callable[[Tape], list[Row]]]:
    """Return, by part name, the function from a tape to the part's outputs."""
    calibration = calibration_of(setup)
    return {
        "odometry": lambda tape: _replay_odometry(tape, calibration),
        "localiser": lambda tape: _replay_localiser(tape, setup, calibration),
        "pilot": lambda tape: _replay_pilot(tape, setup, calibration),
        "base": lambda tape: _replay_base(tape, setup, calibration),
    }


def _replay_odometry(tape: Tape, calibration: ChairCalibration) -> list[Row]:
    """Replay the odometry filter; one row per tick."""
    filter_, rows = OdometryFilter(calibration.body), list[Row]()
    for _, moment in tape.moments():
        reading = None
        for message in moment.heard:
            if isinstance(message, WheelTicks):
                reading = filter_.update_wheels(message)
            elif isinstance(message, ImuSample):
                reading = filter_.update_imu(message)
        if reading is not None:
            spread = 0.0 if reading.covariance is None else math.sqrt(float(np.trace(reading.covariance)))
            pose, twist = reading.odom_from_base, reading.twist
            values = {"slipping": filter_.slipping, "sigma": spread, "v": twist.v, "omega": twist.omega}
            rows.append(_row(**_pose(pose), **values))
    return rows


def _replay_localiser(tape: Tape, setup: DriveSetup, calibration: ChairCalibration) -> list[Row]:
    """Replay the localiser with the tape's odometry; one row per scan."""
    known = setup.grid if setup.scanned is None else setup.scanned
    localiser = Localiser(known, calibration.body.base_from_laser, tape.start, setup.chair.localiser)
    rows = []
    for taped, moment in tape.moments():
        for scan in moment.heard:
            if isinstance(scan, Scan) and taped.odom_from_base is not None:
                found = localiser.process(
                    calibration.masked(scan), taped.odom_from_base, _twist_at_scan(taped, moment.tick)
                )
                away = math.hypot(found.remaining.x, found.remaining.y)
                values = {"state": found.state.value, "health": found.health, "inliers": found.inliers}
                rows.append(_row(**_pose(found.map_from_base), **values, remaining=away, jumped=found.jumped))
    return rows


def _replay_pilot(tape: Tape, setup: DriveSetup, calibration: ChairCalibration) -> list[Row]:
    """Replay pilot and navigator with the tape's poses, verdicts and commands."""
    pilot = Pilot(
        grid=setup.grid,
        places=setup.places,
        body=calibration.body,
        settings=setup.chair,
        stops=calibration.stops,
        zones=setup.zones,
    )
    rows = []
    for taped, moment in tape.moments():
        tick = moment.tick
        for told in taped.told:
            if told.what == "go":
                pilot.go(*told.goals)
        _show(pilot, taped, moment, calibration)
        pilot.expire(tick.stamp_ns)
        halt = None if tick.halt is None else _halt(tick.halt)
        pilot.obey(SupervisorVerdict(tick.mode, tick.reason, tick.share, halt, drops_goal=tick.drops_goal))
        map_from_odom = None if tick.located is None else tick.located.map_from_odom
        found = pilot.step(tick.stamp_ns, tick.map_from_base, map_from_odom)
        pilot.note_sent(tick.command if tick.sent.active else None, "")
        way = 0.0 if found.path is None else found.path.length()
        values = {"stage": found.stage.value, "reason": found.reason, "plans": found.plans, "goals": found.goals}
        rows.append(_row(**values, v=found.twist.v, omega=found.twist.omega, way=way))
    return rows


def _show(pilot: Pilot, taped: TapedTick, moment: Moment, calibration: ChairCalibration) -> None:
    """Pass a tick's scans, sonar readings and pictures to the pilot; without an IMU, a picture's tilt is unknown."""
    tick, seen_from = moment.tick, iter(taped.seen_from)
    for message in moment.heard:
        if isinstance(message, Scan) and tick.located is not None and taped.odom_from_base is not None:
            at_scan = tick.located.map_from_odom @ taped.odom_from_base
            pilot.see(calibration.masked(message), localisation_at(tick.located, at_scan), _twist_at_scan(taped, tick))
        elif isinstance(message, SonarReadings | RgbdFrame):
            pose = next(seen_from)
            if isinstance(message, SonarReadings) and pose is not None:
                pilot.hear(message, pose)
            elif isinstance(message, RgbdFrame) and pose is not None:
                pilot.look(message, pose, None)


def _replay_base(tape: Tape, setup: DriveSetup, calibration: ChairCalibration) -> list[Row]:
    """Replay supervisor, limiter, monitor and bridge with the tape's board bytes and localisations."""
    board = _Replayed()
    cable = Reconnecting(lambda: board)
    base = DriveBase(
        calibration=calibration,
        cable=cable,
        start=tape.start,
        settings=setup.chair,
        model=setup.calibration,
        zones=setup.zones,
    )
    asks = {"go": base.request, "confirm": base.confirm, "stop": base.stop, "reset": base.reset}
    rows = []
    for taped, moment in tape.moments():
        tick = moment.tick
        for told in taped.told:
            asks[told.what]()
        for now_ns, said in taped.beats:
            board.say(said)
            base.beat(now_ns)
        for message in moment.heard:
            base.hear(base.with_true_stamp(message))
            if isinstance(message, Scan) and tick.located is not None:
                base.locate(localisation_at(tick.located, tick.map_from_base), message.stamp_ns)
        board.say(taped.answers)
        verdict, _ = base.supervise(tick.stamp_ns, taped.active)
        drives = tick.stage in {stage.value for stage in ACTIVE}
        driven = base.drive(tick.stamp_ns, verdict, tick.asked if drives else None)
        command = driven.command or Twist()
        rows.append(
            _row(
                mode=verdict.mode.value,
                halts=" ".join(sorted(halted.stop.id for halted in base.halts)),
                reason=verdict.reason,
                commands=driven.command is not None,
                v=command.v,
                omega=command.omega,
                active=driven.sent.active,
                forward_volts=driven.sent.forward_volts,
                turn_volts=driven.sent.turn_volts,
                **_pose(base.motion.map_from_base(tick.stamp_ns)),
            )
        )
    return rows


class _Replayed:
    """A transport that delivers the given bytes and accepts everything written."""

    closed = False

    def __init__(self) -> None:
        self._says = b""

    def say(self, data: bytes) -> None:
        """Append bytes to be read."""
        self._says += data

    def write(self, data: bytes) -> bool:
        return True

    def read(self) -> bytes:
        data, self._says = self._says, b""
        return data

    def fileno(self) -> int:
        return -1

    def close(self) -> None:
        pass


def _twist_at_scan(taped: TapedTick, tick: Tick) -> Twist:
    """Return the twist at a tick's scan; for a tape that lacks it, that of the tick's end."""
    return taped.twist_at_scan or tick.twist


def localisation_at(located: LoggedLocalisation, map_from_base: Pose2) -> Localisation:
    """Return the localisation of a log, with its pose in map."""
    return Localisation(
        map_from_base=map_from_base,
        map_from_odom=located.map_from_odom,
        inliers=located.inliers,
        state=LocalisationState(located.state),
        health=located.health,
        remaining=located.remaining,
        jumped=located.jumped,
    )


def _halt(halted: LoggedHalt) -> Halt:
    return Halt(STOPS[halted.id], halted.text)


def _pose(pose: Pose2) -> dict[str, Value]:
    return {"x": pose.x, "y": pose.y, "theta": pose.theta}


def _row(**values: Value) -> Row:
    return {name: round(value, DIGITS) if isinstance(value, float) else value for name, value in values.items()}
