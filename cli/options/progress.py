"""Progress on standard error: the stages of a command as bars, or as lines where it is no terminal, and a sentence while
numba compiles, once for each machine."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

from waychair.kernel_cache import load_lightly

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

LINE_EVERY_S = 10.0
"""Time [s] between two lines about a stage where standard error is no terminal."""


_TELLING = 0.05  # share from which the time left is told: before, kernels are compiled, and it would be hours


def prepare_kernels(quiet: bool = False) -> None:
    """Let kernels come from their cache first; say on standard error, unless `quiet`, when the first has to be compiled."""
    load_lightly()
    if not quiet:
        _announce_compiling()


@cache
def _announce_compiling() -> None:
    """Say at the first kernel that has to be compiled that this happens once; later calls do nothing."""
    from numba.core import event

    class FirstCompilation(event.Listener):
        """Prints the sentence at the first compilation of the process."""

        said = False

        def on_start(self, event: event.Event) -> None:
            if not self.said:
                self.said = True
                print(
                    "compiling for this computer, once: up to a minute the first time "
                    "(`waychair doctor --warm` does it in advance)",
                    file=sys.stderr,
                    flush=True,
                )

        def on_end(self, event: event.Event) -> None:
            pass

    event.register("numba:compile", FirstCompilation())  # type: ignore[no-untyped-call]


def is_drawn(console: Console) -> bool:
    """Return whether bars are drawn on a console."""
    return console.is_terminal and not console.quiet


def stage_of(bars: Progress, name: str) -> Callable[[float], None]:
    """Add a stage to the bars; return the callback for the share of it (0 to 1) that is done.

    Where the bars' console is no terminal, no bar is drawn, and a stage that lasts tells its share and the time left by a
    line now and then.
    """
    if not bars.console.is_terminal:
        return _lines_of(lambda line: bars.console.print(line, markup=False, highlight=False, soft_wrap=True), name)
    task = bars.add_task(name, total=1.0)
    return lambda share: bars.update(task, completed=share)


def _lines_of(say: Callable[[str], None], name: str) -> Callable[[float], None]:
    """Return a callback that says a line about a stage each `LINE_EVERY_S`."""
    began = last = time.monotonic()

    def show(share: float) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last < LINE_EVERY_S:
            return
        last = now
        left = f", about {_spoken((now - began) * (1.0 - share) / share)} left" if _TELLING <= share < 1.0 else ""
        say(f"{name}: {100.0 * share:.0f} %{left}")

    return show


def _spoken(seconds: float) -> str:
    """Return a time in minutes, or in seconds where it is short."""
    return f"{seconds / 60.0:.0f} min" if seconds >= 120.0 else f"{seconds:.0f} s"


def told_share(what: str) -> Callable[[float], None]:
    """Return a callback that prints the share of a long piece of work on stderr, each `LINE_EVERY_S`."""
    return _lines_of(lambda line: print(line, file=sys.stderr, flush=True), what)


@contextmanager
def told_time(what: str, quiet: bool = False) -> Iterator[None]:
    """Print how long a piece of work of unknown length has lasted on stderr, each `LINE_EVERY_S`; nothing with `quiet`."""
    began, over = time.monotonic(), threading.Event()

    def tell() -> None:
        while not over.wait(LINE_EVERY_S):
            print(f"{what}: {_spoken(time.monotonic() - began)} so far", file=sys.stderr, flush=True)

    teller = threading.Thread(target=tell, name="told_time", daemon=True)
    if not quiet:
        teller.start()
    try:
        yield
    finally:
        over.set()
        if not quiet:
            teller.join()


@contextmanager
def stage_bars(console: Console) -> Iterator[Callable[[str, float], None]]:
    """Yield a callback that shows the progress of each stage, by its name and the share that is done."""
    from rich.progress import Progress

    prepare_kernels(console.quiet)
    with Progress(console=console, transient=True, disable=not is_drawn(console)) as bars:
        stages: dict[str, Callable[[float], None]] = {}

        def show(stage: str, share: float) -> None:
            if stage not in stages:
                stages[stage] = stage_of(bars, stage)
            stages[stage](share)

        yield show
