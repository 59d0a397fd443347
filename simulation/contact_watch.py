"""The contacts of a simulated chair with solid things and people, and its falls, each reported once."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from waychair.calibration.chair_body import ChairBody
from waychair.simulation.people.people import CONTACT_GAP
from waychair.simulation.scene.contact import (
    Contact,
    ContactKind,
    SolidBoxes,
    clearance,
    in_contact,
    move_leaves,
    nearest_person,
    nearest_point,
)
from waychair.simulation.scene.scene import Block, PersonState
from waychair.types import Pose2

CONTACT_ENDS = 0.02
"""Distance [m] at which a contact has ended, so that continued pushing counts once."""


class ContactWatch:
    """The contacts of one chair so far (`reports`) and those that last."""

    def __init__(self, body: ChairBody) -> None:
        self.reports: list[Contact] = []
        self._body = body
        self._solid: SolidBoxes
        self._touching: set[ContactKind] = set()

    @property
    def touches(self) -> bool:
        """Whether the chair touches something solid or a person, or has fallen."""
        return bool(self._touching)

    def place(self, solid: SolidBoxes) -> None:
        """Put the chair among these obstacles."""
        self._solid = solid

    def move_leaves(self, leaves: Sequence[Block]) -> None:
        """Put the leaves of the level's lifts where they are now."""
        move_leaves(self._solid, leaves)

    def is_free(self, pose: Pose2) -> bool:
        """Return whether the chair would touch nothing solid at a pose (map_from_base)."""
        return not in_contact(self._solid, self._body, pose)

    def clearance(self, pose: Pose2) -> float:
        """Return the distance [m] from the chair's rectangle at a pose to the nearest obstacle."""
        return clearance(self._solid, self._body, pose)

    def report_solid(self, now_ns: int, pose: Pose2, speed: float, *, free: bool, upright: bool) -> None:
        """Report a contact with something solid or a fall that begins, with the `speed` [m/s] before it."""
        if self._begins(ContactKind.SOLID, not free, lambda: self.clearance(pose)):
            at = nearest_point(self._solid, self._body, pose)
            self.reports.append(Contact(now_ns, ContactKind.SOLID, *at, speed))
        if self._begins(ContactKind.FALL, not upright, lambda: math.inf):
            self.reports.append(Contact(now_ns, ContactKind.FALL, pose.x, pose.y, speed))

    def report_people(self, now_ns: int, pose: Pose2, speed: float, people: Sequence[PersonState]) -> None:
        """Report a contact with a person that begins, with the `speed` [m/s] before it."""
        distance, x, y = nearest_person(self._body, pose, people)
        if self._begins(ContactKind.PERSON, distance < 0.5 * CONTACT_GAP, lambda: distance):
            self.reports.append(Contact(now_ns, ContactKind.PERSON, x, y, speed))

    def _begins(self, kind: ContactKind, touches: bool, distance: Callable[[], float]) -> bool:
        """Return whether a contact begins now; it ends at a distance of CONTACT_ENDS."""
        if touches and kind not in self._touching:
            self._touching.add(kind)
            return True
        if not touches and kind in self._touching and distance() > CONTACT_ENDS:
            self._touching.discard(kind)
        return False
