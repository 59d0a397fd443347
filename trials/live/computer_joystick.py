"""A joystick of this computer, by Linux's joystick interface (linux/joystick.h), for a person who plays a game or drives a simulated
chair."""

from __future__ import annotations

import contextlib
import logging
import os
import struct
from pathlib import Path

from waychair.errors import JoystickError
from waychair.simulation.simulator import Simulator
from waychair.types import JoystickInput

REST = 0.06
"""Share of the swing; a smaller reading counts as rest, because cheap joysticks do not come back to zero."""

MOST_EVENTS = 256
"""Events that are read at once; a joystick sends far fewer in a heartbeat, a file that is none may never end."""

AGAIN_NS = 1_000_000_000
"""ns between two tries to open a joystick that was unplugged."""

_EVENT = struct.Struct("<IhBB")
"""An event: time, value, type, number."""

_AXIS = 2
_FULL = 32767.0


class ComputerJoystick:
    """A joystick such as /dev/input/js0; only its first two axes count. `close` it at the end."""

    def __init__(self, path: Path) -> None:
        """Open the joystick.

        Raises:
            JoystickError: there is no such joystick, or it may not be read.
        """
        self._axes = [0.0, 0.0]  # to the right, to the rear
        try:
            self._device = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        except OSError as error:
            raise JoystickError(
                f"the joystick {path} cannot be opened ({error.strerror}): name one of /dev/input/js*"
            ) from error

    def read(self, now_ns: int) -> JoystickInput:
        """Return the stick as it is now.

        Raises:
            JoystickError: it was unplugged.
        """
        for _ in range(MOST_EVENTS):
            try:
                event = os.read(self._device, _EVENT.size)
            except BlockingIOError:
                break
            except OSError as error:
                raise JoystickError(f"the joystick is lost ({error.strerror}): plug it in again") from error
            if len(event) < _EVENT.size:
                raise JoystickError("the joystick is lost: plug it in again")
            _, value, kind, number = _EVENT.unpack(event)
            if kind & _AXIS and number < len(self._axes):
                self._axes[number] = max(value / _FULL, -1.0)
        forward, turn = (0.0 if abs(axis) < REST else -axis for axis in reversed(self._axes))
        return JoystickInput(now_ns, forward, turn)

    def close(self) -> None:
        """Close the device."""
        os.close(self._device)


class SteersByComputer:
    """Moves a simulated chair's own joystick as a joystick of this computer; `close` it at the end.

    One that is unplugged counts as at rest, with a warning, and is taken up again as soon as it is back.
    """

    def __init__(self, path: Path) -> None:
        """Open the joystick; raises as `ComputerJoystick`."""
        self._path = path
        self._stick: ComputerJoystick | None = ComputerJoystick(path)
        self._tried_ns = 0

    def beat(self, simulator: Simulator) -> None:
        """Move the chair's joystick; to be called at each heartbeat."""
        now_ns = simulator.now_ns
        simulator.rider = JoystickInput(now_ns)
        if self._stick is None and now_ns - self._tried_ns >= AGAIN_NS:
            self._tried_ns = now_ns
            with contextlib.suppress(JoystickError):
                self._stick = ComputerJoystick(self._path)
        if self._stick is None:
            return
        try:
            simulator.rider = self._stick.read(now_ns)
        except JoystickError as error:
            logging.getLogger(__name__).warning("%s", error)
            self._tried_ns = now_ns
            self.close()

    def close(self) -> None:
        """Close the joystick."""
        if self._stick is not None:
            self._stick.close()
            self._stick = None
