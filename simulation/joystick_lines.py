"""The joystick lines of a simulated chair, held by a board, by volts from outside, or by the rider's stick alone."""

from __future__ import annotations

import math
from dataclasses import replace

from waychair.firmware_bridge.board import BoardInputs, HostBoard, LineState, at_rest
from waychair.simulation.plant.plant import PlantSettings, volts_from_joystick
from waychair.types import JoystickInput


class JoystickLines:
    """The lines and their holder; `rider` is the rider's stick.

    `inputs`: the board's other inputs (reference line, e-stop, a defect). `state` is that of the lines after the board's
    last step; None before a board was wired in.
    """

    def __init__(self, plant: PlantSettings) -> None:
        self.rider = JoystickInput(0)
        self.inputs: BoardInputs = at_rest()
        self.state: LineState | None = None
        self._plant = plant
        self._board: HostBoard | None = None
        self._held: tuple[float, float] | None = None

    @property
    def volts(self) -> tuple[float, float]:
        """Volts (forward, turn) on the lines; turn volts above neutral turn right."""
        if self._board is not None and self.state is not None:
            return self.state.forward_mv / 1000.0, self.state.turn_mv / 1000.0
        return self._held or self._stick_volts()

    def wire(self, board: HostBoard | None, now_ns: int) -> None:
        """Connect a board between the rider's stick and the lines, or remove it."""
        self._board = board
        if board is not None:
            self.inputs = at_rest(board.settings.family)
            self.step(now_ns)

    def hold(self, forward_volts: float, turn_volts: float) -> None:
        """Hold the lines at these volts.

        Raises:
            ValueError: the volts are not finite, or a board holds the lines.
        """
        if self._board is not None:
            raise ValueError("a board holds the joystick lines: command it, or take it out with `wire(None)`")
        if not (math.isfinite(forward_volts) and math.isfinite(turn_volts)):
            raise ValueError(f"{forward_volts}, {turn_volts} V cannot be put on the lines: give finite volts")
        self._held = (forward_volts, turn_volts)

    def release(self) -> None:
        """Release the lines, so that the rider's stick is on them."""
        self._held = None

    def step(self, now_ns: int) -> None:
        """Run the board, if there is one, up to now; its volts drive the chair in the next step."""
        if self._board is None:
            return
        forward, turn = (round(1000.0 * volts) for volts in self._stick_volts())
        inputs = replace(self.inputs, joystick_forward_mv=forward, joystick_turn_mv=turn)
        self.state = self._board.step(now_ns // 1_000_000, inputs)

    def _stick_volts(self) -> tuple[float, float]:
        return volts_from_joystick(self._plant, self.rider.forward, self.rider.turn)
