"""Real chairs for `waychair calibrate`: open the ports, ask for confirmation, arm the board, keep the log."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from waychair.calibration.fits.drive_log import write_sweep_log
from waychair.calibration.fits.sweep import Recorder
from waychair.cli.options.arguments import BadArgument
from waychair.cli.options.chair_options import PortOptions
from waychair.errors import WaychairError

if TYPE_CHECKING:
    from waychair.calibration.chair_body import ChairBody
    from waychair.calibration.drives.board_drive import BoardDrive
    from waychair.calibration.drives.measured_speeds import SpeedMeter

CONFIRMATION = "drive"
"""The word that confirms that a chair may drive by itself."""


@contextmanager
def armed_chair(real: PortOptions, body: ChairBody, name: str) -> Iterator[BoardDrive]:
    """Yield a real chair, armed after confirmation on standard input; its lines are released afterwards.

    Raises:
        BadArgument: a port is missing, or the drive was not confirmed.
        BridgeError, TransportError, CalibrationError: see `BoardDrive`.
    """
    from waychair.calibration.calibration_file import is_simulated_name
    from waychair.calibration.drives.board_drive import BoardDrive, DriveLimits
    from waychair.firmware_bridge.protocol import Family
    from waychair.firmware_bridge.transports import transport_from_text

    if real.port is None or real.sensors is None:
        raise BadArgument("a real chair needs --port of its board and --sensors of its sensors")
    if is_simulated_name(name):
        raise BadArgument(
            f"--chair-id {name} is the name of a simulated chair: give this one another name, and its board"
        )
    limits = DriveLimits(max_distance=real.room)
    family = None if real.family is None else Family[real.family.upper()]
    with (
        closing(transport_from_text(real.port, "--port")) as board,
        closing(transport_from_text(real.sensors, "--sensors")) as sensors,
        BoardDrive(board, sensors, _meter(real, body), name, family=family, limits=limits) as drive,
    ):
        _confirm(name, real.room)
        drive.arm()
        yield drive


def _meter(real: PortOptions, body: ChairBody) -> SpeedMeter:
    from waychair.calibration.drives.measured_speeds import EncoderSpeeds, ScanSpeeds

    return EncoderSpeeds(body) if real.speeds_from == "encoders" else ScanSpeeds(body)


def _confirm(name: str, room: float) -> None:
    print(
        f"Chair '{name}' will drive by itself, forward and back, up to {room:g} m from its place.\n"
        "- The floor must be free for that distance all round. A person must be within reach of the emergency stop.\n"
        "- Take your hand off the joystick. Touching it takes control at once; Ctrl-C stops as well.\n"
        f"Type '{CONFIRMATION}' and press Enter to begin: ",
        end="",
        file=sys.stderr,
        flush=True,
    )
    if sys.stdin.readline().strip().lower() != CONFIRMATION:
        raise BadArgument(f"'{CONFIRMATION}' was not typed: the chair does not drive")


@contextmanager
def keeping(log: Path | None, recorder: Recorder) -> Iterator[Recorder]:
    """Write the recorder's samples to `log` after the block, or to NAME.part if the block fails.

    Raises:
        WaychairError: the block's error, with the path of the part.
    """
    try:
        yield recorder
    except (WaychairError, KeyboardInterrupt) as error:
        if log is None or not len(recorder.log().stamps_ns):
            raise
        part = log.with_name(f"{log.name}.part")
        write_sweep_log(part, recorder.log())
        kept = f"the samples until then are in {part}"
        if isinstance(error, KeyboardInterrupt):
            error.add_note(kept)
            raise
        raise type(error)(f"{error}; {kept}") from error
    if log is not None:
        write_sweep_log(log, recorder.log())
