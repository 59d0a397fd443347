"""The rule that a drive begun from a page ends when no open page with a Stop button answers any more."""

from __future__ import annotations

from collections.abc import Sequence

from waychair.control.safety.stops import Halt, halt

GONE_NS = 700_000_000
"""Pages that have been silent for longer are gone. With the broadcaster's delay (`ui.broadcaster`) and a tick that is
within a second of the last answer; a page that is reloaded is back sooner."""


class PageWatch:
    """Keeps the time of the latest answer of a page, and whether the drive was begun from a page."""

    def __init__(self) -> None:
        self._seen_ns = 0
        self._by_page = False

    def began(self, now_ns: int) -> None:
        """Note that the rider's yes came from a page."""
        self._by_page, self._seen_ns = True, max(self._seen_ns, now_ns)

    def seen(self, pages: Sequence[str], now_ns: int) -> None:
        """Take the ids of the pages that are open and answer."""
        if pages:
            self._seen_ns = now_ns

    def over(self) -> None:
        """Note that the drive is over; the next one may be begun elsewhere."""
        self._by_page = False

    def halts(self, now_ns: int) -> tuple[Halt, ...]:
        """Return the halt `page_gone` where the last page is gone, else nothing."""
        return (halt("page_gone"),) if self._by_page and now_ns - self._seen_ns > GONE_NS else ()
