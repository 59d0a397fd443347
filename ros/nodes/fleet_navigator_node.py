"""The navigator node of a chair that shares its building with others: goals wait for their way, and stop lines hold.

It is the navigator node with a `FleetPort`: the fleet's file is named by the environment (`waychair up --fleet`). Goals are
places of the traffic graph. It also sends `other_chairs`, for the page.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

from waychair.errors import ConfigError, FleetError
from waychair.maps.drawn.zones import Zone
from waychair.ros import topics
from waychair.ros.messages.others import others
from waychair.ros.nodes.navigator_node import NavigatorNode
from waychair.ros.nodes.node import run_node
from waychair.runtime.fleet.chair_fleet import joined_fleet
from waychair.runtime.fleet.fleet_port import FleetPort
from waychair.runtime.fleet.network.peer_process import PARKED_NS, STEP_S, clock_ns, new_boot
from waychair.runtime.fleet.prompt_answers import PromptAnswers
from waychair.types import DriveMode, Goal, Pose2

_STEP_HZ, _OTHERS_HZ = 10.0, 5.0
_LOOKS_HZ = 50.0
"""Rate at which the node looks whether it may enter more than at its last step."""

_BY_RIDER = frozenset({DriveMode.MANUAL, DriveMode.GUARDED, DriveMode.ASSISTED})
_MOVES = 0.02  # m/s or rad/s


class FleetNavigatorNode(NavigatorNode):
    """A navigator among other chairs."""

    def __init__(self) -> None:
        self._port: FleetPort | None = None
        self._ported: object = None  # the pilot for which the port was made
        self._trouble = ""
        super().__init__()
        try:
            self._joined = joined_fleet()
        except FleetError as error:
            raise ConfigError(str(error)) from None
        self.at_end(self._joined.transport.close)
        self.at_end(self._say_parked)
        self.at_end(PromptAnswers(self._joined.transport, self._answer).close)
        self._boot = new_boot()
        self._tell_others = self.publisher(topics.OTHERS)
        self.every(_STEP_HZ, self._step_fleet)
        self.every(_LOOKS_HZ, self._go_on_at_once)
        self.every(_OTHERS_HZ, self._show_others)

    def begin_leg(self, goal: Goal, goal_id: int) -> None:
        """Start a drive to a place, which waits for its way; see `NavigatorNode.begin_leg`.

        Raises:
            ConfigError: also where the goal is no place of the traffic graph, or the chair is on none of its ways.
        """
        super().begin_leg(goal, goal_id)
        assert isinstance(goal.target, Pose2)
        try:
            if self._port is None:
                raise FleetError(self._trouble or "the chair is not localised: wait until it is")
            self._port.ask(goal.target, clock_ns())
            self._step_fleet()
        except FleetError as error:
            self.cancel_leg()
            raise ConfigError(str(error)) from None

    def _pass_scan(self) -> None:
        scan, located = self._latest.scan, self._latest.located
        super()._pass_scan()
        if self._port is not None and scan is not None and located is not None and self._latest.scan is None:
            self._port.see(self._calibration.masked(scan), located[1].map_from_base)

    def _step_fleet(self) -> None:
        pilot, grid = self.pilot, self._layout.grid
        if pilot is None or grid is None:
            return
        if self._ported is not pilot:
            self._ported, self._port, self._trouble = pilot, None, ""
            try:
                self._port = FleetPort(
                    self._joined.fleet,
                    self._joined.number,
                    self._boot,
                    self._joined.transport,
                    self._calibration.body,
                    grid,
                    self._layout.places,
                    self._redraw,
                    self._joined.log,
                    self._joined.memory,
                )
            except FleetError as error:
                self._trouble = str(error)
                self.get_logger().error(self._trouble)
        if self._port is None:
            return
        state, twist = self._latest.state, self._track.twist
        moves = max(abs(twist.v), abs(twist.omega)) > _MOVES
        by_rider = state is not None and state.mode in _BY_RIDER and moves
        pose = self.map_from_base(self.now_ns())
        for said in self._port.step(clock_ns(), pose, pilot, by_rider, self._navigation, stands=not moves):
            self.get_logger().warning(said)

    def _say_parked(self) -> None:
        """Tell the others that the chair is about to be switched off."""
        if self._port is None:
            return
        self._port.park()
        ends_ns = clock_ns() + PARKED_NS
        while clock_ns() < ends_ns:
            self._step_fleet()
            self._joined.transport.wait(STEP_S)

    def _answer(self) -> None:
        """Answer other chairs; another thread calls it."""
        port = self._port
        if port is not None:
            port.answer(clock_ns())

    def _go_on_at_once(self) -> None:
        if self._port is not None and self._port.has_news:
            self._step_fleet()

    def _show_others(self) -> None:
        if self._port is not None:
            self._tell_others(others(self._port.others))

    def _redraw(self, bars: tuple[Zone, ...], then: Callable[[], None]) -> None:
        pilot, grid, places, zones = self.pilot, self._layout.grid, self._layout.places, self._layout.zones
        assert pilot is not None
        assert grid is not None

        def drawn() -> Callable[[], None]:
            found = pilot.drawn(grid, (*zones, *bars))

            def take() -> None:
                pilot.redraw(found, places)
                then()

            return take

        self.worker.submit(drawn, lambda take: take())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node's process, and return its exit code."""
    return run_node(FleetNavigatorNode, arguments)


if __name__ == "__main__":
    sys.exit(main())
