"""All tests of the glove's firmware that need nothing but a `GloveRig`, run against a given library: `cases.py LIBRARY`.

The same tests that pytest runs, so that they can be run under sanitizers, for coverage and against mutants. The first failure
ends the run with status 1.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from pathlib import Path

from tests.firmware_bridge.glove import test_glove_limits, test_glove_playing
from tests.firmware_bridge.glove.rig import GloveRig

MODULES = (test_glove_playing, test_glove_limits)


def cases() -> list[Callable[[GloveRig], None]]:
    """The tests with `rig` as their only argument, in the order of their modules."""
    functions = [value for module in MODULES for name, value in vars(module).items() if name.startswith("test_")]
    return [function for function in functions if list(inspect.signature(function).parameters) == ["rig"]]


def failure(library: Path) -> str:
    """Name of the first test that the library fails; empty when it passes all."""
    rig = GloveRig(library)
    for case in cases():
        rig.start()
        try:
            case(rig)
        except (AssertionError, IndexError):  # a glove that says nothing has no last report
            return case.__name__
    return ""


if __name__ == "__main__":
    sys.exit(1 if failure(Path(sys.argv[1])) else 0)
