"""Whether somebody can still press Stop: a drive that was begun from a page ends with the last page."""

from __future__ import annotations

from collections.abc import Sequence

from waychair.control.stops import Halt, halt

GONE_NS = 700_000_000
"""Pages that have not been heard of for so long are gone: with what lies between a page's last answer and the last word
of it (`ui.broadcaster`), and a tick, within a second. One that is reloaded is back sooner."""


class PageWatch:
    """Keeps when a page was there last, and whether the drive is a page's."""

    def __init__(self) -> None:
        self._seen_ns = 0
        self._by_page = False

    def began(self, now_ns: int) -> None:
        """A page has said the rider's yes, so there is one."""
        self._by_page, self._seen_ns = True, max(self._seen_ns, now_ns)

    def seen(self, pages: Sequence[str], now_ns: int) -> None:
        """Told which pages are open and answer."""
        if pages:
            self._seen_ns = now_ns

    def over(self) -> None:
        """Told that nothing drives: the next drive may be somebody else's."""
        self._by_page = False

    def halts(self, now_ns: int) -> tuple[Halt, ...]:
        """What stands against the drive."""
        return (halt("page_gone"),) if self._by_page and now_ns - self._seen_ns > GONE_NS else ()
