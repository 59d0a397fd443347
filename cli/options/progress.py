"""Progress on standard error: the stages of a command as bars, or as lines where it is no terminal, and a sentence while
numba compiles, once for each machine."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from typing import TYPE_CHECKING, Protocol

from waychair.kernel_cache import load_lightly

if TYPE_CHECKING:
    from rich.console import Console

LINE_EVERY_S = 10.0
"""Time [s] between two lines about a stage where standard error is no terminal."""

_DRAWN_EVERY_S = 0.05  # a drive tells how far it is at every tick; drawing that would take longer than the drive
_LEAST_WAIT_S = 0.01
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


class ShowStage(Protocol):
    """A callback that shows how far a stage of a command is."""

    def __call__(self, stage: str, share: float | None, words: str = "") -> None:
        """Show the share (0 to 1) of a stage that is done, None if that is not known, and words such as the way driven."""


@contextmanager
def stage_bars(console: Console) -> Iterator[ShowStage]:
    """Yield a callback that shows the stages of a command, whose kernels come from their cache first.

    On a terminal they are bars with the time left. Elsewhere the present stage is told by a line each `LINE_EVERY_S`, also
    while nothing is heard of it. A quiet console shows nothing.
    """
    prepare_kernels(console.quiet)
    with _shown(console) as show:
        yield show


@contextmanager
def told_share(what: str, quiet: bool = False) -> Iterator[Callable[[float], None]]:
    """Yield a callback that shows the share (0 to 1) of one long piece of work, as `stage_bars` does; nothing with `quiet`."""
    with _on_standard_error(quiet) as show:
        show(what, 0.0)
        yield partial(show, what)


def part_of(show: Callable[[float], None], number: int, count: int) -> Callable[[float], None]:
    """Return a callback for the share of part `number`, from 0, of `count` equal parts of a piece of work."""
    return lambda share: show((number + share) / count)


@contextmanager
def told_time(what: str, quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """Show how long a piece of work of unknown length has lasted, as `stage_bars` does; nothing with `quiet`.

    Yields a callback for words on how far it is, such as the way driven.
    """
    with _on_standard_error(quiet) as show:
        show(what, None)
        yield partial(show, what, None)


@contextmanager
def told_stages(quiet: bool = False) -> Iterator[ShowStage]:
    """Yield a callback that shows the stages of a command on standard error, as `stage_bars` does; nothing with `quiet`."""
    prepare_kernels(quiet)
    with _on_standard_error(quiet) as show:
        yield show


@contextmanager
def _on_standard_error(quiet: bool) -> Iterator[ShowStage]:
    """Yield a callback that shows stages on standard error; with `quiet` nothing, and no library for bars is loaded."""
    if quiet:
        yield _show_nothing
        return
    from rich.console import Console

    with _shown(Console(stderr=True)) as show:
        yield show


def _show_nothing(stage: str, share: float | None, words: str = "") -> None:
    """Show nothing; see `ShowStage`."""


@contextmanager
def _shown(console: Console) -> Iterator[ShowStage]:
    """Yield a callback that shows stages on a console."""
    if console.quiet:
        yield _show_nothing
    elif console.is_terminal:
        with _drawn(console) as show:
            yield show
    else:
        with _told(console) as show:
            yield show


@contextmanager
def _drawn(console: Console) -> Iterator[ShowStage]:
    """Yield a callback that draws a bar for each stage; it moves to and fro while the share is not known."""
    from rich.progress import (
        BarColumn,
        Progress,
        TaskID,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[left]}"),
        TimeRemainingColumn(),
        TextColumn("so far"),
        TimeElapsedColumn(),
    )
    tasks: dict[str, TaskID] = {}
    drawn_s: dict[str, float] = {}
    # What is printed meanwhile comes above the bars; into a pipe or a file it must go as it is.
    with Progress(*columns, console=console, transient=True, redirect_stdout=sys.stdout.isatty()) as bars:

        def show(stage: str, share: float | None, words: str = "") -> None:
            now = time.monotonic()
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=None, left="")
            elif now - drawn_s[stage] < _DRAWN_EVERY_S and share != 1.0:
                return
            drawn_s[stage] = now
            said = f"{stage}: {words}" if words else stage
            if share is None:
                bars.update(tasks[stage], description=said)
            else:
                bars.update(tasks[stage], description=said, total=1.0, completed=share, left="left")

        yield show


@contextmanager
def _told(console: Console) -> Iterator[ShowStage]:
    """Yield a callback for stages that are told by lines."""
    lines, over = _Lines(console), threading.Event()

    def tell() -> None:
        while not over.wait(lines.due_in()):
            lines.tell()

    teller = threading.Thread(target=tell, name="progress", daemon=True)
    teller.start()
    try:
        yield lines.show
    finally:
        over.set()
        teller.join()


class _Lines:
    """Tells the stage of which something was heard last, by a line each `LINE_EVERY_S`."""

    def __init__(self, console: Console) -> None:
        self._console, self._lock = console, threading.Lock()
        self._stages: dict[str, _StageSoFar] = {}
        self._present: _StageSoFar | None = None
        self._told_s = time.monotonic()

    def due_in(self) -> float:
        """Return the time to the next line [s]."""
        with self._lock:
            return max(_LEAST_WAIT_S, self._told_s + LINE_EVERY_S - time.monotonic())

    def show(self, stage: str, share: float | None, words: str = "") -> None:
        """See `ShowStage`."""
        with self._lock:
            if stage not in self._stages:
                self._stages[stage] = _StageSoFar(stage)
            if self._present is not self._stages[stage]:
                self._present = self._stages[stage]
                self._present.go_on()
            self._present.take(share, words)
        self.tell()

    def tell(self) -> None:
        """Print the line about the present stage if it is due."""
        with self._lock:
            now = time.monotonic()
            if now - self._told_s < LINE_EVERY_S:
                return
            self._told_s = now
            if self._present is not None:
                self._console.print(self._present.line(now), markup=False, highlight=False, soft_wrap=True)


class _StageSoFar:
    """A stage: since when it lasts [s], the share of it that is done, and words on that."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._began_s = time.monotonic()
        self._share: float | None = None
        self._words = ""

    def go_on(self) -> None:
        """Count the time from now on if nothing of the stage has been done yet."""
        if not self._share:
            self._began_s = time.monotonic()

    def take(self, share: float | None, words: str) -> None:
        """Take in how far it is; a share that falls is that of a new beginning."""
        if share is not None and self._share is not None and share < self._share:
            self._began_s = time.monotonic()
        self._share, self._words = share, words

    def line(self, now_s: float) -> str:
        """Return how far it is, with the time left once that can be told, or the time so far."""
        lasted, share = now_s - self._began_s, self._share
        if not share:
            told = f"{_spoken(lasted)} so far"
        elif _TELLING <= share < 1.0:
            told = f"{100.0 * share:.0f} %, about {_spoken(lasted * (1.0 - share) / share)} left"
        else:
            told = f"{100.0 * share:.0f} %"
        return f"{self._name}: {told}" + (f", {self._words}" if self._words else "")


def _spoken(seconds: float) -> str:
    """Return a time in minutes, or in seconds where it is short."""
    return f"{seconds / 60.0:.0f} min" if seconds >= 120.0 else f"{seconds:.0f} s"
