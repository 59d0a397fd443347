"""The last check before a port is opened: a simulated chair's calibration never meets a real board."""

from __future__ import annotations

from pathlib import Path

from waychair.calibration.calibration_file import ChairCalibration, check_measured, check_real
from waychair.errors import TransportError
from waychair.firmware_bridge.transports import Transport, is_pseudo_terminal, transport_from_text


def is_real(cable: str) -> bool:
    """Return whether a cable (/dev/..., pty:PATH or tcp:HOST:PORT) leads to a real board.

    A pseudo-terminal leads to a program on this computer, such as the simulator. A port that is not there counts as real
    unless it is given as pty:PATH.
    """
    return cable.startswith("tcp:") or not (cable.startswith("pty:") or is_pseudo_terminal(cable))


def check_cable(cable: str, calibration: ChairCalibration, source: str) -> None:
    """Check that a calibration from a chair's file may drive the chair at the end of a cable; `source` names the file.

    Raises:
        CalibrationMismatch: the board is real, and the calibration is that of a simulated chair, or has its dimensions.
        CalibrationError: the chair's joystick was not measured.
    """
    if is_real(cable):
        check_real(calibration, source)
    else:
        check_measured(calibration, source)


def open_cable(cable: str, calibration: ChairCalibration) -> Transport:
    """Open the cable of the chair with this calibration.

    Raises:
        TransportError: see `transport_from_text`; or the calibration is a simulated chair's and the board is real, also
            where a link led to a simulated board before.
    """
    path = Path(cable.removeprefix("pty:"))
    real = is_real(cable) or (path.exists() and not is_pseudo_terminal(str(path)))
    if calibration.is_simulated and real:
        raise TransportError(
            f"{cable} is the port of a real board, which the calibration of the simulated chair '{calibration.chair_id}' must "
            "not drive: start with the chair's own file (--chair)"
        )
    return transport_from_text(cable, "cable")
