"""Progress on standard error: bars of a command's stages, and a sentence while numba compiles, once for each machine."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console


@cache
def announce_compiling() -> None:
    """Say on standard error, at the first kernel that has to be compiled, that this happens once; later calls do nothing."""
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


def told_share(what: str) -> Callable[[float], None]:
    """Return a callback that prints the share of a long piece of work, every two seconds."""
    last = time.monotonic()

    def tell(share: float) -> None:
        nonlocal last
        if time.monotonic() - last >= _TELL_S:
            last = time.monotonic()
            print(f"{what}: {share:.0%}", file=sys.stderr, flush=True)

    return tell


_TELL_S = 2.0


@contextmanager
def stage_bars(console: Console) -> Iterator[Callable[[str, float], None]]:
    """Yield a callback that shows a bar for each stage, by its name and the share that is done."""
    from rich.progress import Progress, TaskID

    if not console.quiet:
        announce_compiling()
    with Progress(console=console, transient=True, disable=console.quiet) as bar:
        tasks: dict[str, TaskID] = {}

        def show(stage: str, share: float) -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage, total=1.0)
            bar.update(tasks[stage], completed=share)

        yield show
