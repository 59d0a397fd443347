"""The section that a chair finds shut: it has stood before it for a while, for something that is no other chair."""

from __future__ import annotations

import math
from collections.abc import Iterable

from waychair.control.drive.navigation import Navigation, Stage
from waychair.runtime.fleet.chain_driving import ChainDriver
from waychair.types import Pose2

CHAIR_AHEAD = 8.0
"""m; with another chair so near, a chair that does not get on waits for that chair."""

BLOCKED_AFTER_MS, UNPLANNED_AFTER_MS, BLOCKED_FOR_MS = 2_000, 8_000, 120_000
"""ms that a chair stands before a way counts as closed, the same without a first plan, and for how long it is closed."""

NO_WAY_ROUND_MS = 40_000
"""ms that a chair stands before a section without a way round it: mostly for people, who go on by themselves."""


class ShutWays:
    """How long one chair has stood without a way."""

    def __init__(self, driver: ChainDriver) -> None:
        self._driver = driver
        self._stuck_ms: int | None = None

    def step(
        self, now_ms: int, navigation: Navigation, pose: Pose2, held: bool, others: Iterable[Pose2]
    ) -> dict[str, int]:
        """Return the section that is shut before a chair at `pose` in map, with the time for which that counts [ms], once.

        `held`: it stands for another chair. `others`: poses of the other chairs in map, as far as they are known.
        """
        has_no_way = navigation.stage is Stage.WAITING and navigation.path is None
        stands = has_no_way or navigation.stage is Stage.OFFERING
        near = any(math.dist((pose.x, pose.y), (other.x, other.y)) < CHAIR_AHEAD for other in others)
        if not stands or held or near:
            self._stuck_ms = None
            return {}
        self._stuck_ms = now_ms if self._stuck_ms is None else self._stuck_ms
        section = self._driver.section_ahead()
        patience_ms = BLOCKED_AFTER_MS if navigation.plans else UNPLANNED_AFTER_MS
        if section is None or not self._driver.has_way_round(section):
            patience_ms = NO_WAY_ROUND_MS
        if now_ms - self._stuck_ms < patience_ms:
            return {}
        self._stuck_ms = None  # the way from here is another one now
        return {} if section is None else {section: BLOCKED_FOR_MS}
