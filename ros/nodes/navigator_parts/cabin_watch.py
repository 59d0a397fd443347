"""The lifts of the map in use, watched while no journey does: a chair in one whose door is not open may be taken elsewhere."""

from __future__ import annotations

from pathlib import Path

from waychair.control.journey.building_legs import sites_of_building
from waychair.control.journey.door_view import is_shut_in
from waychair.control.journey.lift_site import LiftSite, pose_in_same_lift
from waychair.errors import WaychairError
from waychair.planning.building.learnt_drives import building_of_map
from waychair.ros.messages.floor import Floor
from waychair.ros.nodes.navigator_parts.remote_chair import AGAIN_S, ChairNow, LegDriver
from waychair.ros.nodes.worker import Worker
from waychair.slam.localising.localisation import LocalisationState
from waychair.types import Pose2, Scan


class CabinWatch:
    """Sees whether the chair is in a lift whose door is closed, or not seen."""

    def __init__(self, driver: LegDriver, base_from_laser: Pose2, worker: Worker) -> None:
        """`worker` loads the lifts of each map."""
        self._driver, self._base_from_laser, self._worker = driver, base_from_laser, worker
        self._folder, self._storey = "", ""
        self._sites: tuple[LiftSite, ...] = ()
        self.shut_in = False
        """Whether the chair was in such a lift by the last scan."""
        self._doubted_ns = -(10**12)

    def doubts(self, now: ChairNow) -> bool:
        """Return whether the storey is to be told as uncertain now; what was not obeyed is repeated after a while."""
        if now.floor is None:
            return False
        self._follow(now.floor)
        due = now.stamp_ns - self._doubted_ns > AGAIN_S * 1e9
        if not (self.shut_in and now.floor.certain and due):
            return False
        self._doubted_ns = now.stamp_ns
        return True

    def pose_on(self, storey: str) -> Pose2 | None:
        """Return the chair's pose on a storey's map as far as it follows from that on the present one: on the same, or by the lift
        in which the chair is; None otherwise.
        """
        now = self._driver.now()
        lost = now.localisation is None or now.localisation.state is LocalisationState.LOST
        if lost or now.map_from_base is None or now.floor is None:
            return None
        if storey == now.floor.storey:
            return now.map_from_base
        return pose_in_same_lift(self._sites, self._storey, now.map_from_base, storey)

    def _follow(self, floor: Floor) -> None:
        """Know the lifts of the map in use; of a damaged building none, of which others tell."""
        if floor.map_folder == self._folder:
            return
        self._folder, self._storey, self._sites, self.shut_in = floor.map_folder, floor.storey, (), False

        def loaded() -> tuple[LiftSite, ...]:
            try:
                found = building_of_map(Path(floor.map_folder)) if floor.storey else None
                return () if found is None else sites_of_building(found[0].hgraph)
            except WaychairError:
                return ()

        def take(sites: tuple[LiftSite, ...]) -> None:
            if floor.map_folder == self._folder:
                self._sites = sites

        self._worker.submit(loaded, take)

    def look(self, scan: Scan) -> None:
        """Take in a scan."""
        pose = self._driver.now().map_from_base
        self.shut_in = pose is not None and is_shut_in(scan, self._sites, self._storey, pose, self._base_from_laser)
